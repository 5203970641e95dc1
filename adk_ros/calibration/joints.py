# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The joints of a JointState command: which of them drive, which one steers, wheel speeds."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.commands import is_torque_estimated
from adk_ros.signals.decode import SensorConfig

_FIELDS = ("position", "velocity", "effort")


@dataclass
class JointTable:
    """
    Values by (joint, field), NaN where a message lacks them; the table grows message by message.

    Fields are `position` (rad), `velocity` (rad/s) and `effort` (N·m).
    """

    is_torque_estimated: bool = False
    """Whether a message says that its efforts were estimated from the motion."""
    _stamps: list[float] = field(default_factory=list)
    _values: dict[tuple[str, str], list[float]] = field(default_factory=dict)

    def add(self, at_s: float, msg: Any) -> None:
        """Take over a sensor_msgs/JointState."""
        row = len(self._stamps)
        self.is_torque_estimated = self.is_torque_estimated or is_torque_estimated(msg)
        self._stamps.append(at_s)
        for i, joint in enumerate(msg.name):
            for name in _FIELDS:
                values = getattr(msg, name)
                if i < len(values):
                    column = self._values.setdefault((str(joint), name), [])
                    column += [np.nan] * (row - len(column))
                    if len(column) == row:
                        column.append(float(values[i]))

    @property
    def at_s(self) -> FloatArray:
        """Stamps (n,), s."""
        return np.array(self._stamps, dtype=np.float64)

    def values(self, joint: str, name: str) -> FloatArray:
        """Return a field of a joint (n,); NaN throughout if no message has it."""
        column = self._values.get((joint, name), [])
        out = np.full(len(self._stamps), np.nan)
        out[: len(column)] = column
        return out

    def names(self) -> list[str]:
        """Return the joints."""
        return sorted({joint for joint, _ in self._values})

    def with_field(self, name: str) -> list[str]:
        """Return the joints of which at least half of the messages have a field."""
        return [
            joint
            for joint in self.names()
            if self._stamps and np.isfinite(self.values(joint, name)).mean() >= 0.5
        ]

    def proposal(self, sensors: SensorConfig) -> dict[str, Any]:
        """
        Return `drive_joints` and `steer_joint` where the configured ones are absent.

        A joint is proposed only if it is the only candidate: the only one with a position steers,
        all others with an effort drive.
        """
        out: dict[str, Any] = {}
        positions, efforts = self.with_field("position"), self.with_field("effort")
        if sensors.steer_joint not in positions and len(positions) == 1:
            out["steer_joint"] = positions[0]
        steer = out.get("steer_joint", sensors.steer_joint)
        driving = [joint for joint in efforts if joint != steer]
        if not set(sensors.drive_joints) <= set(efforts) and driving:
            out["drive_joints"] = driving
        return out

    def drive_and_steer(self, sensors: SensorConfig) -> tuple[FloatArray, FloatArray]:
        """Return torque (n,) and road-wheel angle (n,), from the configured or proposed joints."""
        proposal = self.proposal(sensors)
        drives = proposal.get("drive_joints", sensors.drive_joints)
        steer = proposal.get("steer_joint", sensors.steer_joint)
        zero = np.zeros(len(self._stamps))
        torque = sum((self.values(joint, "effort") for joint in drives), start=zero)
        return torque, self.values(steer, "position") / sensors.steering_ratio

    def velocities(self) -> dict[str, FloatArray]:
        """Return the angular velocities (n,) of the joints that report one, by joint."""
        return {joint: self.values(joint, "velocity") for joint in self.with_field("velocity")}
