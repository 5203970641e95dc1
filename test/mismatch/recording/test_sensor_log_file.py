# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sensor logs as files."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from adk_ros.errors import DataError
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.recording.sensor_log_file import load_sensor_log, save_sensor_log
from adk_ros.signals.decode import SensorConfig

CONFIG = SensorConfig(
    drive_joints=("left", "right"), imu_rotation=(0.0, 3.14, 0.1), reference_point=(1.2, 0.0)
)


def log() -> SensorLog:
    rng = np.random.default_rng(1)
    imu, odometry, command = rng.normal(size=(9, 3)), rng.normal(size=(5, 3)), np.ones((4, 2))
    odometry[2, 1] = np.nan
    return SensorLog(
        "drive", 1.0, np.arange(9.0), imu, np.arange(5.0), odometry, odometry + 1.0,
        np.arange(4.0), command, start_ns=1_760_804_643_200_000_001, warnings=("2 lost", "é"),
        extrinsics="imu at (0, 0)", sensors=CONFIG, measures_v_y=False, length_scale=0.1,
        attitude_s=np.arange(2.0), attitude=np.ones((2, 2)),
    )  # fmt: skip


def test_a_log_is_what_it_was(tmp_path: Path) -> None:
    before, path = log(), tmp_path / "log.npz"
    save_sensor_log(before, path)
    after = load_sensor_log(path)
    for item in fields(SensorLog):
        one, other = getattr(before, item.name), getattr(after, item.name)
        if isinstance(one, np.ndarray):
            np.testing.assert_array_equal(one, other)
            assert one.dtype == other.dtype
        else:
            assert (one, type(one)) == (other, type(other)), item.name
    assert [entry.name for entry in tmp_path.iterdir()] == ["log.npz"]


def test_what_is_no_log_is_said(tmp_path: Path) -> None:
    path = tmp_path / "log.npz"
    save_sensor_log(log(), path)
    whole = path.read_bytes()
    for content in (
        b"",
        b"no log",
        whole[: len(whole) // 2],
        whole.replace(b"length_scale", b"x"),
    ):
        path.write_bytes(content)
        with pytest.raises(DataError, match=r"log\.npz is no sensor log"):
            load_sensor_log(path)


def test_a_log_that_cannot_be_written_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="No such file"):
        save_sensor_log(log(), tmp_path / "none" / "log.npz")
    many = replace(log(), sensors=replace(CONFIG, drive_joints=("a", "b", "c")))
    save_sensor_log(many, tmp_path / "log.npz")
    assert load_sensor_log(tmp_path / "log.npz").sensors == many.sensors
