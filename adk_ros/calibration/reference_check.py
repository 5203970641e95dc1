# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Which sensor or steering parameter has changed against a reference recording of the same vehicle.

Both recordings may have errors of calibration; only their difference is a finding.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from adk_ros.calibration.change import Change, Comparison, FaultFit, compare
from adk_ros.calibration.check import correct_signs
from adk_ros.calibration.criteria import MIN_BLOCK_S, MIN_SPARE_BLOCKS
from adk_ros.calibration.faults import REFERENCE_WHEELBASE, Fault
from adk_ros.calibration.finding import Finding, Verdict, not_decidable, shown
from adk_ros.calibration.from_bag import BagContent
from adk_ros.calibration.grid import Signals, on_grid
from adk_ros.calibration.relations import smoothed
from adk_ros.calibration.stream_checks import check_streams
from adk_ros.numerics.constants import QUANTILE_90
from adk_ros.plant.vehicle.vehicle_parameters import Dimensions

_MIN_WHEELBASE, _MAX_WHEELBASE = 0.1, 15.0
"""m: from a 1:24 car to an articulated bus."""

_EVIDENCE = (
    "the fault without which the relations between the channels are those of the reference: {}"
)


@dataclass(frozen=True)
class ReferenceCheck:
    """
    What has changed against a reference.

    `findings`: changes first, then what is unchanged or not decidable. `comparison`: None where
    one of the recordings is too short, or their streams do not overlap. `advice`: what to do next.
    """

    findings: list[Finding]
    comparison: Comparison | None
    advice: str

    def of(self, verdict: Verdict) -> list[Finding]:
        """Return the findings with a verdict."""
        return [x for x in self.findings if x.verdict is verdict]


@dataclass(frozen=True)
class Prepared:
    """
    A recording ready for comparison.

    `signals`: with signs corrected, smoothed for their derivatives; None where the streams do not
    overlap. `signs`: what was corrected. `wheelbase`: m, by the steering.
    """

    signals: Signals | None
    signs: list[Finding]
    wheelbase: float


def prepared(content: BagContent) -> Prepared:
    """Return a recording ready for comparison."""
    faults = check_streams(content.streams)
    # Without a vehicle, so that the ratio of the steering is left as it is.
    streams, _, signs = correct_signs(content, faults.unusable, None)
    signals = on_grid(streams, faults.unusable)
    if signals is None:
        return Prepared(None, signs, REFERENCE_WHEELBASE)
    return Prepared(smoothed(signals), signs, _wheelbase(signals))


def check_against(
    reference: Prepared, tested: Prepared, vehicle: Dimensions | None = None
) -> ReferenceCheck:
    """
    Return what has changed from the reference to the tested recording of the same vehicle.

    :param vehicle: gives the wheelbase; without one it follows from the steering of the reference.
    """
    known, seen = reference.signals, tested.signals
    findings = _changed_signs(reference.signs, tested.signs)
    least_s = MIN_SPARE_BLOCKS * MIN_BLOCK_S
    for s, title in ((known, "the reference"), (seen, "the recording")):
        if s is None or s.moving_s < least_s:
            moving_s = 0.0 if s is None else s.moving_s
            reason = (
                f"{title} has {moving_s:.1f} s of driving that all streams cover; {least_s:g} s "
                "are needed"
            )
            findings.append(not_decidable("calibration", reason))
    if known is None or seen is None or any(x.name == "calibration" for x in findings):
        return ReferenceCheck(findings, None, "record more driving")
    wheelbase = reference.wheelbase
    if vehicle is not None:
        wheelbase = vehicle.cg_to_front_axle + vehicle.cg_to_rear_axle
    comparison = compare(known, seen, wheelbase)
    findings += [_of_change(change, comparison) for change in comparison.changes]
    findings += [_of_other(fit, comparison) for fit in comparison.others]
    findings += [_of_missing(fault) for fault in comparison.missing]
    return ReferenceCheck(findings, comparison, _advice(findings))


def _changed_signs(known: list[Finding], seen: list[Finding]) -> list[Finding]:
    """Return the corrections of signs, units or axes that only one of two recordings needs."""
    before, now = ({x.name: x for x in signs} for signs in (known, seen))
    decided = [
        name
        for name in dict.fromkeys([*now, *before])
        if all(name in x and x[name].verdict is not Verdict.NOT_DECIDABLE for x in (before, now))
    ]
    out = []
    for name in decided:
        if now[name].verdict is Verdict.FINDING:
            if before[name].verdict is Verdict.OK or _said(before[name]) != _said(now[name]):
                out.append(now[name])
        elif before[name].verdict is Verdict.FINDING:
            text = f"no longer so: {before[name].text}"
            out.append(Finding(name, Verdict.FINDING, text, evidence=before[name].evidence))
    return out


def _said(finding: Finding) -> str:
    """Return what a finding says without its estimates, which differ between recordings."""
    return re.sub(r"-?\d+(\.\d+)?", "", finding.text)


def _wheelbase(s: Signals) -> float:
    """Return the steering angle by curvature, m; that of a passenger car if it is none."""
    if s.steering is None or s.v_x is None or s.turning is None:
        return REFERENCE_WHEELBASE
    w = s.moving
    power = float(w @ s.turning**2)
    length = abs(float(w @ (s.v_x * s.steering * s.turning))) / max(power, 1e-12)
    return length if _MIN_WHEELBASE < length < _MAX_WHEELBASE else REFERENCE_WHEELBASE


def _number(fit: FaultFit, value: float) -> str:
    unit = "" if fit.fault.unit == "1" else f" {fit.fault.unit}"
    half = fit.half_width
    low, high = (shown(x, fit.material) for x in (value - half, value + half))
    return f"{shown(value, fit.material)}{unit} ({low} to {high})"


def _of_change(change: Change, comparison: Comparison) -> Finding:
    fit = change.fit
    text = f"{TITLES[fit.fault.label]}: {_number(fit, fit.size)}"
    if change.candidates:
        others = "; ".join(
            f"{x.fault.label} {shown(x.size, x.material)} {x.fault.unit}".removesuffix(" 1")
            for x in change.candidates
        )
        text += f"; explained about as well by {others}"
    if change.is_of_road:
        text = (
            "not decidable, because the recordings are of different courses, whose slope or bank "
            f"looks the same; else {text}"
        )
    elif fit.fault.is_of_road and comparison.is_same_course is None:
        text += "; without poses, another course looks the same"
    verdict = Verdict.NOT_DECIDABLE if change.is_of_road else Verdict.FINDING
    return _finding(fit, verdict, text, comparison)


def _of_other(fit: FaultFit, comparison: Comparison) -> Finding:
    size = shown(fit.material, fit.material)
    unit = "" if fit.fault.unit == "1" else f" {fit.fault.unit}"
    if fit.half_width <= fit.material and abs(fit.change) < fit.material:
        return _finding(fit, Verdict.OK, f"unchanged, {_number(fit, fit.size)}", comparison)
    text = (
        f"not decidable, because a change of {size}{unit} is no larger than what this driving "
        f"leaves open: {_number(fit, fit.size)}; it takes {fit.fault.excitation}"
    )
    return _finding(fit, Verdict.NOT_DECIDABLE, text, comparison)


def _finding(fit: FaultFit, verdict: Verdict, text: str, comparison: Comparison) -> Finding:
    half = QUANTILE_90 * fit.standard_error
    return Finding(
        fit.fault.label,
        verdict,
        text,
        fit.size,
        fit.size - half,
        fit.size + half,
        fit.fault.unit,
        fit.fault.nominal,
        fit.standard_errors,
        _EVIDENCE.format(", ".join(comparison.relations)),
    )


def _of_missing(fault: Fault) -> Finding:
    reason = (
        f"the recordings lack the channels or the length for {', '.join(fault.needs)}; it takes "
        f"{fault.excitation}"
    )
    return not_decidable(fault.label, reason)


def _advice(findings: list[Finding]) -> str:
    changed = [x.name for x in findings if x.verdict is Verdict.FINDING]
    open_ones = [x.name for x in findings if x.verdict is Verdict.NOT_DECIDABLE]
    if changed:
        return f"changed: {', '.join(changed)}; correct the sensor or its parameters"
    rest = f"; not decidable: {', '.join(open_ones)}" if open_ones else ""
    return f"nothing changed{rest}"


TITLES = {
    "imu_bias.a_x": "a_x reads more by",
    "imu_bias.a_y": "a_y reads more by",
    "imu_bias.gyro": "the gyro reads more by",
    "imu_tilt.roll": "the IMU has rolled by",
    "imu_tilt.pitch": "the IMU has pitched by",
    "imu_lever_arm.x": "the IMU sits further ahead by",
    "imu_lever_arm.y": "the IMU sits further to the left by",
    "imu_delay": "the stamps of the IMU are later by",
    "odometry_scale": "odometry's velocity has the factor",
    "gyro_scale": "the gyro has the factor",
    "odometry_filter": "odometry's yaw rate is low-passed more, time constant",
    "clock_offset": "the commands act later than their stamps by",
    "steering_delay": "the steering acts later by",
    "steering_offset": "straight ahead the steering angle is larger by",
    "steering_ratio": "the steering angle of the same bend has the factor",
}
"""What a change of each fault says, before its number."""
