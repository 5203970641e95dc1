# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Net wheel torque estimated from pedals, by the map that `adk check` proposes.

It is fitted to the motion: an input to predict with, but no evidence about longitudinal forces.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from adk_ros.importing.map_file import TorqueMap
from adk_ros.importing.source_channels import SourceChannel
from adk_ros.importing.streams import MessageStream, at_stamps, joined
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.moving_speed import STANDING_SPEED


def pedal_torque(
    given: Mapping[str, SourceChannel], entry: TorqueMap, notes: list[str]
) -> tuple[MessageStream, FloatArray]:
    """
    Return stamps and torque (n,), N·m, where pedals and v_x are known.

    In a reverse gear the drive force is negative; brakes act against the motion, and not at a
    standstill, where the force that they need to hold the car is not known.
    """
    pedals = entry.pedals()
    stream = joined("pedals", [given[name] for name in pedals], notes, hold=True)
    speed, known = at_stamps("torque", given["v_x"], stream.stamp_ns, next(iter(pedals)), notes)
    gear = _held(given["gear"], stream) if "gear" in given else None
    force = np.zeros(len(stream))
    for name, table in pedals.items():
        part = table.table()(stream.values[name], np.abs(speed), gear)
        if name == "throttle":
            direction = 1.0 if gear is None else np.where(gear < 0.0, -1.0, 1.0)
        else:
            direction = np.where(np.abs(speed) < STANDING_SPEED, 0.0, np.sign(speed))
        force = force + part * direction
    notes.append(
        f"torque is estimated from {', '.join(pedals)}: an input to predict with, no evidence "
        "about longitudinal forces"
    )
    return MessageStream(stream.stamp_ns[known], {}), entry.wheel_radius * force[known]


def _held(gear: SourceChannel, stream: MessageStream) -> FloatArray:
    before = np.searchsorted(gear.stamp_ns, stream.stamp_ns, side="right") - 1
    return gear.values[np.maximum(before, 0)]
