# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Arrays of a predictor that every tick updates in place, and the kernels that only need them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from adk_ros.model.estimation.disturbance import (
    RegressionArrays,
    ewma_covariance,
    regression_pair,
)
from adk_ros.model.estimation.observer import ScalingArrays, TickArrays, observer_update
from adk_ros.model.initial_errors import monitored_steps, one_step_errors
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.lifting.encoder import input_size
from adk_ros.model.uncertainty.compiled_rollout import MAX_SCALED_STATE
from adk_ros.model.uncertainty.fallback import (
    FallbackArrays,
    fallback_arrays,
    integrate_imu,
    take_over,
    take_over_published,
)
from adk_ros.numerics.array_table import (
    ArrayTable,
    floats_1,
    floats_2,
    floats_4,
    integers_1,
    singles_1,
)
from adk_ros.numerics.arrays import Float32Array, FloatArray, IntArray
from adk_ros.numerics.numba_cache import strict_kernel

_COVARIANCE_GAIN = 0.01
"""Gain per tick of the innovation covariance: time constant 2.5 s. Empirical, not calibrated."""


class ModelForm(NamedTuple):
    """Form of a model, and the number of columns of the encoder's input that are states."""

    residual: int
    affine: int
    n_x: int


class MemoryArrays(NamedTuple):
    """
    What kernels see of a `TickMemory`.

    `features` (m,): of the present tick; `covariance` (3, 3): of the innovation, SI; `form`:
    the values of `ModelForm`; `filtered` (3,): state of the observer, SI; `fallback`: naive
    predictors.
    """

    scaling: ScalingArrays
    tick: TickArrays
    pair: RegressionArrays
    features: Float32Array
    covariance: FloatArray
    form: NDArray[np.int64]
    filtered: FloatArray
    fallback: FallbackArrays


class TickMemory:
    """
    Past samples, disturbance, regressor and innovation covariance of a predictor.

    `tick`: past samples, scaled; `phi` (n_phi,): regressor of the latest tick; `y` (n_z,): target
    that belongs to it; `disturbance` (3, 3): slow, fast and running mean of the residual;
    `gains` (5, 3): `ObserverGains.table`; `covariance` (3, 3): of the innovation, SI; `filtered`
    (3,): state of the observer, SI, NaN before the first. `fallback`: naive predictors and what
    they start from. `scaling`: of states and commands. `rows`: all of it as a table for kernels.
    """

    def __init__(self, model: KoopmanModel) -> None:
        scaling, history = model.scaling, model.history
        self._errors = one_step_errors(model)
        self.gains = model.observer_gains.table()
        self.tick = TickArrays(
            measured=np.zeros(3),
            x_past=np.zeros((history + 1, 3)),
            u_past=np.zeros((history, 2)),
            u=np.zeros(2),
            u_previous=np.zeros(2),
            row=np.zeros(input_size(history), dtype=np.float32),
            autocorrelation=np.zeros((3, 3)),
        )
        self.phi = np.zeros(model.theta0.shape[1])
        self.y = np.zeros(model.n_z)
        self.disturbance = np.zeros((3, 3))
        self.features = np.zeros(model.n_z - 3, dtype=np.float32)
        self.covariance = np.zeros((3, 3))
        self.filtered = np.full(3, np.nan)
        self.fallback = fallback_arrays(model.fallback, monitored_steps(model))
        self.scaling = ScalingArrays(
            *(
                np.ascontiguousarray(values, dtype=np.float64)
                for values in (scaling.x_mean, scaling.x_scale, scaling.u_mean, scaling.u_scale)
            )
        )
        form = ModelForm(model.residual, model.affine, 3 * (history + 1))
        arrays = MemoryArrays(
            self.scaling,
            self.tick,
            RegressionArrays(
                measured=self.tick.measured,
                phi=self.phi,
                step_scale=np.ascontiguousarray(scaling.step_scale, dtype=np.float64),
                gains=self.gains,
                disturbance=self.disturbance,
                y=self.y,
            ),
            self.features,
            self.covariance,
            np.array(form, dtype=np.int64),
            self.filtered,
            self.fallback,
        )
        self._table = ArrayTable(
            *arrays.scaling, *arrays.tick, *arrays.pair, *arrays[3:-1], *arrays.fallback
        )
        self.rows = self._table.rows
        self.reset()

    def reset(self) -> None:
        """Forget the estimates; past samples stay until they are overwritten."""
        self.disturbance[:] = 0.0
        self.tick.autocorrelation[:] = 0.0
        self.covariance[:] = self._errors
        self.lose_state()
        self.fallback.weights[:] = self.fallback.trained

    def lose_state(self) -> None:
        """Forget what naive predictors start from."""
        self.fallback.start[:] = np.nan
        self.fallback.coasted[0] = 0


@strict_kernel
def memory_arrays(rows: IntArray) -> MemoryArrays:
    """Return the structure that `TickMemory` passes to kernels as a table."""
    return MemoryArrays(
        ScalingArrays(floats_1(rows, 0), floats_1(rows, 1), floats_1(rows, 2), floats_1(rows, 3)),
        TickArrays(
            floats_1(rows, 4),
            floats_2(rows, 5),
            floats_2(rows, 6),
            floats_1(rows, 7),
            floats_1(rows, 8),
            singles_1(rows, 9),
            floats_2(rows, 10),
        ),
        RegressionArrays(
            floats_1(rows, 11),
            floats_1(rows, 12),
            floats_1(rows, 13),
            floats_2(rows, 14),
            floats_2(rows, 15),
            floats_1(rows, 16),
        ),
        singles_1(rows, 17),
        floats_2(rows, 18),
        integers_1(rows, 19),
        floats_1(rows, 20),
        FallbackArrays(
            floats_4(rows, 21),
            floats_2(rows, 22),
            floats_1(rows, 23),
            floats_4(rows, 24),
            integers_1(rows, 25),
        ),
    )


@strict_kernel
def observe(
    state: FloatArray,
    predicted: FloatArray,
    command: tuple[float, float],
    gains: FloatArray,
    rows: IntArray,
) -> None:
    """Run `observer_update` on the memory `rows`, and convert its state to SI."""
    memory = memory_arrays(rows)
    scaling, tick = memory.scaling, memory.tick
    observer_update(state, predicted, command, gains, scaling, tick)
    for c in range(3):
        memory.filtered[c] = tick.x_past[0, c] * scaling.x_scale[c] + scaling.x_mean[c]


@strict_kernel
def start_of_horizon(state: FloatArray, rows: IntArray) -> FloatArray:
    """
    Return the present state (3,), SI, limited as predicted states are.

    While coasting it is `state`, which naive predictors have a part in.
    """
    memory = memory_arrays(rows)
    scaling, base = memory.scaling, np.empty(3)
    if memory.fallback.coasted[0] > 0:
        base[:] = state
        return base
    for c in range(3):
        x = min(max(memory.tick.x_past[0, c], -MAX_SCALED_STATE), MAX_SCALED_STATE)
        base[c] = x * scaling.x_scale[c] + scaling.x_mean[c]
    return base


@strict_kernel
def imu_horizon(steps: int, rows: IntArray) -> FloatArray:
    """Return the states (steps, 3), SI, of IMU integration, limited as predicted states are."""
    memory = memory_arrays(rows)
    scaling, out = memory.scaling, np.empty((steps, 3))
    integrate_imu(memory.fallback.start, out)
    for c in range(3):
        reach = MAX_SCALED_STATE * scaling.x_scale[c]
        for h in range(steps):
            if np.isfinite(out[h, c]):
                out[h, c] = min(
                    max(out[h, c], scaling.x_mean[c] - reach), scaling.x_mean[c] + reach
                )
    return out


@strict_kernel
def complete_pair(theta: FloatArray, innovation: FloatArray, rows: IntArray) -> bool:
    """
    Complete the regression pair of the tick before, and take over its `innovation` (3,), SI.

    Return as `regression_pair`; without a valid pair the innovation covariance is not changed.
    """
    memory = memory_arrays(rows)
    valid = regression_pair(memory.features, theta, memory.form[0] != 0, memory.pair)
    if valid:
        ewma_covariance(memory.covariance, innovation, _COVARIANCE_GAIN)
    return valid


@strict_kernel
def replace_by_naive(horizon: FloatArray, commands: int, rows: IntArray) -> None:
    """Run `take_over` on the memory `rows`."""
    take_over(horizon, commands, memory_arrays(rows).fallback)


@strict_kernel
def replace_published_by_naive(horizon: FloatArray, rows: IntArray) -> None:
    """Run `take_over_published` on the memory `rows`."""
    take_over_published(horizon, memory_arrays(rows).fallback)
