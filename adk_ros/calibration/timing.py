# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Time offsets between the streams, and channels that are low-passed.

A yaw rate that lags another is a stream with late stamps only if the other channels of that
stream lag as much; a first-order low-pass is told from a delay by its amplitude (`lag`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from adk_ros.calibration.criteria import MATERIAL, SIGNIFICANCE
from adk_ros.calibration.finding import Finding, Verdict, judged, not_decidable
from adk_ros.calibration.grid import Signals, by_speed
from adk_ros.calibration.lag import Lag, lag_between
from adk_ros.calibration.regression import Estimate
from adk_ros.numerics.arrays import FloatArray

_REMEDY_FILTER = "no parameter for this yet: publish the unfiltered signal; it is no delay"
_REMEDY_OFFSET = "the gyro does not confirm it: correct the stamps of the recording"
_REMEDY_BOTH = "the delay that is proposed for the gyro corrects both"


def check_timing(s: Signals) -> Iterator[Finding]:
    """Yield the findings on the lag of odometry's yaw rate and on the IMU's time offset."""
    reference, name = s.yaw_rate, "odometry's yaw rate"
    if s.yaw_rate is not None and s.heading_rate is not None:
        of_heading = "the rate of its heading"
        found = list(_pair(s, s.heading_rate, s.yaw_rate, "odometry_yaw_rate", name, of_heading))
        yield from found
        if any(x.verdict is not Verdict.OK for x in found):
            reference, name = s.heading_rate, "the rate of odometry's heading"
    elif s.heading_rate is not None:
        reference, name = s.heading_rate, "the rate of odometry's heading"
    by_gyro = None
    if s.gyro is not None and reference is not None:
        by_gyro = lag_between(reference, s.gyro, by_speed(s))
        yield from _of_gyro(by_gyro, name)
    yield from _of_accelerometer(s, by_gyro)


def _pair(
    s: Signals, x: FloatArray, y: FloatArray, name: str, title: str, reference: str
) -> Iterator[Finding]:
    """Yield the finding on the lag of a signal behind another of the same stream."""
    # A heading that follows the course has an error in proportion to 1 / v_x.
    lag = lag_between(x, y, by_speed(s))
    evidence = f"correlation of {title} with {reference} over delays and low-pass filters"
    if lag is None:
        yield not_decidable(f"{name}_lag", "the signals do not match well enough", evidence)
        return
    yield from _judged_lag(lag, name, title, reference, evidence)


def _judged_lag(
    lag: Lag, name: str, title: str, reference: str, evidence: str
) -> Iterator[Finding]:
    evidence += f"; correlation {lag.correlation:.4f} once aligned"
    if lag.form in ("filter", "both"):
        who, of = (title, reference) if lag.filter.value > 0.0 else (reference, title)
        text = f"{who} is low-passed against {of}, time constant in s"
        estimate = lag.filter if lag.filter.value > 0.0 else _negated(lag.filter)
        yield judged(
            f"{name}_filter", estimate, 0.0, text, evidence, kind="filter", remedy=_REMEDY_FILTER
        )
        if lag.form == "filter":
            return
    if lag.form == "lag" and _is_material(lag.total):
        total = lag.total
        yield Finding(
            f"{name}_lag",
            Verdict.FINDING,
            f"{title} lags {reference} by {total.value:.3f} s ({total.low:.3f} to "
            f"{total.high:.3f}); whether by a delay or by a filter is not decidable, because "
            "both explain the data about equally well",
            total.value,
            total.low,
            total.high,
            "s",
            0.0,
            abs(total.value) / max(total.standard_error, 1e-12),
            evidence,
            total.seconds,
            remedy=_REMEDY_FILTER,
        )
        return
    text = f"{title} is later than {reference}, delay in s"
    estimate = lag.delay if lag.form in ("delay", "both") else lag.total
    yield judged(
        f"{name}_delay",
        estimate,
        0.0,
        text,
        evidence,
        kind="time_offset",
        remedy=_REMEDY_OFFSET,
    )


def _of_gyro(lag: Lag | None, reference: str) -> Iterator[Finding]:
    evidence = f"correlation of the gyro with {reference} over delays and low-pass filters"
    if lag is None:
        reason = "the gyro and odometry's rotation do not match well enough"
        yield not_decidable("imu_time_offset", reason, evidence)
        return
    for finding in _judged_lag(lag, "gyro", "the gyro", reference, evidence):
        yield _with_delay(finding)


def _of_accelerometer(s: Signals, by_gyro: Lag | None) -> Iterator[Finding]:
    """Yield the time offset of the accelerometer, by a_x, or by a_y where a_x does not tell."""
    if s.a is None or s.longitudinal is None or s.lateral is None:
        return
    lags = [
        (title, reference, lag)
        for title, reference, lag in (
            ("a_x", "dv_x/dt - v_y r", lag_between(s.longitudinal, s.a[0], s.moving)),
            ("a_y", "v_x r + dv_y/dt", lag_between(s.lateral, s.a[1], s.moving)),
        )
        if lag is not None
    ]
    evidence = "correlation of a_x, a_y with odometry's acceleration over delays and filters"
    if not lags:
        reason = "the accelerations do not follow odometry well enough (slope, bank, vibration)"
        yield not_decidable("accelerometer_time_offset", reason, evidence)
        return
    # An IMU ahead of odometry's point has a_y + dr/dt x, which looks like an early a_y.
    title, reference, lag = lags[0]
    same = False
    if by_gyro is not None and _is_material(by_gyro.total) and _is_material(lag.total):
        same = abs(by_gyro.total.value - lag.total.value) < max(
            MATERIAL["time_offset"].size,
            SIGNIFICANCE * float(np.hypot(by_gyro.total.standard_error, lag.total.standard_error)),
        )
        if same:
            evidence += "; the gyro lags as much, so the stamps of the whole IMU are late"
    for finding in _judged_lag(lag, "accelerometer", f"the IMU's {title}", reference, evidence):
        if by_gyro is None:
            yield _with_delay(finding)
        elif same and finding.remedy == _REMEDY_OFFSET:
            yield replace(finding, remedy=_REMEDY_BOTH)
        else:
            yield finding


def _with_delay(finding: Finding) -> Finding:
    """Return a finding on the IMU's delay with its parameter: of the stream that is late."""
    if finding.verdict is not Verdict.FINDING or not finding.name.endswith("_delay"):
        return finding
    assert finding.value is not None
    late = "imu_delay" if finding.value > 0.0 else "odometry_delay"
    return replace(finding, parameters={late: abs(finding.value)}, remedy="")


def _is_material(total: Estimate) -> bool:
    is_large = abs(total.value) >= MATERIAL["time_offset"].size
    return is_large and abs(total.value) >= SIGNIFICANCE * total.standard_error


def _negated(estimate: Estimate) -> Estimate:
    return Estimate(
        -estimate.value,
        estimate.standard_error,
        -estimate.high,
        -estimate.low,
        estimate.seconds,
    )
