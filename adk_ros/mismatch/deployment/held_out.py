# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Errors of open-loop predictions on data that no hypothesis is fitted to, and what they should be.

A correct model still errs: by the measurement noise of its start and of the comparison, by what
the surrogate cannot reproduce of the simulator, and by the build tolerances of the car
(`tolerance_error`). `explained_ratio` compares an error with these; above one, something is left
that the model does not explain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from adk_ros.errors import DataError
from adk_ros.mismatch.deployment.open_loop import ASSIMILATION_GAINS, OpenLoopPredictor
from adk_ros.mismatch.deployment.prediction_starts import FIRST_START_S, start_times_of
from adk_ros.mismatch.deployment.surrogate_file import SurrogateFile
from adk_ros.mismatch.inference.hypothesis import ActiveEffect
from adk_ros.mismatch.library.criteria import (
    INEXACT_EQUATION_SHARE,
    MAX_EXPLAINED_RATIO,
    MIN_SPEED,
)
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.surrogate.activation import Activation
from adk_ros.numerics.arrays import BoolArray, FloatArray
from adk_ros.signals.channels import STATE_NAMES, TICK_NS

HORIZONS_S = (0.25, 1.0, 2.0)
"""Horizons at which errors are compared, s."""
REPORTED_HORIZON = 1
"""Index of the horizon whose errors are reported first: 1 s."""
START_STRIDE_S = 0.25
"""
Interval between the starts of predictions, s: the shortest horizon, so that every measurement is
predicted, and none twice at that horizon.
"""
_TICK_S = TICK_NS * 1e-9


@dataclass(frozen=True)
class Evidence:
    """
    A recording, or its part from `from_s` to `until_s`, to predict.

    `skipped_s` (k, 2): begin and end of stretches that no prediction may touch. `yaw_filter_s`,
    `v_x_is_given`: as in `OpenLoopPredictor`.
    """

    log: SensorLog
    from_s: float = FIRST_START_S
    until_s: float = np.inf
    skipped_s: FloatArray | None = None
    yaw_filter_s: float | None = None
    v_x_is_given: bool = False

    def predictor(self, model: SurrogateFile) -> OpenLoopPredictor:
        """Return a model prepared for predictions along the recording."""
        return OpenLoopPredictor(model, self.log, self.yaw_filter_s, self.v_x_is_given)

    def touches_skipped(self, begins_s: FloatArray, duration_s: float) -> BoolArray:
        """Return which of the intervals that begin at `begins_s` (n,) overlap a skipped one."""
        skipped = np.empty((0, 2)) if self.skipped_s is None else self.skipped_s
        begin, end = skipped[:, 0], skipped[:, 1]
        late = begins_s[:, None] + duration_s >= begin
        return np.asarray((late & (begins_s[:, None] <= end)).any(axis=1))


def horizon_errors(
    model: SurrogateFile,
    evidence: Sequence[Evidence],
    horizons_s: Sequence[float] = HORIZONS_S,
) -> FloatArray:
    """
    Return predicted minus measured (n, horizons, 3) of v_x, v_y, yaw rate; horizons ascend.

    One row per start; NaN where the car is slower than `MIN_SPEED` at the start or at the end of
    the horizon, where there is no measurement, or where a prediction touches a skipped stretch.
    """
    return np.concatenate([_errors(item.predictor(model), item, horizons_s) for item in evidence])


def persistence_errors(evidence: Sequence[Evidence]) -> FloatArray:
    """Return the errors (n, horizons, 3) of the prediction that the state does not change."""
    return np.concatenate([_errors(None, item, HORIZONS_S) for item in evidence])


def _errors(
    predictor: OpenLoopPredictor | None, item: Evidence, horizons_s: Sequence[float]
) -> FloatArray:
    log = item.log
    ticks = [round(horizon / _TICK_S) for horizon in horizons_s]
    try:
        starts = start_times_of(log, ticks[-1], START_STRIDE_S, max(item.from_s, FIRST_START_S))
    except DataError:
        return np.empty((0, len(ticks), 3))
    starts = starts[starts + horizons_s[-1] <= item.until_s]
    if not starts.size:
        return np.empty((0, len(ticks), 3))

    def measured(at_s: FloatArray) -> FloatArray:
        columns = [np.interp(at_s, log.odometry_s, log.odometry[:, i]) for i in range(3)]
        return np.column_stack(columns)

    at_start = measured(starts)
    predicted = None if predictor is None else predictor.predict(starts, ticks[-1])
    out = np.empty((starts.size, len(ticks), 3))
    for i, (horizon, tick) in enumerate(zip(horizons_s, ticks, strict=True)):
        at_s = starts + horizon
        at_end = measured(at_s)
        ahead = at_start if predicted is None else predicted[:, tick - 1]
        slowest = np.minimum(np.abs(at_start[:, 0]), np.abs(at_end[:, 0]))
        counted = (at_s <= log.odometry_s[-1]) & (slowest > log.similar(MIN_SPEED))
        counted &= ~item.touches_skipped(starts, horizon)
        out[:, i] = np.where(counted[:, None], ahead - at_end, np.nan)
    return out


def check_held_out(log: SensorLog) -> None:
    """
    Check a recording to predict.

    :raises DataError: it allows no prediction: too short, or the car does not move.
    """
    starts = start_times_of(log, round(HORIZONS_S[-1] / _TICK_S), START_STRIDE_S, FIRST_START_S)
    speed = np.interp(starts, log.odometry_s, log.odometry[:, 0])
    slowest = log.similar(MIN_SPEED)
    if not np.any(speed > slowest):
        raise DataError(
            f"{log.name}: the vehicle is never faster than {slowest:.3g} m/s: there is nothing to "
            "predict; give another held-out recording"
        )


def rmse(errors: FloatArray) -> FloatArray:
    """Return the RMSE (horizons, 3) of errors (n, horizons, 3); NaN where nothing counts."""
    count = np.isfinite(errors).sum(axis=0)
    total = np.nansum(errors**2, axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.where(count > 0, np.sqrt(total / count), np.nan))


def noise_error(log: SensorLog) -> FloatArray:
    """
    Return the error (3,) of a perfect model that odometry noise alone causes, at any horizon.

    A filter that corrects by the share g of each innovation has the variance g / (2 - g) of the
    noise; the dynamics do not amplify it, and the measurement at the horizon adds one more.
    """
    gain = ASSIMILATION_GAINS
    return np.asarray(log.noise()[3:] * np.sqrt(1.0 + gain / (2.0 - gain)))


@dataclass(frozen=True)
class HeldOutErrors:
    """
    RMSE (horizons, 3) on held-out data, SI: of the simulation, of the model, and of persistence.

    `expected`: what noise, build tolerances and the surrogate's own error cause. `corrected`: of
    the model with the effects, on sensor data from which identified sensor faults are removed.
    `tolerances_fitted`: it is the simulation with the build tolerances of the training part, and
    `expected` is without tolerances.
    """

    before: FloatArray
    after: FloatArray
    persistence: FloatArray
    expected: FloatArray
    corrected: FloatArray
    starts: int
    tolerances_fitted: bool = False

    def explained_ratio(self) -> FloatArray:
        """
        Return the error over the largest that the model can explain (horizons, 3).

        No effect's equation is exact: a share of the error before the correction may remain.
        """
        return self.ratio_of(self.corrected)

    def ratio_of(self, errors: FloatArray) -> FloatArray:
        """Return the same of other errors (horizons, 3)."""
        allowed = np.hypot(
            MAX_EXPLAINED_RATIO * self.expected, INEXACT_EQUATION_SHARE * self.before
        )
        with np.errstate(invalid="ignore"):
            return np.asarray(errors / allowed)

    def unexplained_states(self) -> list[str]:
        """Return the states whose error the model does not explain, the largest ratio first."""
        largest = np.nan_to_num(self.explained_ratio()).max(axis=0)
        return [STATE_NAMES[i] for i in np.argsort(-largest) if largest[i] > 1.0]

    @property
    def is_explained(self) -> bool:
        """Whether all errors are explained."""
        return not self.unexplained_states()

    def at(self, values: FloatArray, horizon: int = REPORTED_HORIZON) -> dict[str, float]:
        """Return one horizon of `values` (horizons, 3) by state."""
        return dict(zip(STATE_NAMES, (float(x) for x in values[horizon]), strict=True))


def without_sensor_faults(log: SensorLog, effects: Sequence[ActiveEffect]) -> SensorLog:
    """
    Return a recording from which identified faults of odometry and clock are removed.

    The gyro's yaw rate takes the place of a filtered one. Faults of the IMU do not enter open-loop
    predictions.
    """
    for active in effects:
        values = active.values()
        if active.effect.name == "odometry_scale":
            share = _weight(active.activation, log.odometry_s)
            odometry = log.odometry.copy()
            odometry[:, 0] /= 1.0 + share * (values["scale"] - 1.0)
            log = replace(log, odometry=odometry)
        elif active.effect.name == "clock_offset":
            share = _weight(active.activation, log.command_s)
            stamps = log.command_s + share * values["offset"]
            log = replace(log, command_s=np.maximum.accumulate(stamps))
        elif active.effect.name == "odometry_filter" and log.imu_s.size:
            share = _weight(active.activation, log.odometry_s)
            gyro = np.interp(log.odometry_s, log.imu_s, log.imu[:, 2])
            odometry = log.odometry.copy()
            odometry[:, 2] += share * (gyro - odometry[:, 2])
            log = replace(log, odometry=odometry)
    return log


def unjudged_states(effects: Sequence[ActiveEffect]) -> list[str]:
    """Return the states whose measurement an identified sensor fault makes unusable."""
    return ["yaw_rate"] if any(a.effect.name == "odometry_filter" for a in effects) else []


def _weight(activation: Activation, at_s: FloatArray) -> FloatArray:
    """Return one where a sensor fault acts, by time; faults have no places."""
    if activation.onset_s is None:
        return np.ones(at_s.shape[0])
    return (at_s >= activation.onset_s).astype(np.float64)
