# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which channels of a recording are informative: measured, varying and plausible while moving."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adk_ros.calibration.auxiliary_hints import of_pedals, of_positions, of_speeds
from adk_ros.calibration.continuity import Interval
from adk_ros.calibration.criteria import MIN_CORRELATION
from adk_ros.calibration.road import missing_for_road
from adk_ros.calibration.streams import Stream, Streams
from adk_ros.numerics.arrays import BoolArray, FloatArray
from adk_ros.numerics.similarity import length_scale
from adk_ros.signals.commands import COMMAND_TYPES
from adk_ros.signals.moving_speed import STANDING_SPEED

MAX_PEDAL = 1.0
"""Largest value of a normalised pedal; a torque in N·m that moves a car exceeds it."""
_SHORTEST_WHEELBASE = 0.09
"""m: that of a 1:28 car is 0.098 m."""
MAX_POSITION = 1e7
"""m: the largest northing of UTM (10 000 km); beyond it no map frame has a place."""


@dataclass(frozen=True)
class Informative:
    """
    What is wrong with each channel, empty where it is informative; and the driving in s.

    Where an auxiliary channel could take the place of one, the text says how.

    `road`: with IMU and v_x, for grade and bank. `torque`: as a torque in N·m; `drive`: as
    anything that drives the car, such as a pedal. `has_attitude`: whether roll and pitch of an
    inertial navigation system are recorded.
    """

    driving_s: float
    v_x: str
    v_y: str
    yaw_rate: str
    steering: str
    torque: str
    drive: str
    pose: str
    imu: str
    road: str
    has_attitude: bool = False


def informative(
    streams: Streams,
    unusable: list[Interval],
    command_type: str,
    is_scale_model: bool,
    is_torque_estimated: bool,
) -> Informative:
    """
    Return which channels of a recording are informative.

    :param unusable: intervals (s) of gaps, frozen readings and jumps.
    :param command_type: key of `COMMAND_TYPES`, empty without a command.
    :param is_scale_model: whether the vehicle is one: the wheels of a 1:10 car take some 0.1 N·m.
    :param is_torque_estimated: whether the command says so.
    """
    odometry, command, imu = streams.odometry, streams.command, streams.imu
    drive = _lacking(command, "the command", "torque")
    torque = drive
    if drive:
        drive = torque = drive + of_pedals(streams)
    elif command is not None:
        if COMMAND_TYPES[command_type].inferred_torque:
            torque = "the command is an acceleration: a torque inferred from it is no measurement"
        elif is_torque_estimated:
            torque = "the torque is estimated from pedals by a map fitted to the motion"
        elif float(np.nanmax(np.abs(command["torque"]))) <= MAX_PEDAL and not is_scale_model:
            torque = "the torque stays within ±1: it is a pedal or a normalised command"
    gyro = _lacking(imu, "the IMU", "w_z")
    turning = _lacking(odometry, "odometry", "yaw_rate")
    if gyro and imu is not None and np.isfinite(imu["w_z"]).all():
        # It is read in place of odometry's, whatever that says.
        turning = turning or "--no-imu takes odometry's"
    v_x = _lacking(odometry, "odometry", "v_x")
    pose = _pose(odometry)
    return Informative(
        _driving_s(odometry, streams.gps_speed, unusable),
        v_x + of_speeds(streams) if v_x else "",
        _lacking(odometry, "odometry", "v_y"),
        "" if not gyro or not turning else f"{gyro}; {turning}",
        _lacking(command, "the command", "steering"),
        torque,
        drive,
        pose + of_positions(streams) if pose else "",
        "" if imu is not None else "the recording has no IMU",
        missing_for_road(streams),
        streams.attitude is not None,
    )


def _lacking(stream: Stream | None, title: str, column: str) -> str:
    if stream is None:
        return f"the recording has no {title.removeprefix('the ')}"
    if stream.has(column):
        return ""
    values = stream.columns.get(column)
    if values is None or not np.isfinite(values).all():
        return f"{column} of {title} is not reported"
    return f"{column} of {title} is {values[0] + 0.0:g} throughout"


def implied_length_scale(
    odometry: Stream | None, command: Stream | None, imu: Stream | None
) -> float:
    """
    Return the scale of lengths of the wheelbase L = delta v_x / r by steering and curvature.

    1 if it is full-size, not known, or shorter than that of any car: a yaw rate in deg/s. A wrong
    unit or a steering ratio makes the angle larger, never smaller. Regressed on the angle, noise
    does so as well.
    """
    if odometry is None or command is None:
        return 1.0
    if odometry.has("yaw_rate"):
        rate = odometry["yaw_rate"]
    elif imu is not None and imu.has("w_z"):
        rate = np.interp(odometry.at_s, imu.at_s, imu["w_z"])
    else:
        return 1.0
    if not (odometry.has("v_x") and command.has("steering")):
        return 1.0
    moving = odometry["v_x"] > STANDING_SPEED
    angle = np.interp(odometry.at_s, command.at_s, command["steering"])[moving]
    curvature = rate[moving] / odometry["v_x"][moving]
    if angle.size < 2 or not (np.ptp(angle) > 0.0 and np.ptp(curvature) > 0.0):
        return 1.0
    if np.corrcoef(angle, curvature)[0, 1] < MIN_CORRELATION:
        return 1.0
    # Less their means: the steering may have an offset.
    angle, curvature = angle - angle.mean(), curvature - curvature.mean()
    wheelbase = float(angle @ angle / (angle @ curvature))
    return length_scale(wheelbase) if wheelbase > _SHORTEST_WHEELBASE else 1.0


def _pose(odometry: Stream | None) -> str:
    for column in ("x", "y", "heading"):
        if lacking := _lacking(odometry, "odometry", column):
            return lacking
    assert odometry is not None
    farthest = float(max(np.abs(odometry[name]).max() for name in ("x", "y")))
    if farthest > MAX_POSITION:
        return f"the pose is up to {farthest:.0e} m from its origin, no place on Earth"
    return ""


def _driving_s(
    odometry: Stream | None, gps_speed: Stream | None, unusable: list[Interval]
) -> float:
    """Return for how long the car moves while its odometry, else its receiver, is usable, s."""
    if odometry is not None and odometry.has("v_x"):
        return _moving_s(odometry.at_s, np.abs(odometry["v_x"]), unusable)
    if odometry is not None and (odometry.has("x") or odometry.has("y")):
        rate = [np.gradient(np.nan_to_num(odometry[name]), odometry.at_s) for name in ("x", "y")]
        return _moving_s(odometry.at_s, np.hypot(*rate), unusable)
    if gps_speed is not None and gps_speed.has("gps_speed"):
        return _moving_s(gps_speed.at_s, np.abs(gps_speed["gps_speed"]), unusable)
    return 0.0


def _moving_s(at_s: FloatArray, speed: FloatArray, unusable: list[Interval]) -> float:
    moving: BoolArray = speed > STANDING_SPEED
    for begin, end in unusable:
        moving &= (at_s < begin) | (at_s > end)
    return float(np.diff(at_s)[moving[1:] & moving[:-1]].sum())
