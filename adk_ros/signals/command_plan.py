# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Planned commands: a trajectory message in, net wheel torque and road-wheel angle over time out.

Duck-typed as the decoder: for messages of rclpy and of rosbags. A plan is used as a whole or
refused as a whole: after a faulty point, the times of the rest are not to be trusted.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.signals.channels import Source
from adk_ros.signals.commands import COMMAND_TYPES, CommandConfig, RefusedMessage, checked_command
from adk_ros.signals.decode import SensorConfig

MAX_POINTS = 10_000
"""Most points of a plan: 10 s, the longest horizon, at 1 kHz."""
_CONTROL_HORIZON = "autoware_control_msgs/msg/ControlHorizon"
_JOINT_TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"


@dataclass(frozen=True)
class CommandPlan:
    """
    Commands planned at `stamp_ns`: each in force from its time on until the next one's.

    `times_ns` (n,) strictly ascending; `commands` (n, 2): torque in N·m and delta in rad, a column
    of NaN where it is not planned.
    """

    stamp_ns: int
    times_ns: IntArray
    commands: FloatArray

    def at(self, times_ns: IntArray) -> FloatArray:
        """
        Return the commands (k, 2) in force at ascending times (k,).

        NaN before the first point, and from the last one on except at the first of the times:
        there the last command has come into force, and the plan says nothing beyond.
        """
        index = np.searchsorted(self.times_ns, times_ns, side="right") - 1
        out = self.commands[np.maximum(index, 0)]
        out[index < 0] = math.nan
        out[np.searchsorted(times_ns, self.times_ns[-1]) + 1 :] = math.nan
        return out


class PlanDecoder:
    """
    Decodes plans for the joints of a `SensorConfig`; `refused` counts refusals by reason.

    Types: trajectory_msgs/JointTrajectory with efforts of the drive joints and positions of the
    steer joint, either of which may be missing; with `command_type` autoware_control also
    autoware_control_msgs/ControlHorizon.
    """

    def __init__(self, config: SensorConfig) -> None:
        self._config = config
        self.refused: Counter[str] = Counter()
        self.received = 0

    def decode(self, msg: Any, now_ns: int | None) -> CommandPlan:
        """
        Return the plan in a message; without a stamp it begins at `now_ns`.

        :raises RefusedMessage: it cannot be used; the reason is also counted in `refused`.
        """
        self.received += 1
        try:
            decode = _control_horizon if hasattr(msg, "controls") else _joint_trajectory
            stamp_ns, times_ns, commands = decode(msg, self._config, now_ns)
            corrected = [_corrected(each, self._config) for each in commands]
            return _checked(stamp_ns, times_ns, corrected)
        except RefusedMessage as refusal:
            self.refused[str(refusal)] += 1
            raise
        except (AttributeError, TypeError, ValueError, IndexError, OverflowError) as error:
            reason = f"not the expected message type ({type(msg).__name__})"
            self.refused[reason] += 1
            raise RefusedMessage(reason) from error


def plan_types(command_type: str) -> tuple[str, ...]:
    """Return the ROS types of plans for a type of command, the preferred one first."""
    autoware = command_type == "autoware_control"
    return (_CONTROL_HORIZON, _JOINT_TRAJECTORY) if autoware else (_JOINT_TRAJECTORY,)


def _corrected(command: list[float], config: SensorConfig) -> list[float]:
    """
    Return a command (torque, delta) without its known errors, NaN where it is not planned.

    :raises RefusedMessage: it is beyond the limits of commands, which apply to what is used.
    """
    torque, delta = config.command(*command)
    checked_command(
        0.0 if math.isnan(command[0]) else torque, 0.0 if math.isnan(command[1]) else delta
    )
    return [torque, delta]


def _checked(stamp_ns: int, times_ns: list[int], commands: list[list[float]]) -> CommandPlan:
    if not times_ns:
        raise RefusedMessage("the plan has no points")
    if len(times_ns) > MAX_POINTS:
        raise RefusedMessage(f"the plan has more than {MAX_POINTS} points")
    times = np.array(times_ns, dtype=np.int64)
    if (np.diff(times) <= 0).any():
        raise RefusedMessage("the times of the plan do not increase")
    return CommandPlan(stamp_ns, times, np.array(commands, dtype=np.float64))


def _start_ns(stamp: Any, config: SensorConfig, now_ns: int | None) -> int:
    """
    Return a stamp in ns, less the delay of commands; zero means now.

    `now_ns` is the stamp of a reading, so its delay is gone already.
    """
    start_ns = _nanoseconds(stamp)
    if start_ns > 0:
        return start_ns - config.delays_ns[Source.COMMAND]
    if now_ns is None:
        raise RefusedMessage("no time stamp, and no sensor message before it")
    return now_ns


def _nanoseconds(time: Any) -> int:
    return int(time.sec) * 1_000_000_000 + int(time.nanosec)


def _joint_trajectory(
    msg: Any, config: SensorConfig, now_ns: int | None
) -> tuple[int, list[int], list[list[float]]]:
    start_ns = _start_ns(msg.header.stamp, config, now_ns)
    names = list(msg.joint_names)
    drives = [names.index(joint) for joint in config.drive_joints if joint in names]
    if drives and len(drives) < len(config.drive_joints):
        missing = next(joint for joint in config.drive_joints if joint not in names)
        raise RefusedMessage(f"joint '{missing}' is missing")
    steer = names.index(config.steer_joint) if config.steer_joint in names else None
    if not drives and steer is None:
        joints = "', '".join([*config.drive_joints, config.steer_joint])
        raise RefusedMessage(f"the plan names none of the joints '{joints}'")
    commands = []
    for point in msg.points:
        torque = delta = 0.0
        for index in drives:
            torque += _value(point.effort, index, "effort")
        if steer is not None:
            delta = _value(point.positions, steer, "position") / config.steering_ratio
        torque, delta = checked_command(torque, delta)
        commands.append([torque if drives else math.nan, math.nan if steer is None else delta])
    times = [start_ns + _nanoseconds(point.time_from_start) for point in msg.points]
    return start_ns, times, commands


def _value(values: Any, index: int, name: str) -> float:
    if index >= len(values):
        raise RefusedMessage(f"a point of the plan has no {name} of a joint that the plan names")
    return float(values[index])


def _control_horizon(
    msg: Any, config: SensorConfig, now_ns: int | None
) -> tuple[int, list[int], list[list[float]]]:
    """The first control is that at `control_time`, the others follow every `time_step_ms`."""
    stamp_ns = _start_ns(msg.stamp, config, now_ns)
    begin_ns = _start_ns(msg.control_time, config, stamp_ns)
    step_ns = float(msg.time_step_ms) * 1e6
    if len(msg.controls) > 1 and not 0.0 < step_ns < math.inf:
        raise RefusedMessage("the time step of the plan is not positive")
    decode: Callable[[Any, CommandConfig], tuple[float, float]]
    decode = COMMAND_TYPES["autoware_control"].decode
    times = [begin_ns + round(i * step_ns) for i in range(len(msg.controls))]
    return stamp_ns, times, [list(decode(control, config)) for control in msg.controls]
