# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Several recordings of one car on one axis of time: checks, shift and concatenation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from adk_ros.errors import DataError
from adk_ros.mismatch.recording.measured_road import joined_roads
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.numerics.arrays import FloatArray


def check_different(logs: Sequence[SensorLog]) -> None:
    """
    Check that no recording is given twice: its noise would count as evidence twice.

    :raises DataError: two recordings have the same odometry, as a copy or a converted bag has.
    """
    for one, other in combinations(logs, 2):
        if np.array_equal(one.odometry, other.odometry) and np.array_equal(one.pose, other.pose):
            raise DataError(
                f"{one.name} and {other.name} have the same odometry: one recording given twice "
                "is no further evidence; give different recordings"
            )


def distinct_names(logs: Sequence[SensorLog]) -> tuple[str, ...]:
    """Return the recordings' names; equal ones are numbered in the order given."""
    names = [log.name for log in logs]
    return tuple(
        f"{name} ({names[: i + 1].count(name)})" if names.count(name) > 1 else name
        for i, name in enumerate(names)
    )


def shifted(log: SensorLog, by_s: float) -> SensorLog:
    """Return a recording whose times, and its duration, are later by `by_s`."""
    return replace(
        log,
        start_ns=log.start_ns - round(by_s * 1e9),
        duration_s=log.duration_s + by_s,
        imu_s=log.imu_s + by_s,
        odometry_s=log.odometry_s + by_s,
        command_s=log.command_s + by_s,
        attitude_s=log.attitude_s + by_s,
        road=None if log.road is None else log.road.shifted(by_s),
    )


def in_sequence(logs: Sequence[SensorLog]) -> list[SensorLog]:
    """Return recordings that begin where the one before ends."""
    out: list[SensorLog] = []
    for log in logs:
        out.append(shifted(log, out[-1].duration_s) if out else log)
    return out


def concatenated(logs: Sequence[SensorLog]) -> SensorLog:
    """Return recordings that follow each other in time as one."""

    def joined(name: str) -> FloatArray:
        return np.concatenate([getattr(log, name) for log in logs])

    return replace(
        logs[-1],
        name=" and ".join(log.name for log in logs),
        imu_s=joined("imu_s"),
        imu=joined("imu"),
        odometry_s=joined("odometry_s"),
        odometry=joined("odometry"),
        pose=joined("pose"),
        command_s=joined("command_s"),
        command=joined("command"),
        start_ns=logs[0].start_ns,
        torque_is_inferred=any(log.torque_is_inferred for log in logs),
        warnings=tuple(line for log in logs for line in log.warnings),
        measures_v_y=all(log.measures_v_y for log in logs),
        attitude_s=joined("attitude_s"),
        attitude=joined("attitude"),
        road=joined_roads([log.road for log in logs]),
    )
