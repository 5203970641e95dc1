# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Signals in physical units: measured, and predicted open loop 1 s ahead by two models.

Each value is the mean over the last 40 ms of a prediction, and of the samples of the same 40 ms.
Predictions begin every 0.1 s from the state that follows odometry up to there
(`open_loop.OpenLoopPredictor`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import yaml  # type: ignore[import-untyped, unused-ignore]

from adk_ros.errors import DataError
from adk_ros.files.yaml_file import validate
from adk_ros.mismatch.deployment.held_out import Evidence
from adk_ros.mismatch.deployment.open_loop import STEP_S
from adk_ros.mismatch.deployment.prediction_starts import FIRST_START_S, start_times_of
from adk_ros.mismatch.deployment.surrogate_file import SurrogateFile
from adk_ros.mismatch.inference.signal_fit import SIGNALS, PredictedSignals
from adk_ros.mismatch.library.criteria import MIN_SPEED
from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.surrogate.run_inputs import RunBuffers
from adk_ros.mismatch.surrogate.state_index import (
    A_X,
    A_Y,
    V_X,
    V_Y,
    YAW_ACCELERATION,
    YAW_RATE,
)
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.channels import TICK_NS

AHEAD_S = 1.0
"""Horizon of the predictions, s: that of the errors reported first."""
STRIDE_S = 0.1
"""Interval between the starts of predictions, s."""
AVERAGED_S = 0.04
"""Time over which samples and predictions are averaged, s: a residual bin."""


def predicted_signals(
    models: tuple[str, str], item: Evidence, source: str, not_judged: Sequence[str] = ()
) -> PredictedSignals | None:
    """
    Return the signals of held-out data, predicted by simulation and corrected model.

    `models`: the YAML texts of both; `not_judged`: signals that the recorded channels say nothing
    about. None if no prediction fits into the data.
    """
    log, ticks = item.log, _ticks()
    try:
        starts = start_times_of(log, ticks, STRIDE_S, max(item.from_s, FIRST_START_S))
    except DataError:
        return None
    starts = starts[starts + AHEAD_S <= item.until_s]
    if not starts.size:
        return None
    at_s = starts + AHEAD_S
    moving = np.interp(at_s, log.odometry_s, np.abs(log.odometry[:, 0])) > log.similar(MIN_SPEED)
    hidden = ~moving[None, :] | np.isin(SIGNALS, list(not_judged))[:, None]
    first, second = (np.where(hidden, np.nan, _predicted(x, item, starts)) for x in models)
    count = np.maximum(np.round(AVERAGED_S / np.array(_periods(log))), 1.0)
    sigma = log.noise()
    return PredictedSignals(
        source,
        at_s - 0.5 * AVERAGED_S,
        np.where(hidden, np.nan, _measured(log, at_s)),
        first,
        second,
        np.array([*sigma[3:], *sigma[:2]]) / np.sqrt(count),
    )


def unpredicted_signals(has_torque: bool, has_imu: bool) -> list[str]:
    """Return the signals that a recording without a torque command or an IMU cannot show."""
    hidden = [] if has_torque else ["v_x", "a_x"]
    return hidden if has_imu else [*hidden, "a_x", "a_y"]


def _ticks() -> int:
    return round(AHEAD_S / (TICK_NS * 1e-9))


def _periods(log: SensorLog) -> tuple[float, ...]:
    """Return the sample period of each signal, s; of an absent sensor infinity."""
    imu = float(np.median(np.diff(log.imu_s))) if log.imu_s.size > 1 else np.inf
    return (*[log.odometry_period_s] * 3, imu, imu)


def _predicted(model: str, item: Evidence, starts: FloatArray) -> FloatArray:
    """Return the signals (5, n) as the model of a YAML text predicts them."""
    predictor = item.predictor(validate("model", yaml.safe_load(model), SurrogateFile))
    columns = [
        _at_end(run, predictor.published_yaw_rate(run, float(start)), predictor.parameters)
        for start, run in zip(starts, predictor.runs(starts, _ticks()), strict=True)
    ]
    return np.asarray(np.array(columns).T)


def _at_end(run: RunBuffers, published_rate: FloatArray, p: FloatArray) -> FloatArray:
    """
    Return the signals (5,) at the end of a run, as the sensors measure them.

    `published_rate` (n,): yaw rate that odometry publishes in it.
    """
    last = slice(-round(AVERAGED_S / STEP_S), None)
    mean = run.output[:, last].mean(axis=1)
    rate, turn = mean[YAW_RATE], mean[YAW_ACCELERATION]
    arm_x, arm_y = p[INDEX["arm_x"]], p[INDEX["arm_y"]]
    a_x = mean[A_X] + p[INDEX["bias_a_x"]] - rate**2 * arm_x - turn * arm_y
    a_y = mean[A_Y] + p[INDEX["bias_a_y"]] - rate**2 * arm_y + turn * arm_x
    v_x = mean[V_X] * p[INDEX["odometry_gain"]]
    return np.array([v_x, mean[V_Y], published_rate[last].mean(), a_x, a_y])


def _measured(log: SensorLog, at_s: FloatArray) -> FloatArray:
    """Return the measured signals (5, n): means over the `AVERAGED_S` before each time."""
    odometry = _means(log.odometry_s, log.odometry, at_s)
    imu = _means(log.imu_s, log.imu[:, :2], at_s)
    return np.vstack([odometry, imu])


def _means(stamps: FloatArray, values: FloatArray, at_s: FloatArray) -> FloatArray:
    """Return the mean (k, n) of samples (m, k) in the window before each time; NaN if empty."""
    first = np.searchsorted(stamps, at_s - AVERAGED_S + 1e-6)
    last = np.searchsorted(stamps, at_s + 1e-6)
    total = np.vstack([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    count = (last - first).astype(np.float64)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(((total[last] - total[first]) / count[:, None]).T)
