# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a recording allows, by the channels that are informative."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from helpers.road import as_streams, circle, hilly

from adk_ros.calibration.from_bag import BagContent
from adk_ros.calibration.joints import JointTable
from adk_ros.calibration.scope import MIN_JUDGED_S, Possible, Scope, scope_of
from adk_ros.calibration.streams import Stream, Streams
from adk_ros.mismatch.recording.checks import MIN_DURATION_S
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.decode import SensorConfig


def recorded(seconds: float = 90.0) -> Streams:
    return as_streams(hilly(path=circle, seconds=seconds))


def scoped(streams: Streams, command_type: str = "joint_state") -> dict[str, Scope]:
    kind = command_type if streams.command is not None else ""
    content = BagContent(streams, {}, SensorConfig(), JointTable(), kind, [])
    return {row.name: row for row in scope_of(content)}


def changed(streams: Streams, stream: str, **columns: FloatArray | float) -> Streams:
    old = streams.of(stream)
    assert old is not None
    new = {name: np.broadcast_to(x, old.at_s.shape) + 0.0 for name, x in columns.items()}
    return streams.with_stream(stream, old.having(**new))


def impossible(rows: dict[str, Scope]) -> set[str]:
    return {name for name, row in rows.items() if row.possible is Possible.NO}


def test_a_complete_recording_allows_everything() -> None:
    rows = scoped(recorded())
    assert {row.possible for row in rows.values()} == {Possible.YES}
    assert all(row.why == row.needs == "" for row in rows.values())


def test_a_constant_v_y_is_neither_predicted_nor_judged() -> None:
    rows = scoped(changed(recorded(), "odometry", v_y=0.0))
    assert impossible(rows) == {"predict v_y", "judge v_y"}
    assert rows["predict v_y"].why == "v_y of odometry is 0 throughout"
    assert "inertial navigation" in rows["predict v_y"].needs
    assert rows["grade"].possible is Possible.REDUCED
    assert "assumed" in rows["grade"].why


def test_a_constant_torque_reduces_v_x() -> None:
    rows = scoped(changed(recorded(), "command", torque=120.0))
    assert impossible(rows) == {"judge v_x"}
    assert rows["predict v_x"].possible is Possible.REDUCED
    assert "120 throughout" in rows["predict v_x"].why
    assert rows["predict v_x"].needs == "wheel torque or pedal"


def test_a_pedal_predicts_but_hardly_judges() -> None:
    streams = recorded()
    assert streams.command is not None
    pedal = streams.command["torque"] / 4000.0
    rows = scoped(changed(streams, "command", torque=pedal))
    assert rows["predict v_x"].possible is Possible.YES
    assert rows["judge v_x"].possible is Possible.REDUCED
    assert "pedal" in rows["judge v_x"].why


def test_a_requested_acceleration_is_no_torque() -> None:
    rows = scoped(recorded(), "ackermann")
    assert rows["judge v_x"].possible is Possible.REDUCED
    assert "inferred" in rows["judge v_x"].why


def test_a_parked_car_allows_nothing() -> None:
    rows = scoped(changed(recorded(), "odometry", v_x=np.tile([0.001, -0.001], 2250)))
    assert impossible(rows) == set(rows)
    assert {row.why for row in rows.values()} == {"the car does not move"}


def test_eleven_seconds_allow_the_road_alone() -> None:
    rows = scoped(recorded(11.0))
    assert impossible(rows) == set(rows) - {"grade", "bank"}
    assert "moves for 11 s only" in rows["predict v_x"].why


def test_poses_beyond_the_earth_are_no_places() -> None:
    streams = recorded()
    assert streams.odometry is not None
    rows = scoped(changed(streams, "odometry", x=streams.odometry["x"] + 1e9))
    assert rows["grade"].possible is Possible.REDUCED
    assert "no place on Earth" in rows["grade"].why
    assert rows["calibration"].possible is Possible.REDUCED


def test_without_an_imu_there_is_no_road() -> None:
    rows = scoped(replace(recorded(), imu=None))
    assert impossible(rows) == {"grade", "bank"}
    assert rows["predict yaw rate"].possible is Possible.YES


def test_without_odometry_nothing_moves() -> None:
    streams = replace(recorded(), odometry=None)
    assert impossible(scoped(streams)) == set(scoped(recorded()))


def test_driving_in_faulty_intervals_does_not_count() -> None:
    streams = recorded(40.0)
    odometry = streams.odometry
    assert odometry is not None
    kept = (odometry.at_s < 5.0) | (odometry.at_s > 30.0)
    columns = {name: values[kept] for name, values in odometry.columns.items()}
    gap = streams.with_stream("odometry", Stream("odometry", odometry.at_s[kept], columns))
    assert "moves for 15 s only" in scoped(gap)["predict v_x"].why


def test_the_least_duration_is_that_of_mismatch() -> None:
    assert MIN_JUDGED_S == MIN_DURATION_S
