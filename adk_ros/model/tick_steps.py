# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The arithmetic of a tick before and after the online method learns: `observe` and `predict`.

`CompiledTick` does each in one kernel call. A call costs more than its arithmetic, above all
after a pause, when code and data have left the caches. `StepwiseTick` is for models that are not
lifted by a compiled encoder at each step, or have no rollout monitor.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

from adk_ros.model.drivable import is_drivable
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.lifting.encoder_kernels import pack_regressor, perceptron
from adk_ros.model.model_rollout import ModelRollout
from adk_ros.model.tick_memory import TickMemory, complete_pair, memory_arrays, observe
from adk_ros.model.uncertainty.compiled_rollout import roll_out, to_si
from adk_ros.model.uncertainty.published_horizons import (
    PublishedHorizonErrors,
    compare_horizons,
    published_arrays,
    update_published_errors,
)
from adk_ros.model.uncertainty.rollout_monitor import (
    RolloutMonitor,
    monitor_arrays,
    start_rollout,
    update_rollouts,
)
from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.numerics.numba_cache import fused_kernel

PREDICTED, NOT_FINITE, NOT_DRIVABLE = 0, 1, 2
"""Outcomes of `predict`."""


class Observed(NamedTuple):
    """
    What a tick begins with, SI: state (3,), the prediction for it, their difference, the command.

    Prediction and innovation are NaN if there are none.
    """

    state: FloatArray
    predicted: FloatArray
    innovation: FloatArray
    command: tuple[float, float]


class Measured(NamedTuple):
    """State (3,) of a tick, SI; whether it is a measurement, and whether it may be learned."""

    state: FloatArray
    is_measured: bool
    is_usable: bool


class TickSteps(Protocol):
    """What a predictor calls on every tick."""

    def observe(
        self, theta: FloatArray, seen: Observed, gains: FloatArray, usable: bool, learns: bool
    ) -> bool:
        """
        Take a sample, advance the monitored rollouts, lift, and complete the regression pair.

        The pair only if `learns`. Return whether there is one to learn.
        """

    def predict(
        self, theta: FloatArray, measured: Measured, horizon: FloatArray, ahead: int, slot: int,
        withholds: bool,
    ) -> int:  # fmt: skip
        """
        Write the `horizon` (h, 3), SI, under a constant command; return the outcome.

        If it is PREDICTED, compare the state with earlier horizons, and store the first `ahead`
        rows in `slot`. Only with `withholds` it is checked whether a vehicle can follow.
        """


class StepwiseTick:
    """The steps by single calls."""

    def __init__(
        self,
        model: KoopmanModel,
        memory: TickMemory,
        published: PublishedHorizonErrors,
        rollout: ModelRollout,
    ) -> None:
        self._model, self._memory, self._rollout = model, memory, rollout
        self._published = published
        # A view: the present command, as commands ahead.
        self._constant_command = memory.tick.u[None]

    def observe(
        self, theta: FloatArray, seen: Observed, gains: FloatArray, usable: bool, learns: bool
    ) -> bool:
        """See `TickSteps`; there are no monitored rollouts."""
        memory = self._memory
        observe(seen.state, seen.predicted, seen.command, gains, memory.rows)
        memory.features[:] = self._model.lifting(memory.tick.row)
        return learns and bool(complete_pair(theta, seen.innovation, memory.rows))

    def predict(
        self, theta: FloatArray, measured: Measured, horizon: FloatArray, ahead: int, slot: int,
        withholds: bool,
    ) -> int:  # fmt: skip
        """See `TickSteps`."""
        memory, state = self._memory, measured.state
        tick = memory.tick
        pack_regressor(tick.x_past, memory.features, tick.u, self._model.affine, memory.phi)
        rows = self._rollout.run(theta, self._constant_command, len(horizon), None)
        if rows is None:
            return NOT_FINITE
        horizon[:] = rows
        if withholds and not is_drivable(state, horizon):
            return NOT_DRIVABLE
        update_published_errors(
            state, measured.is_usable, horizon[:ahead], slot, self._published.rows
        )
        return PREDICTED


class CompiledTick:
    """The steps in two kernel calls."""

    def __init__(
        self, memory: TickMemory, published: PublishedHorizonErrors, monitor: RolloutMonitor
    ) -> None:
        self._monitor = monitor
        # The tables keep their arrays alive, and these objects the tables.
        self._kept = memory, published
        self._memory_rows, self._published_rows = memory.rows, published.rows

    def observe(
        self, theta: FloatArray, seen: Observed, gains: FloatArray, usable: bool, learns: bool
    ) -> bool:
        """See `TickSteps`."""
        return bool(
            observe_and_lift(
                theta, *seen, gains, usable, learns, self._memory_rows, self._monitor.rows
            )
        )

    def predict(
        self, theta: FloatArray, measured: Measured, horizon: FloatArray, ahead: int, slot: int,
        withholds: bool,
    ) -> int:  # fmt: skip
        """See `TickSteps`; also start a monitored rollout if one is due."""
        start = self._monitor.next_slot() if measured.is_measured else -1
        return int(
            predict_and_compare(
                theta, measured.state, horizon, ahead, measured.is_usable, withholds, start, slot,
                self._memory_rows, self._monitor.rows, self._published_rows,
            )
        )  # fmt: skip


@fused_kernel
def observe_and_lift(
    theta: FloatArray,
    state: FloatArray,
    predicted: FloatArray,
    innovation: FloatArray,
    command: tuple[float, float],
    gains: FloatArray,
    usable: bool,
    learns: bool,
    memory_rows: IntArray,
    monitor_rows: IntArray,
) -> bool:
    """Run the observer, advance the monitored rollouts, and lift; see `TickSteps.observe`."""
    memory, monitor = memory_arrays(memory_rows), monitor_arrays(monitor_rows)
    observe(state, predicted, command, gains, memory_rows)
    tick, form = memory.tick, memory.form
    update_rollouts(tick.measured, tick.u_previous, usable, form[2], form[0] != 0, monitor)
    perceptron(tick.row, monitor.encoder, monitor.scratch, memory.features)
    return learns and complete_pair(theta, innovation, memory_rows)


@fused_kernel
def predict_and_compare(
    theta: FloatArray,
    state: FloatArray,
    horizon: FloatArray,
    ahead: int,
    usable: bool,
    withholds: bool,
    monitor_slot: int,
    slot: int,
    memory_rows: IntArray,
    monitor_rows: IntArray,
    published_rows: IntArray,
) -> int:
    """
    Write the `horizon` (h, 3), SI, and compare `state` with earlier ones; see `TickSteps`.

    A monitored rollout is started in `monitor_slot`, unless it is -1.
    """
    memory, monitor = memory_arrays(memory_rows), monitor_arrays(monitor_rows)
    tick, disturbance = memory.tick, memory.pair.disturbance
    residual, affine = memory.form[0] != 0, memory.form[1] != 0
    pack_regressor(tick.x_past, memory.features, tick.u, affine, memory.pair.phi)
    if monitor_slot >= 0:
        start_rollout(monitor_slot, tick.x_past, tick.u_past, theta, affine, disturbance, monitor)
    roll_out(
        tick.x_past,
        tick.u_past,
        theta,
        tick.u.reshape((1, 2)),
        disturbance,
        residual,
        affine,
        horizon,
        memory.pair.step_scale,
        memory.pair.gains,
        monitor.encoder,
    )
    finite = to_si(
        horizon,
        tick.x_past[0],
        disturbance.reshape((1, 3, 3)),
        monitor.statistics.weights,
        monitor.statistics.shrinkage,
        memory.scaling.x_mean,
        memory.scaling.x_scale,
    )
    if not finite:
        return NOT_FINITE
    if withholds and not is_drivable(state, horizon):
        return NOT_DRIVABLE
    compare_horizons(state, usable, horizon[:ahead], slot, published_arrays(published_rows))
    return PREDICTED


def make_tick_steps(
    model: KoopmanModel,
    memory: TickMemory,
    published: PublishedHorizonErrors,
    rollout: ModelRollout,
    monitor: RolloutMonitor | None,
) -> TickSteps:
    """Return compiled steps if there is a monitor, which has the compiled encoder."""
    if monitor is None:
        return StepwiseTick(model, memory, published, rollout)
    return CompiledTick(memory, published, monitor)
