# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The comparisons of the benchmark: recordings by vehicle, and the faults injected into them.

The reference of a comparison is untouched: the first half of the recording whose second half has
the fault, or another recording of the same vehicle.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import permutations
from pathlib import Path

import numpy as np

from adk_ros.bags.recording import RecordingOptions
from adk_ros.calibration.from_bag import BagContent, read_streams
from adk_ros.calibration.streams import Stream, Streams
from adk_ros.errors import DataError, UsageError

DEVELOPMENT = {
    "imu_bias.a_x": (0.5, -0.3), "imu_bias.a_y": (0.7, -1.0), "imu_bias.gyro": (0.01, -0.02),
    "imu_tilt.roll": (0.06, -0.08), "imu_tilt.pitch": (0.04, -0.06),
    "imu_lever_arm.x": (0.35, -0.55), "imu_lever_arm.y": (0.55, -0.35),
    "imu_delay": (0.06, 0.12), "odometry_scale": (1.04, 0.95), "gyro_scale": (1.05, 0.94),
    "odometry_filter": (0.1, 0.3), "clock_offset": (0.1, -0.15),
    "steering_offset": (0.008, -0.012), "steering_ratio": (1.1, 0.88),
}  # fmt: skip
"""Sizes by fault, with which the method was developed, in the unit of the fault; a lever arm in
wheelbases, since it is as large as the car."""
CONFIRMATION = {
    "imu_bias.a_x": (0.4, -0.8), "imu_bias.a_y": (0.8, -1.3), "imu_bias.gyro": (0.012, -0.025),
    "imu_tilt.roll": (0.07, -0.1), "imu_tilt.pitch": (0.05, -0.08),
    "imu_lever_arm.x": (0.4, -0.6), "imu_lever_arm.y": (0.6, -0.4),
    "imu_delay": (0.05, 0.15), "odometry_scale": (1.05, 0.93), "gyro_scale": (1.06, 0.92),
    "odometry_filter": (0.12, 0.25), "clock_offset": (0.12, -0.2),
    "steering_offset": (0.01, -0.018), "steering_ratio": (1.15, 0.82),
}  # fmt: skip
"""Other sizes, on which the figures are reported."""


@dataclass(frozen=True)
class Pairing:
    """
    Two untouched recordings of one vehicle.

    `vehicle`: name of their folder. `name` of the comparison, for the table; `kind`: "halves" of
    one recording, or "pair".
    """

    vehicle: str
    name: str
    kind: str
    reference: BagContent
    tested: BagContent


def recordings_by_vehicle(folder: Path) -> dict[str, list[Path]]:
    """
    Return the bags below a folder by vehicle: the path of the folder that a bag lies in.

    :raises UsageError: it is no folder, or has no bag.
    """
    if not folder.is_dir():
        raise UsageError(f"--recordings {folder}: no such folder")
    found: dict[str, list[Path]] = {}
    for path in sorted(folder.rglob("metadata.yaml")):
        bag = path.parent
        below = bag.parent.relative_to(folder).as_posix()
        found.setdefault(folder.name if below == "." else below, []).append(bag)
    if not found:
        raise UsageError(
            f"--recordings {folder}: has no rosbag2 folder; import recordings with adk import, "
            "one folder for each vehicle"
        )
    return found


def pairings(bags: dict[str, list[Path]], refused: list[str]) -> Iterator[Pairing]:
    """
    Yield the comparisons of all recordings.

    :param refused: receives a line for each bag that cannot be read.
    """
    for vehicle, paths in bags.items():
        contents = []
        for path in paths:
            try:
                contents.append((path.name, read_streams(path, RecordingOptions())))
            except (DataError, UsageError) as error:
                refused.append(str(error))
        for name, content in contents:
            middle = 0.5 * max(float(x.at_s[-1]) for x in content.streams.present())
            first, second = part(content, 0.0, middle), part(content, middle, np.inf)
            yield Pairing(vehicle, name, "halves", first, second)
        for (name, content), (other, tested) in permutations(contents, 2):
            yield Pairing(vehicle, f"{name} to {other}", "pair", content, tested)


def part(content: BagContent, begin_s: float, end_s: float) -> BagContent:
    """Return the messages of a recording in an interval of time."""

    def cut(stream: Stream | None) -> Stream | None:
        if stream is None:
            return None
        inside = (stream.at_s >= begin_s) & (stream.at_s < end_s)
        columns = {name: values[inside] for name, values in stream.columns.items()}
        return Stream(stream.name, stream.at_s[inside], columns, stream.disordered)

    whole = content.streams
    streams = Streams(
        whole.name,
        min(end_s, whole.seconds) - begin_s,
        cut(whole.imu),
        cut(whole.odometry),
        cut(whole.command),
        notes=whole.notes,
    )
    return replace(content, streams=streams)
