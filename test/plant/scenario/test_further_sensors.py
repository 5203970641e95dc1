# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Attitude and wheel speeds of a simulated drive; they leave its other streams as they are."""

import numpy as np

from adk_ros.bags import Bag
from adk_ros.calibration.attitude import attitude_of, attitude_row
from adk_ros.offline.export import WHEELS_TOPIC, write_bag
from adk_ros.plant.environment.road import ROAD_GRADE, lookup
from adk_ros.plant.scenario.scenario_file import load_scenario
from adk_ros.plant.scenario.sensors import Imu, Sensors, Wheels
from adk_ros.plant.scenario.simulate import simulate
from adk_ros.signals.channels import Source

SECONDS = 6.0


def driven(plant, sensors):
    scenario = load_scenario("mountain").model_copy(update={"plant": plant, "sensors": sensors})
    return simulate(scenario, duration_s=SECONDS)


def test_the_attitude_is_that_of_the_road_and_the_body_and_changes_no_other_stream(tmp_path):
    plain = driven("fourteen_dof", Sensors())
    more = driven(
        "fourteen_dof", Sensors(imu=Imu(attitude_noise=1e-3, bias_pitch=0.02), wheels=Wheels())
    )
    for source, stream in plain.streams.items():
        assert np.array_equal(stream.values, more.streams[source].values)
    assert plain.attitude is None
    write_bag(more, tmp_path / "bag")
    with Bag(tmp_path / "bag") as bag:
        rows = [attitude_row(msg) for _, _, msg in bag.messages(["/imu/data"])]
        wheels = [msg.velocity[2] for _, _, msg in bag.messages([WHEELS_TOPIC[0]])]
    table = np.array(rows)
    attitude = attitude_of(table[:, 0], table[:, 1:], np.eye(3))
    assert attitude is not None
    route = more.route
    grade = [lookup(route.table, route.spacing, s, ROAD_GRADE) for s in more.arc_length.tolist()]
    time_s = more.stamp_ns * 1e-9
    pitch = np.interp(time_s, attitude.at_s, attitude["pitch"])
    # Uphill is nose up, a negative pitch; the body squats and dives by about 1 degree.
    assert np.abs(pitch - 0.02 + grade).max() < 0.04
    assert np.corrcoef(pitch, grade)[0, 1] < -0.95
    radius = more.vehicle.wheel_radius
    v_x = more.streams[Source.ODOMETRY].values[:, 0]
    assert abs(np.median(wheels) * radius / np.median(v_x) - 1.0) < 0.03


def test_a_plant_without_a_body_has_the_attitude_of_the_road():
    drive = driven("seven_dof", Sensors(imu=Imu(attitude_noise=0.0)))
    route = drive.route
    first = lookup(route.table, route.spacing, float(drive.arc_length[0]), ROAD_GRADE)
    assert abs(drive.attitude.values[0, 1] + first) < 1e-4
    assert drive.attitude.values.shape == (drive.streams[Source.IMU].stamp_ns.size, 2)


def test_clean_sensors_keep_the_attitude_and_the_wheels():
    clean = Sensors(imu=Imu(attitude_noise=0.01), wheels=Wheels(speed_noise=1.0)).clean()
    assert clean.imu is not None
    assert clean.wheels is not None
    assert clean.imu.attitude_noise == 0.0
    assert clean.wheels.speed_noise == 0.0
    plain = Sensors().clean()
    assert plain.imu is not None
    assert plain.imu.attitude_noise is None
