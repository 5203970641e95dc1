# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Open-loop predictions of recordings that filter the yaw rate, or that lack a torque."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import yaml
from helpers.mismatch_drive import driven, simulated_car

from adk_ros.files.yaml_file import validate
from adk_ros.mismatch.deployment.held_out import REPORTED_HORIZON, Evidence, horizon_errors, rmse
from adk_ros.mismatch.deployment.odometry_signals import with_lag
from adk_ros.mismatch.deployment.predicted_signals import predicted_signals
from adk_ros.mismatch.deployment.surrogate_file import SurrogateFile
from adk_ros.mismatch.deployment.surrogate_writer import surrogate_yaml
from adk_ros.mismatch.inference.signal_fit import SIGNALS
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.numerics.arrays import FloatArray

LAG_S = 0.3
V_X, V_Y, YAW_RATE = range(3)


def text(**changes: float) -> str:
    return surrogate_yaml(simulated_car(**changes))


def errors(evidence: Evidence, **changes: float) -> FloatArray:
    """RMSE (horizons, 3) of the simulated car's model, with changed parameters."""
    model = validate("model", yaml.safe_load(text(**changes)), SurrogateFile)
    return rmse(horizon_errors(model, [evidence]))


def filtered() -> SensorLog:
    """Recording whose odometry low-passes the yaw rate."""
    log = driven()
    odometry = log.odometry.copy()
    rate = log.odometry[:, YAW_RATE]
    odometry[:, YAW_RATE] = with_lag(rate, float(rate[0]), LAG_S, log.odometry_period_s)
    return replace(log, odometry=odometry)


@pytest.mark.parametrize("known_by", ["the recording", "the model"])
def test_a_filtered_yaw_rate_is_predicted_as_it_is_published(known_by: str) -> None:
    """With a filter of 0.3 s, no error was finite before."""
    plain = errors(Evidence(driven()))
    if known_by == "the model":
        found = errors(Evidence(filtered()), odometry_lag=LAG_S)
    else:
        found = errors(Evidence(filtered(), yaw_filter_s=LAG_S))
    # The noise of odometry is larger before its filter, by lag over twice its interval.
    assert np.isfinite(found).all()
    assert found[REPORTED_HORIZON:, YAW_RATE].max() < 2.0 * plain[:, YAW_RATE].max()
    unaware = errors(Evidence(filtered()))
    assert unaware[:, YAW_RATE].max() > 3.0 * found[REPORTED_HORIZON:, YAW_RATE].max()


def test_the_page_shows_the_filtered_yaw_rate() -> None:
    models = text(), text(steer_gain=0.9)
    signals = predicted_signals(models, Evidence(filtered(), 40.0, yaw_filter_s=LAG_S), "the end")
    assert signals is not None
    before, after, _ = signals.fits()[SIGNALS[YAW_RATE]]
    assert before > 90.0
    assert after < before


def test_lateral_motion_is_predicted_at_the_recorded_speed() -> None:
    """Where no torque tells v_x: a model that rolls out by 2 m/s² turns as it should."""
    log = driven()
    plain = errors(Evidence(log))
    lost = errors(Evidence(log), rolling=0.2)
    given = errors(Evidence(log, v_x_is_given=True), rolling=0.2)
    assert lost[-1, V_X] > 3.0
    assert lost[-1, YAW_RATE] > 3.0 * plain[-1, YAW_RATE]
    assert given[:, V_X].max() < plain[:, V_X].max()
    assert given[-1, YAW_RATE] < 0.2 * lost[-1, YAW_RATE]
    np.testing.assert_allclose(given[:, V_Y], plain[:, V_Y], rtol=0.1)
