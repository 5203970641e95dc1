# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
All checks of one recording, in the order in which one fault would hide another.

Streams first (gaps, frozen readings), then signs and units of the odometry, the axes of the IMU,
signs and units of the gyro and the steering; each is corrected before the next. Scales, offsets,
positions and lags are estimated on the corrected streams.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from adk_ros.calibration.continuity import Interval
from adk_ros.calibration.course import check_course
from adk_ros.calibration.criteria import MIN_MOVING_S
from adk_ros.calibration.drive_command import check_torque
from adk_ros.calibration.finding import Finding, Verdict, found, not_decidable, undecided
from adk_ros.calibration.from_bag import BagContent
from adk_ros.calibration.grid import Signals, on_grid, shifted
from adk_ros.calibration.height import check_heights
from adk_ros.calibration.height_slope import HeightSlope
from adk_ros.calibration.imu_axes import check_axes, check_gravity
from adk_ros.calibration.imu_calibration import check_imu
from adk_ros.calibration.known_errors import with_known_errors
from adk_ros.calibration.odometry_calibration import check_odometry_scale, check_yaw_rates
from adk_ros.calibration.pedals import check_pedals
from adk_ros.calibration.reference_point import check_reference_point
from adk_ros.calibration.road import check_road
from adk_ros.calibration.satellite import check_receiver
from adk_ros.calibration.signs_and_units import (
    check_gyro,
    check_odometry,
    independent_turning,
)
from adk_ros.calibration.steering import check_sign, check_steering
from adk_ros.calibration.stream_checks import check_streams
from adk_ros.calibration.streams import Streams
from adk_ros.calibration.timing import check_timing
from adk_ros.calibration.wheel_radius import check_joints, check_wheels
from adk_ros.numerics.similarity import length_scale
from adk_ros.plant.vehicle.vehicle_parameters import Dimensions
from adk_ros.road.profile import RoadProfile
from adk_ros.signals.commands import COMMAND_TYPES
from adk_ros.signals.decode import SensorConfig

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class CheckResult:
    """
    What the checks say about a recording.

    `findings` in the order of the checks; `parameters`: proposed values by name, which replace
    those that the recording was read with; `advice`: one line on what to do next. `road`: grade
    and bank along the way, None where they are not decidable; `heights`: what a recorded height
    says of the grade, by its source.
    """

    findings: list[Finding]
    parameters: dict[str, Any]
    advice: str
    road: RoadProfile | None = None
    heights: Mapping[str, HeightSlope] = field(default_factory=dict)

    def corrected(self, sensors: SensorConfig) -> SensorConfig:
        """
        Return the configuration that a recording was read with, with the proposed parameters.

        :raises UsageError: they contradict each other or what is known.
        """
        changes: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value
            for name, value in self.parameters.items()
        }
        return replace(sensors, **changes)

    def of(self, verdict: Verdict) -> list[Finding]:
        """Return the findings with a verdict."""
        return [x for x in self.findings if x.verdict is verdict]


_SCALE = "odometry_scale"
_AXLES = frozenset({"cg_to_front_axle", "cg_to_rear_axle"})


def check(
    content: BagContent,
    vehicle: Dimensions | None = None,
    progress: Progress | None = None,
    assumed: Collection[str] = (),
) -> CheckResult:
    """
    Return the findings on a recording; a vehicle gives wheelbase, mass and wheel radius.

    :param assumed: names of values of the vehicle that are assumed: no measure for sensors. The
        wheelbase is always known.
    """
    report = progress or (lambda done, total: None)
    findings = _command(content, None if "wheel_radius" in assumed else vehicle)
    wheelbase = _wheelbase(vehicle)
    size = 1.0 if wheelbase is None else length_scale(wheelbase)
    faults = check_streams(content.streams, size)
    findings += faults.findings
    streams, sensors, coarse = correct_signs(content, faults.unusable, vehicle)
    findings += coarse
    report(1, 3)
    # Gaps of the command do not matter to the road.
    sensed = check_streams(replace(content.streams, command=None), size).unusable
    on_road, road = check_road(streams, sensed)
    on_heights, heights = check_heights(road, streams)
    on_road += on_heights
    report(2, 3)
    s = on_grid(streams, faults.unusable)
    if s is None or s.moving_s < MIN_MOVING_S:
        moving_s = 0.0 if s is None else s.moving_s
        reason = (
            f"only {moving_s:.1f} s of driving are covered by all streams and free of faults; "
            f"{MIN_MOVING_S:g} s are needed"
        )
        findings += [not_decidable("calibration", reason), *on_road]
        return replace(_result(findings, content, road), heights=heights)
    fine, _ = with_known_errors(_fine(s, (streams, sensors), vehicle, assumed, content), sensors)
    findings += [*fine, *on_road]
    report(3, 3)
    return replace(_result(findings, content, road), heights=heights)


def correct_signs(
    content: BagContent, unusable: list[Interval], vehicle: Dimensions | None
) -> tuple[Streams, SensorConfig, list[Finding]]:
    """Return the streams with axes, signs and units corrected, and the findings on them."""
    streams, sensors = content.streams, content.sensors
    findings: list[Finding] = []
    s = on_grid(streams, unusable)
    if s is None:
        text = "the stamps of the streams do not overlap: they are of different clocks"
        remedy = "stamp all messages with one clock"
        if not streams.present():
            text = "no stream has ten messages with usable stamps"
            remedy = "fill header.stamp of every message, and record longer"
        findings.append(found("clocks", text, "first and last stamps", remedy=remedy))
        return streams, sensors, findings
    # A speed in km/h is no standstill, but one without any motion has nothing to compare.
    if s.moving_s < MIN_MOVING_S:
        return streams, sensors, findings
    for finding, corrected in check_odometry(streams, s):
        findings.append(finding)
        streams = corrected
    s = _again(streams, unusable, s)
    found_here, streams = check_gravity(streams, s)
    findings += found_here
    s = _again(streams, unusable, s)
    # A gyro whose sign is wrong must not say which way a_y points.
    by_pose = replace(s, heading_rate=independent_turning(s))
    found_here, streams = check_axes(streams, by_pose, sensors)
    findings += found_here
    s = _again(streams, unusable, s)
    for finding, corrected in check_gyro(streams, s):
        findings.append(finding)
        streams = corrected
    findings, sensors = with_known_errors(findings, sensors)
    s = _again(streams, unusable, s)
    found_here, streams, sensors = check_sign(
        streams, s, sensors, _wheelbase(vehicle), content.command_type
    )
    return streams, sensors, findings + found_here


def _again(streams: Streams, unusable: Iterable[Interval], before: Signals) -> Signals:
    return on_grid(streams, unusable) or before


def _wheelbase(vehicle: Dimensions | None) -> float | None:
    return None if vehicle is None else vehicle.cg_to_front_axle + vehicle.cg_to_rear_axle


def _fine(
    s: Signals,
    corrected: tuple[Streams, SensorConfig],
    vehicle: Dimensions | None,
    assumed: Collection[str],
    content: BagContent,
) -> list[Finding]:
    """Return the findings on scales, offsets, positions and lags."""
    streams, sensors = corrected
    axles = vehicle if _AXLES.isdisjoint(assumed) else None
    wheelbase = _wheelbase(vehicle)
    known_size = None if wheelbase is None else length_scale(wheelbase)
    size = known_size or 1.0
    timing = list(check_timing(s))
    out = list(check_odometry_scale(s, size))
    # Both find the same scale: composed, it would count twice.
    proposed = {name for finding in out for name in finding.parameters}
    out += [_without(x, proposed) for x in check_receiver(s, streams.gps_speed, sensors)]
    out += [*check_course(s, streams.gps_speed, sensors), *check_yaw_rates(s), *timing]
    late = {x.name for x in timing if x.verdict is Verdict.FINDING}
    if any(name.startswith("odometry_yaw_rate") for name in late):
        # No reference and no instrument for what follows.
        s = replace(s, yaw_rate=None)
    positions = list(check_imu(_aligned(s, timing), sensors, size))
    out += [_unless_filtered(x, late) for x in positions]
    points = list(check_reference_point(s, sensors, axles))
    is_known = not any(x.verdict is Verdict.FINDING for x in points)
    out += points
    # What follows is relative to a speed whose scale is proposed: it must not be found twice.
    s = _with_speed_scale(s, out)
    steering = check_steering(
        s, sensors, axles if is_known else None, wheelbase, content.command_type
    )
    out += [_unless_offset(x, late) for x in steering]
    radius = None if vehicle is None or "wheel_radius" in assumed else vehicle.wheel_radius
    mass = None if vehicle is None else vehicle.mass
    if streams.command is not None and content.command_type == "joint_state":
        if content.joints.is_torque_estimated:
            out.append(not_decidable("torque", "the map of the import estimated it from pedals"))
        else:
            out += check_torque(s, mass, radius)
        out += check_joints(s, streams.wheels, radius)
    out += check_wheels(s, streams.wheel_speeds, radius)
    out += check_pedals(s, streams, mass, radius, known_size)
    return out


def _with_speed_scale(s: Signals, findings: Iterable[Finding]) -> Signals:
    """Return signals with v_x and v_y divided by the scale that a finding proposes."""
    scales = [float(x.parameters[_SCALE]) for x in findings if _SCALE in x.parameters]
    if not scales:
        return s
    v_x, v_y = (None if v is None else v / scales[0] for v in (s.v_x, s.v_y))
    return replace(s, v_x=v_x, v_y=v_y)


def _aligned(s: Signals, timing: list[Finding]) -> Signals:
    """Return signals with the IMU moved in time by the delays that were found."""
    delays = {x.name: x.value for x in timing if x.verdict is Verdict.FINDING and x.value}
    by_gyro, by_accelerometer = delays.get("gyro_delay"), delays.get("accelerometer_delay")
    if by_gyro and s.w is not None:
        s = replace(s, w=np.vstack([shifted(axis, -by_gyro) for axis in s.w]))
    if by_accelerometer and s.a is not None:
        s = replace(s, a=np.vstack([shifted(axis, -by_accelerometer) for axis in s.a]))
    return s


def _without(finding: Finding, names: Collection[str]) -> Finding:
    """Return a finding that does not propose these parameters."""
    left = {name: value for name, value in finding.parameters.items() if name not in names}
    if len(left) == len(finding.parameters):
        return finding
    return replace(finding, parameters=left, remedy="" if left else "proposed by another check")


def _unless_filtered(finding: Finding, late: set[str]) -> Finding:
    """Return a finding on the IMU, undecided where a filter of a stream looks the same."""
    is_position = finding.name == "imu_position" and finding.verdict is Verdict.FINDING
    filtered = sorted(name for name in late if name.endswith(("_filter", "_lag")))
    if is_position and any(not name.startswith("odometry_yaw_rate") for name in filtered):
        return undecided(finding, "a low-pass filter of the IMU or of odometry looks the same")
    return finding


def _unless_offset(finding: Finding, late: set[str]) -> Finding:
    """Return a finding on the steering, undecided where IMU and odometry disagree on time."""
    is_delay = finding.name == "steering_delay" and finding.verdict is Verdict.FINDING
    if is_delay and late & {"gyro_delay", "gyro_lag", "accelerometer_delay"}:
        reason = "IMU and odometry are offset in time: correct that first"
        return undecided(finding, reason)
    return finding


def _command(content: BagContent, vehicle: Dimensions | None) -> list[Finding]:
    """Return the findings on the type of the command and the names of its joints."""
    if not content.command_type:
        return []
    out = []
    if content.command_type != content.sensors.command_type:
        proposal: dict[str, Any] = {"command_type": content.command_type}
        kind = COMMAND_TYPES[content.command_type]
        if kind.inferred_torque:
            proposal |= (
                {}
                if vehicle is None
                else {"mass": vehicle.mass, "wheel_radius": vehicle.wheel_radius}
            )
        text = f"the command is of type {kind.msgtype}, not {content.sensors.command_type}"
        usable = not kind.inferred_torque or vehicle is not None
        remedy = "give --vehicle: mass and wheel radius are needed with it"
        out.append(
            found("command_type", text, "types of the topics", proposal if usable else {}, remedy)
        )
    proposal = content.joints.proposal(content.sensors)
    if content.command_type == "joint_state" and proposal:
        named = ", ".join(content.joints.names())
        text = f"the configured joints are absent; the command has {named}"
        out.append(found("joints", text, "names in the command", proposal))
    return out


def _result(findings: list[Finding], content: BagContent, road: RoadProfile | None) -> CheckResult:
    parameters: dict[str, Any] = {}
    for finding in findings:
        parameters |= finding.parameters
    return CheckResult(findings, parameters, _advice(findings, parameters), road)


def _advice(findings: list[Finding], parameters: dict[str, Any]) -> str:
    count = sum(x.verdict is Verdict.FINDING for x in findings)
    if not count:
        open_checks = sum(x.verdict is Verdict.NOT_DECIDABLE for x in findings)
        return "nothing to correct" + (
            f"; {open_checks} checks are not decidable with this recording" if open_checks else ""
        )
    if parameters:
        names = ", ".join(parameters)
        return (
            f"write {names} with --out params.yaml, check again with --params params.yaml, then "
            "use it for train, replay and the node, and as --recording-params of mismatch"
        )
    return "correct the recording where a finding says so, then check again"
