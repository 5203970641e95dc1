# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The node's parameters: names, defaults, ranges and descriptions.

Nothing here imports rclpy or a ROS message, so the offline verbs read a parameter file on a
machine without ROS. `ros.parameters` declares this table on the node.
"""

from __future__ import annotations

import difflib
import math
import textwrap
from typing import Any

from adk_ros.model.adaptation.online_methods import METHODS
from adk_ros.ros.correction_parameters import CORRECTION_TABLE
from adk_ros.ros.parameter_spec import ParameterSpec
from adk_ros.signals.commands import COMMAND_TYPES
from adk_ros.signals.velocity_messages import ODOMETRY_TYPES

_ROS_PARAMETERS = ("use_sim_time", "start_type_description_service", "qos_overrides.")
"""Names, or beginnings of names, of parameters that rclpy itself declares."""

_HELP_WIDTH = 98
"""Characters per line of `help_text`."""

TABLE: tuple[ParameterSpec, ...] = (
    ParameterSpec("model", "", "Model folder written by 'adk train'; required."),
    ParameterSpec(
        "public_keys",
        "",
        "File with the SSH keys (Ed25519) of which one must have signed the model; empty: nobody "
        "must.",
    ),
    ParameterSpec(
        "method",
        "",
        "Online adaptation method; empty: the method that the model was validated with.",
        choices=("", *METHODS),
    ),
    ParameterSpec(
        "window",
        0,
        "Samples in the least-squares window; 0: the value stored with the model.",
        0,
        100_000,
    ),
    ParameterSpec(
        "ridge",
        0.0,
        "Weight of the offline model, in equivalent samples; 0: the value stored with the model.",
        0.0,
        1e12,
    ),
    ParameterSpec(
        "forgetting",
        0.0,
        "Forgetting factor per sample of method ffrls; 0: the value stored with the model.",
        0.0,
        1.0,
    ),
    ParameterSpec(
        "horizon_s", 2.0, "Length of the predicted horizon, s; 0: no horizon.", 0.0, 10.0
    ),
    ParameterSpec(
        "publish_horizon",
        True,
        "Publish ~/predicted_horizon and ~/predicted_path with their covariances, "
        "~/predicted_horizon_plan and ~/local_linear_model.",
        live=True,
    ),
    ParameterSpec(
        "frame_id",
        "",
        "Frame of the predicted twist, with its origin at reference_point; empty: base_link, or "
        "centre_of_gravity if reference_point is not zero.",
    ),
    ParameterSpec(
        "use_imu",
        "auto",
        "auto: use an IMU if one publishes; required: report an error without one; "
        "never: do not subscribe.",
        choices=("auto", "required", "never"),
    ),
    ParameterSpec(
        "reference_point",
        [0.0, 0.0],
        "Centre of gravity (x, y) in the odometry's child frame, m; velocities are predicted at "
        "this point.",
        -50.0,
        50.0,
    ),
    ParameterSpec(
        "imu_position",
        [0.0, 0.0],
        "IMU position (x, y) in the odometry's child frame, m.",
        -50.0,
        50.0,
    ),
    ParameterSpec(
        "imu_rotation",
        [0.0, 0.0, 0.0],
        "Roll, pitch, yaw of the rotation from IMU axes to vehicle axes, rad.",
        -2 * math.pi,
        2 * math.pi,
    ),
    ParameterSpec(
        "use_tf",
        True,
        "Take position and rotation of the IMU from /tf_static where imu_position and "
        "imu_rotation are zero.",
    ),
    ParameterSpec(
        "command_type", "joint_state", "Type of command message.", choices=tuple(COMMAND_TYPES)
    ),
    ParameterSpec(
        "drive_joints",
        ["drive"],
        "Joints whose efforts add up to the net wheel torque, N·m.",
    ),
    ParameterSpec("steer_joint", "steer", "Joint whose position is the steering angle, rad."),
    ParameterSpec(
        "steering_ratio",
        1.0,
        "Steer joint angle divided by road-wheel angle; 1: the joint is the road wheel; "
        "negative: opposite sense of rotation; of a hand wheel in degrees 57.3 times the ratio.",
        -10000.0,
        10000.0,
    ),
    ParameterSpec(
        "mass",
        0.0,
        "Vehicle mass, kg; required if the command is an acceleration.",
        0.0,
        1e6,
    ),
    ParameterSpec(
        "wheel_radius",
        0.0,
        "Wheel radius, m; required if the command is an acceleration, or odometry wheel speeds.",
        0.0,
        10.0,
    ),
    ParameterSpec(
        "odometry_type",
        "odometry",
        "Type of the odometry messages: odometry (nav_msgs/Odometry), wheel_joints (JointState), "
        "wheel_speed (TwistStamped about the y axis), ground_velocity (TwistStamped of a GPS "
        "receiver).",
        choices=tuple(ODOMETRY_TYPES),
    ),
    ParameterSpec(
        "wheel_joints",
        ["rear_left", "rear_right"],
        "Joints of odometry_type wheel_joints whose mean velocity counts: wheels that neither "
        "steer nor drive, if there are such.",
    ),
    ParameterSpec(
        "sideslip",
        [0.0, 0.0],
        "Where v_y is not measured: distance from the centre of gravity to the rear axle, m, and "
        "rear slip angle per lateral acceleration, rad s²/m, with which it is estimated; zeros: "
        "it is not. An estimate is never scored.",
        0.0,
        20.0,
    ),
    *CORRECTION_TABLE,
    ParameterSpec(
        "odometry_timeout_s",
        0.5,
        "Age beyond which odometry no longer gives a state, s; until then the IMU is "
        "integrated from it.",
        0.0,
        2.0,
    ),
    ParameterSpec(
        "frozen_after_s",
        1.0,
        "Declare a sensor frozen after it repeats the same value for this long while the vehicle "
        "moves, s; 0: off.",
        0.0,
        3600.0,
    ),
    ParameterSpec("max_wait_s", 0.05, "Longest wait for a reading that is due, s.", 0.0, 0.5),
    ParameterSpec(
        "max_coast_s",
        1.0,
        "How long to keep predicting after odometry_timeout_s without odometry, s.",
        0.0,
        60.0,
    ),
    ParameterSpec(
        "plan_timeout_s",
        0.5,
        "Age beyond which planned commands are no longer followed, s.",
        0.0,
        60.0,
    ),
    ParameterSpec(
        "gate_false_rejection",
        1e-6,
        "Share of good IMU and odometry readings that may be rejected as contradicting the "
        "prediction; 0: reject none.",
        0.0,
        0.1,
    ),
    ParameterSpec(
        "gate_confirmations",
        5,
        "Rejected readings in succession after which a new level is accepted.",
        2,
        1000,
    ),
    ParameterSpec(
        "diagnostics_period_s", 1.0, "Period of /diagnostics in wall-clock time, s.", 0.1, 60.0
    ),
)


def defaults() -> dict[str, Any]:
    """Return the default values, by parameter name."""
    return {spec.name: spec.default for spec in TABLE}


def unknown_parameter(name: str) -> str | None:
    """Return a warning if the table and rclpy lack this parameter, with the closest known name."""
    names = [spec.name for spec in TABLE]
    if name in names or name.startswith(_ROS_PARAMETERS):
        return None
    close = difflib.get_close_matches(name, names, 1)
    hint = f": did you mean '{close[0]}'?" if close else ""
    return f"parameter '{name}' is unknown and ignored{hint}"


def help_text() -> str:
    """Return the table for a terminal."""
    width = max(len(spec.name) for spec in TABLE)
    lines = []
    for spec in TABLE:
        lines += textwrap.wrap(
            f"{spec.text} [{spec.default!r}]",
            _HELP_WIDTH,
            initial_indent=f"  {spec.name:<{width}}  ",
            subsequent_indent=" " * (width + 4),
        )
    return "\n".join(lines)
