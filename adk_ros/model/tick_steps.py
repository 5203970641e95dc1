# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The arithmetic of a tick: observe, lift, learn, predict.

`FusedTick` does all of it in one kernel call. A call costs more than its arithmetic, above all
after a pause, when code and data have left the caches. `CompiledTick` is for online methods that
are not part of that kernel, `StepwiseTick` for models that are not lifted by a compiled encoder at
each step, or have no rollout monitor.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

from adk_ros.model.adaptation.least_squares import window_arrays, windowed_update
from adk_ros.model.adaptation.online_methods import OnlineMethod, WindowedRidge
from adk_ros.model.drivable import is_drivable
from adk_ros.model.estimation.disturbance import decay_disturbance
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.lifting.encoder_kernels import pack_regressor, perceptron
from adk_ros.model.model_rollout import ModelRollout
from adk_ros.model.tick_memory import (
    TickMemory,
    complete_pair,
    imu_horizon,
    memory_arrays,
    observe,
    replace_published_by_naive,
    start_of_horizon,
)
from adk_ros.model.uncertainty.compiled_rollout import roll_out, to_si
from adk_ros.model.uncertainty.fallback import take_over_published
from adk_ros.model.uncertainty.published_horizons import (
    PublishedHorizonErrors,
    compare_and_publish,
    compare_horizons,
    forget_horizon,
    publish_horizon,
    published_arrays,
)
from adk_ros.model.uncertainty.rollout_monitor import (
    RolloutMonitor,
    monitor_arrays,
    start_rollout,
    store_naive,
    update_rollouts,
)
from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.numerics.numba_cache import fused_kernel

PREDICTED, NOT_FINITE, NOT_DRIVABLE, WARMING_UP, NOT_SOLVED = 0, 1, 2, 3, 4
"""Outcomes of `TickSteps.advance`, and of its last part; NOT_SOLVED: the online method failed."""


IS_TRUSTED, IS_USABLE, LEARNS, IS_WARMING_UP, WITHHOLDS = 1, 2, 4, 8, 16
"""
Flags of a tick: the state is a new measurement that was not rejected, it may be learned, the pair
that it completes may, past samples are missing, and a prediction that no vehicle can follow is no
prediction.

In one integer, since numba looks up the type of each bool or tuple that it gets.
"""


class TickInput(NamedTuple):
    """
    What a tick begins with, SI.

    `state` (3,), the prediction for it, their difference (both NaN if there is none), the command
    in force, `gains` as `ObserverGains.table`, and flags.
    """

    state: FloatArray
    predicted: FloatArray
    innovation: FloatArray
    torque: float
    delta: float
    gains: FloatArray
    flags: int


class TickSteps(Protocol):
    """What a predictor calls on every tick."""

    def advance(self, given: TickInput, horizon: FloatArray, ahead: int, slot: int) -> int:
        """
        Take a sample; lift, learn, and write the `horizon` (h, 3), SI, under a constant command.

        Return the outcome. Compare the state with earlier horizons; shrink this one by what they
        were worth, and if it is PREDICTED, store its first `ahead` rows in `slot`.
        """


class TickParts(NamedTuple):
    """What the steps of a tick work on."""

    model: KoopmanModel
    memory: TickMemory
    published: PublishedHorizonErrors
    rollout: ModelRollout
    online: OnlineMethod


class StepwiseTick:
    """The steps by single calls; there are no monitored rollouts."""

    def __init__(self, parts: TickParts) -> None:
        self._parts = parts
        # A view: the present command, as commands ahead.
        self._constant_command = parts.memory.tick.u[None]

    def advance(self, given: TickInput, horizon: FloatArray, ahead: int, slot: int) -> int:
        """See `TickSteps`."""
        model, memory, published, rollout, online = self._parts
        tick, flags = memory.tick, given.flags
        command = given.torque, given.delta
        observe(given.state, given.predicted, command, given.gains, memory.rows)
        memory.features[:] = model.lifting(tick.row)
        completed = flags & LEARNS and complete_pair(online.theta, given.innovation, memory.rows)
        if not flags & LEARNS:
            decay_disturbance(memory.disturbance, memory.gains)
        if flags & IS_WARMING_UP:
            return WARMING_UP
        if completed:
            online.update(memory.phi, memory.y)
        pack_regressor(tick.x_past, memory.features, tick.u, model.affine, memory.phi)
        rows = rollout.run(online.theta, self._constant_command, len(horizon), None)
        if rows is None:
            return NOT_FINITE
        horizon[:] = rows
        if model.fallback.is_active:
            replace_published_by_naive(horizon, memory.rows)
        usable, base = bool(flags & IS_USABLE), start_of_horizon(given.state, memory.rows)
        naive = imu_horizon(len(horizon), memory.rows)
        compare_and_publish(given.state, usable, base, naive, horizon, ahead, slot, published.rows)
        if flags & WITHHOLDS and not is_drivable(given.state, horizon):
            forget_horizon(slot, published_arrays(published.rows))
            return NOT_DRIVABLE
        return PREDICTED


class CompiledTick:
    """The steps in two kernel calls around the online method."""

    def __init__(self, parts: TickParts, monitor: RolloutMonitor) -> None:
        self._monitor, self._online = monitor, parts.online
        self._memory = parts.memory
        # The tables keep their arrays alive, and these objects the tables.
        self._kept = parts
        self._rows = parts.memory.rows, monitor.rows, parts.published.rows

    def advance(self, given: TickInput, horizon: FloatArray, ahead: int, slot: int) -> int:
        """See `TickSteps`; also start a monitored rollout if one is due."""
        completed = observe_and_lift(self._online.theta, *given, *self._rows[:2])
        if given.flags & IS_WARMING_UP:
            return WARMING_UP
        if completed:
            self._online.update(self._memory.phi, self._memory.y)
        return self._predict(given, horizon, ahead, slot, self._next_slot(given))

    def _next_slot(self, given: TickInput) -> int:
        return self._monitor.next_slot() if given.flags & IS_TRUSTED else -1

    def _predict(
        self, given: TickInput, horizon: FloatArray, ahead: int, slot: int, monitor_slot: int
    ) -> int:
        return int(
            predict_and_compare(
                self._online.theta, given.state, horizon, ahead, given.flags, monitor_slot, slot,
                *self._rows,
            )
        )  # fmt: skip


class FusedTick(CompiledTick):
    """The steps with windowed least squares in one kernel call."""

    def __init__(self, parts: TickParts, monitor: RolloutMonitor, online: WindowedRidge) -> None:
        super().__init__(parts, monitor)
        self._windowed = online

    def advance(self, given: TickInput, horizon: FloatArray, ahead: int, slot: int) -> int:
        """See `TickSteps`; also start a monitored rollout if one is due."""
        monitor_slot = -1 if given.flags & IS_WARMING_UP else self._next_slot(given)
        outcome = int(
            fused_tick(
                *given, horizon, ahead, monitor_slot, slot, self._windowed.rows, *self._rows

            )
        )  # fmt: skip
        if outcome != NOT_SOLVED:
            return outcome
        self._windowed.start_again()
        return self._predict(given, horizon, ahead, slot, monitor_slot)


@fused_kernel
def fused_tick(
    state: FloatArray,
    predicted: FloatArray,
    innovation: FloatArray,
    torque: float,
    delta: float,
    gains: FloatArray,
    flags: int,
    horizon: FloatArray,
    ahead: int,
    monitor_slot: int,
    slot: int,
    window_rows: IntArray,
    memory_rows: IntArray,
    monitor_rows: IntArray,
    published_rows: IntArray,
) -> int:
    """Run `observe_and_lift`, `windowed_update` and `predict_and_compare`; return the outcome."""
    theta, pair = window_arrays(window_rows).theta, memory_arrays(memory_rows).pair
    completed = observe_and_lift(
        theta, state, predicted, innovation, torque, delta, gains, flags, memory_rows, monitor_rows
    )
    if flags & IS_WARMING_UP:
        return WARMING_UP
    if completed and not windowed_update(pair.phi, pair.y, window_rows):
        return NOT_SOLVED
    return predict_and_compare(
        theta, state, horizon, ahead, flags, monitor_slot, slot,
        memory_rows, monitor_rows, published_rows,
    )  # fmt: skip


@fused_kernel
def observe_and_lift(
    theta: FloatArray,
    state: FloatArray,
    predicted: FloatArray,
    innovation: FloatArray,
    torque: float,
    delta: float,
    gains: FloatArray,
    flags: int,
    memory_rows: IntArray,
    monitor_rows: IntArray,
) -> bool:
    """
    Run the observer, advance the monitored rollouts, lift, and complete the regression pair.

    The pair only with LEARNS. Return whether there is one to learn.
    """
    memory, monitor = memory_arrays(memory_rows), monitor_arrays(monitor_rows)
    observe(state, predicted, (torque, delta), gains, memory_rows)
    tick, form, usable = memory.tick, memory.form, flags & IS_USABLE != 0
    update_rollouts(
        tick.measured, tick.u_previous, usable, form[2], form[0] != 0, monitor, memory.fallback
    )
    perceptron(tick.row, monitor.encoder, monitor.scratch, memory.features)
    if flags & LEARNS == 0:
        decay_disturbance(memory.pair.disturbance, memory.pair.gains)
        return False
    return complete_pair(theta, innovation, memory_rows)


@fused_kernel
def predict_and_compare(
    theta: FloatArray,
    state: FloatArray,
    horizon: FloatArray,
    ahead: int,
    flags: int,
    monitor_slot: int,
    slot: int,
    memory_rows: IntArray,
    monitor_rows: IntArray,
    published_rows: IntArray,
) -> int:
    """
    Write the `horizon` (h, 3), SI, and compare `state` with earlier ones; return the outcome.

    A monitored rollout is started in `monitor_slot`, unless it is -1.
    """
    memory, monitor = memory_arrays(memory_rows), monitor_arrays(monitor_rows)
    tick, disturbance = memory.tick, memory.pair.disturbance
    residual, affine = memory.form[0] != 0, memory.form[1] != 0
    pack_regressor(tick.x_past, memory.features, tick.u, affine, memory.pair.phi)
    if monitor_slot >= 0:
        start_rollout(monitor_slot, tick.x_past, tick.u_past, theta, affine, disturbance, monitor)
        store_naive(monitor_slot, memory.fallback, memory.scaling, monitor.slots)
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
        monitor.bounds,
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
    take_over_published(horizon, memory.fallback)
    published = published_arrays(published_rows)
    compare_horizons(state, flags & IS_USABLE != 0, published)
    base = start_of_horizon(state, memory_rows)
    naive = imu_horizon(horizon.shape[0], memory_rows)
    publish_horizon(base, naive, horizon, ahead, slot, published)
    if flags & WITHHOLDS and not is_drivable(state, horizon):
        forget_horizon(slot, published)
        return NOT_DRIVABLE
    return PREDICTED


def make_tick_steps(parts: TickParts, monitor: RolloutMonitor | None) -> TickSteps:
    """Return compiled steps if there is a monitor, which has the compiled encoder."""
    if monitor is None:
        return StepwiseTick(parts)
    if isinstance(parts.online, WindowedRidge):
        return FusedTick(parts, monitor, parts.online)
    return CompiledTick(parts, monitor)
