# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What a recording allows: what can be predicted, judged and calibrated, what not, and why.

A missing channel reduces the scope; nothing but a parked car or a very short drive ends it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

from adk_ros.calibration.criteria import MIN_MOVING_S
from adk_ros.calibration.from_bag import BagContent
from adk_ros.calibration.informative import Informative, implied_length_scale, informative
from adk_ros.calibration.stream_checks import check_streams
from adk_ros.calibration.streams import Streams
from adk_ros.numerics.similarity import time_scale
from adk_ros.road.recorded_drive import MIN_STEPS, STEP_S
from adk_ros.train.train_settings import MIN_TRAINING_S

MIN_JUDGED_S = 30.0
"""
s of driving that `adk mismatch` needs, equal to `mismatch.recording.checks.MIN_DURATION_S` of a
full-size car, which no module of this layer may import.
"""
TOO_SHORT = f"training needs {MIN_TRAINING_S:g} s in all"
"""Why a recording alone is too short to train on: others can complete it."""
MIN_ROAD_S = MIN_STEPS * STEP_S
"""s of driving from which the road has a profile."""


class Possible(str, Enum):
    """How far a recording allows something."""

    YES = "yes"
    REDUCED = "reduced"
    NO = "no"


@dataclass(frozen=True)
class Scope:
    """
    One row: `name` of what is wanted, how far it is `possible`, `why` not more.

    `needs`: the channel that would allow more; both are empty where it is fully possible.
    """

    name: str
    possible: Possible
    why: str = ""
    needs: str = ""

    def as_dict(self) -> dict[str, str]:
        """Return the row for JSON."""
        return {
            "name": self.name,
            "possible": self.possible.value,
            "why": self.why,
            "needs": self.needs,
        }


Reason = tuple[str, str]
"""Why something is not possible, empty if it is, and which channel would allow it."""


def scope_of(content: BagContent, length_scale: float | None = None) -> list[Scope]:
    """
    Return what a recording allows, row by row.

    :param length_scale: of the vehicle (`numerics.similarity`); None: that which steering and
        curvature imply.
    """
    estimated = content.joints.is_torque_estimated
    return scope_of_streams(content.streams, content.command_type, length_scale, estimated)


def scope_of_streams(
    streams: Streams,
    command_type: str,
    length_scale: float | None = None,
    is_torque_estimated: bool = False,
) -> list[Scope]:
    """
    Return what the streams of a recording allow, row by row.

    :param command_type: key of `signals.commands.COMMAND_TYPES`, empty without a command.
    :param length_scale: of the vehicle: a comparison needs less driving of a scale model. None:
        that which steering and curvature imply.
    :param is_torque_estimated: whether the torque was estimated from the motion.
    """
    if length_scale is None:
        length_scale = implied_length_scale(streams.odometry, streams.command, streams.imu)
    faults = check_streams(streams)
    about = informative(
        streams, faults.unusable, command_type, length_scale < 1.0, is_torque_estimated
    )
    judged = _judge(about, MIN_JUDGED_S * time_scale(length_scale))
    return [*_predict(about), *judged, *_road(about), _calibration(about)]


def common_scope(each: Sequence[Sequence[Scope]]) -> list[Scope]:
    """Return the rows of several recordings that are analysed jointly: the least of each."""
    order = list(Possible)
    by_name = zip(*each, strict=True)
    return [max(rows, key=lambda row: order.index(row.possible)) for rows in by_name]


def _row(name: str, required: list[Reason], desired: list[Reason]) -> Scope:
    """Return the row of something that requires some reasons to be empty and desires others."""
    for possible, reasons in ((Possible.NO, required), (Possible.REDUCED, desired)):
        open_reasons = [each for each in reasons if each[0]]
        if open_reasons:
            # One missing stream may be the reason for several channels.
            whys, needs = (dict.fromkeys(each) for each in zip(*open_reasons, strict=True))
            return Scope(name, possible, "; ".join(whys), "; ".join(needs))
    return Scope(name, Possible.YES)


def _drive(about: Informative, least_s: float) -> Reason:
    if about.driving_s >= least_s:
        return "", ""
    if about.driving_s == 0.0:
        return "the car does not move", f"a drive of {least_s:.3g} s"
    return f"the car moves for {about.driving_s:.0f} s only", f"a drive of {least_s:.3g} s"


def _v_x(about: Informative) -> Reason:
    return about.v_x, "v_x of odometry, wheels or a satellite receiver"


def _v_y(about: Informative) -> Reason:
    return about.v_y, "v_y of an inertial navigation system or an optical sensor"


def _yaw_rate(about: Informative) -> Reason:
    return about.yaw_rate, "a gyro"


def _steering(about: Informative) -> Reason:
    return about.steering, "the steering angle"


def _predict(about: Informative) -> list[Scope]:
    always = [_drive(about, MIN_MOVING_S), _v_x(about)]
    short = "" if about.driving_s >= MIN_TRAINING_S else TOO_SHORT
    further = [(short, "further recordings")]
    return [
        _row("predict v_x", always, [*further, (about.drive, "wheel torque or pedal")]),
        _row("predict v_y", [*always, _v_y(about)], [*further, _steering(about)]),
        _row("predict yaw rate", [*always, _yaw_rate(about)], [*further, _steering(about)]),
    ]


def _judge(about: Informative, least_s: float) -> list[Scope]:
    always = [_drive(about, least_s), _v_x(about)]
    imu = (about.imu, "an IMU")
    drive = (about.drive, "wheel torque")
    torque = (about.torque if not about.drive else "", "wheel torque in N·m")
    return [
        _row("judge v_x", [*always, drive], [torque, imu]),
        _row("judge v_y", [*always, _v_y(about), _steering(about)], [imu]),
        _row("judge yaw rate", [*always, _yaw_rate(about), _steering(about)], [imu]),
    ]


def _road(about: Informative) -> list[Scope]:
    sensors = (about.road, "an IMU with gravity, and v_x")
    required = [_drive(about, MIN_ROAD_S), sensors]
    pose = f"the level is uncertain: {about.pose}" if about.pose else ""
    if about.has_attitude:
        # It has a level, and `mismatch` takes the slopes from it.
        pose = ""
    sideways = "" if not about.v_y else f"v_y is assumed: {about.v_y}"
    assumed = (sideways, _v_y(about)[1])
    return [
        _row("grade", required, [(pose, "a pose"), assumed]),
        _row("bank", required, [assumed]),
    ]


def _calibration(about: Informative) -> Scope:
    desired = [
        (about.imu, "an IMU"),
        (about.pose, "a pose"),
        _v_x(about),
        _v_y(about),
        _steering(about),
        (about.torque, "wheel torque in N·m"),
    ]
    return _row("calibration", [_drive(about, MIN_MOVING_S)], desired)
