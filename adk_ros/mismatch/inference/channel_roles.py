# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a recording does not show for lack of a channel."""

from __future__ import annotations

from dataclasses import dataclass

from adk_ros.mismatch.inference.result import MissingChannel
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.features import FEATURES

GRAVITY_EFFECTS = ("road_grade", "road_bank")
"""Effects that need an accelerometer, which measures specific force, to differ from a force."""


@dataclass(frozen=True)
class ChannelRole:
    """
    What is lost without a channel.

    `missing`: for the person. `unobservable`: names of effects, features and equations.
    `residuals`: channels of the residuals that do not count. `states` that cannot be predicted.
    """

    missing: MissingChannel
    unobservable: frozenset[str]
    residuals: tuple[str, ...]
    states: tuple[str, ...]


def _entering(*equations: str) -> frozenset[str]:
    """Return the effects that enter any of some equations."""
    return frozenset(
        e.name for e in EFFECTS.values() if not set(equations).isdisjoint(e.equations)
    )


_LONGITUDINAL = _entering("v_x") | {name for name in FEATURES if "torque" in name} | {"v_x"}

CHANNEL_ROLES = {
    "imu": ChannelRole(
        MissingChannel(
            "an IMU",
            "the recording has no IMU: only odometry is analysed, and effects that need an"
            " accelerometer or a gyro (grade, bank, sensor faults) are not; record"
            " sensor_msgs/msg/Imu",
        ),
        frozenset(e.name for e in EFFECTS.values() if e.sensor).union(GRAVITY_EFFECTS),
        ("imu_a_x", "imu_a_y", "imu_yaw_rate"),
        (),
    ),
    "torque": ChannelRole(
        MissingChannel(
            "a torque command",
            "the drive command is no torque (it is constant, a requested acceleration, estimated"
            " from pedals, or far too small to move the car, like a pedal position or a torque in"
            " kN·m): longitudinal forces are not analysed; record the wheel torque in N·m",
        ),
        _LONGITUDINAL,
        ("imu_a_x", "v_x"),
        ("v_x",),
    ),
    "v_y": ChannelRole(
        MissingChannel(
            "a lateral velocity",
            "odometry's v_y is constant, not measured: the model's own takes its place, and v_y is"
            " not compared; record the velocity of an INS or of two antennas",
        ),
        frozenset(),
        ("v_y",),
        ("v_y",),
    ),
    "steering": ChannelRole(
        MissingChannel(
            "a steering angle",
            "the steering angle is constant: lateral motion is not analysed; record the angle of"
            " the road wheels, and drive bends",
        ),
        _entering("v_y", "yaw_rate") | {"v_y", "yaw_rate"},
        ("imu_a_y", "imu_yaw_rate", "v_y", "yaw_rate"),
        ("v_y", "yaw_rate"),
    ),
    "known_bends": ChannelRole(
        MissingChannel(
            "a steering angle in bends",
            "the car drives bends with a constant steering angle: how much their side forces slow"
            " it down is not known, and longitudinal forces are not analysed",
        ),
        _LONGITUDINAL,
        ("imu_a_x", "v_x"),
        ("v_x",),
    ),
}
"""By the name of the channel in `observability.ObservableEffects`."""
