# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a recording allows, by the channels that are informative."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from helpers.auxiliary_bags import drive_with_wheels, with_auxiliary_topics
from helpers.road import as_streams, circle, hilly

from adk_ros.bags.recording import RecordingOptions
from adk_ros.calibration.from_bag import BagContent, read_streams
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


def test_a_scale_model_needs_less_driving() -> None:
    streams = recorded(26.0)
    assert streams.odometry is not None
    assert streams.command is not None
    curvature = 0.05 * np.sin(0.8 * streams.odometry.at_s)
    turning = changed(streams, "odometry", yaw_rate=streams.odometry["v_x"] * curvature)
    steering = 0.05 * np.sin(0.8 * streams.command.at_s)

    def judged(
        wheelbase: float, length_scale: float | None = None, offset: float = 0.0
    ) -> Possible:
        steered = changed(turning, "command", steering=wheelbase * steering + offset)
        content = BagContent(steered, {}, SensorConfig(), JointTable(), "joint_state", [])
        rows = {row.name: row for row in scope_of(content, length_scale)}
        return rows["judge yaw rate"].possible

    # By the wheelbase that the steering implies, unless the vehicle is known.
    assert judged(2.7) is Possible.NO
    assert judged(0.27) is Possible.YES
    assert judged(2.7, length_scale=0.1) is Possible.YES
    assert judged(0.27, length_scale=1.0) is Possible.NO
    # An offset of the steering is no wheelbase; one of 47 mm is a yaw rate in deg/s.
    assert judged(2.7, offset=-0.1) is Possible.NO
    assert judged(0.27, offset=-0.1) is Possible.YES
    assert judged(2.7 / 57.3) is Possible.NO


def stream(name: str, seconds: float = 90.0, **columns: FloatArray | float) -> Stream:
    at = np.arange(0.0, seconds, 0.1)
    return Stream(
        name, at, {key: np.broadcast_to(x, at.shape) + 0.0 for key, x in columns.items()}
    )


def wave(seconds: float = 90.0) -> FloatArray:
    return np.sin(0.3 * np.arange(0.0, seconds, 0.1))


def test_recorded_pedals_are_named_where_the_torque_is_missing() -> None:
    silent = changed(recorded(), "command", torque=0.0)
    pedals = {
        "throttle": stream("throttle", value=0.5 + 0.5 * wave()),
        "brake_pressure": stream("brake_pressure", value=0.0),
        "gear": stream("gear", value=np.round(3.0 + wave())),
    }
    rows = scoped(replace(silent, pedals=pedals))
    why = rows["predict v_x"].why
    assert why.startswith("torque of the command is 0 throughout, but pedals are recorded")
    # A brake pressure of zero throughout and a gear make no torque.
    assert "(throttle)" in why
    assert "`adk check --vehicle`" in why
    assert "pedals are recorded" in rows["judge v_x"].why
    assert "pedals" not in scoped(silent)["predict v_x"].why
    assert scoped(replace(recorded(), pedals=pedals)) == scoped(recorded())


def test_the_pedals_of_a_bag_are_named(tmp_path: Path) -> None:
    path = with_auxiliary_topics(drive_with_wheels(), tmp_path / "bag", has_pedals=True)
    content = read_streams(path, RecordingOptions())
    assert set(content.streams.pedals) == {"throttle", "brake_pressure"}
    (row,) = [row for row in scope_of(content) if row.name == "predict v_x"]
    assert row.possible is Possible.REDUCED
    assert "pedals are recorded (throttle, brake_pressure)" in row.why


def test_recorded_speeds_are_named_where_v_x_is_missing() -> None:
    silent = changed(recorded(), "odometry", v_x=0.0)
    wheels = {"rear_left": stream("rear_left", velocity=30.0 + wave())}
    gps = stream("the GPS receiver", gps_speed=10.0 + wave())
    assert "wheel_radius" in scoped(replace(silent, wheel_speeds=wheels))["predict v_x"].why
    assert "GPS speed is recorded" in scoped(replace(silent, gps_speed=gps))["predict v_x"].why
    assert scoped(silent)["predict v_x"].why == "v_x of odometry is 0 throughout"


def test_without_odometry_the_receiver_says_whether_the_car_moves() -> None:
    streams = replace(recorded(), odometry=None)
    moving = replace(streams, gps_speed=stream("the GPS receiver", gps_speed=10.0 + wave()))
    why = scoped(moving)["predict v_x"].why
    assert "does not move" not in why
    assert why.startswith("the recording has no odometry, but a GPS speed is recorded")
    standing = replace(streams, gps_speed=stream("the GPS receiver", gps_speed=0.1 * wave()))
    assert "does not move" in scoped(standing)["predict v_x"].why


def test_recorded_positions_are_named_where_the_pose_is_missing() -> None:
    streams = changed(recorded(), "odometry", x=0.0, y=0.0, heading=0.0)
    fix = stream("the GPS receiver", latitude=48.0 + 1e-4 * wave(), longitude=11.0 + 1e-4 * wave())
    rows = scoped(replace(streams, gps_fix=fix))
    assert "GPS positions that are recorded" in rows["grade"].why
    assert "GPS positions" not in scoped(streams)["grade"].why


def test_a_gyro_that_reports_zeros_takes_the_yaw_rate_with_it() -> None:
    """The reader takes it in place of odometry's: nothing is known of the yaw rate."""
    rows = scoped(changed(recorded(), "imu", w_z=0.0))
    assert "predict yaw rate" in impossible(rows)
    assert "w_z of the IMU is 0 throughout" in rows["predict yaw rate"].why
    assert "--no-imu" in rows["predict yaw rate"].why
