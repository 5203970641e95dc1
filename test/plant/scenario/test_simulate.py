# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Simulated scenarios: repeatability, route, sensors and the written bag."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from helpers.plant import offsets

from adk_ros.bags import Bag
from adk_ros.errors import UsageError
from adk_ros.numerics.constants import GRAVITY
from adk_ros.offline.export import TOPICS, write_bag
from adk_ros.plant.environment.road import (
    ROAD_CURVATURE,
    ROAD_HEADING,
    ROAD_SPEED,
    ROAD_X,
    ROAD_Y,
    RoadPatch,
    Segment,
    Slalom,
    build_route,
)
from adk_ros.plant.scenario.scenario_file import Scenario, load_scenario, scenarios
from adk_ros.plant.scenario.sensor_simulation import START_NS, SimulatedDrive
from adk_ros.plant.scenario.simulate import simulate
from adk_ros.signals.channels import TICK_NS, Source
from adk_ros.signals.decode import Decoder, SensorConfig


@pytest.fixture(scope="module")
def drive() -> SimulatedDrive:
    return simulate(load_scenario("handling"), duration_s=120.0)


def clean(scenario: Scenario, **sensors: object) -> Scenario:
    return scenario.model_copy(
        update={"sensors": scenario.sensors.clean().model_copy(update=sensors)}
    )


def test_a_seed_determines_the_drive(drive: SimulatedDrive) -> None:
    again = simulate(load_scenario("handling"), duration_s=120.0)
    np.testing.assert_array_equal(again.x, drive.x)
    np.testing.assert_array_equal(again.log_ns, drive.log_ns)
    assert again.readings == drive.readings
    other = simulate(load_scenario("handling"), seed=99, duration_s=20.0)
    assert np.abs(other.u[:800] - drive.u[:800]).max() > 1.0


def test_sensor_settings_do_not_change_the_motion(drive: SimulatedDrive) -> None:
    heard_better = simulate(clean(load_scenario("handling")), duration_s=120.0)
    np.testing.assert_array_equal(heard_better.x, drive.x)
    np.testing.assert_array_equal(heard_better.u, drive.u)


def test_the_drive_excites_all_channels(drive: SimulatedDrive) -> None:
    v_x, a_x, a_y = drive.x[:, 0], drive.a[:, 0], drive.a[:, 1]
    assert v_x.min() < 9.0
    assert v_x.max() > 29.0
    assert a_y.min() < -3.5
    assert a_y.max() > 3.5
    assert np.abs(a_y).max() < 6.5
    assert a_x.min() < -3.0
    assert a_x.max() > 1.5


def test_truth_is_on_the_tick_grid(drive: SimulatedDrive) -> None:
    assert drive.stamp_ns[0] == START_NS
    assert np.all(drive.stamp_ns % TICK_NS == 0)
    assert np.all(np.diff(drive.stamp_ns) == TICK_NS)
    assert len(drive.stamp_ns) == 120 * 40 + 1
    record = drive.truth()
    assert len(record) == len(drive.x)
    assert record.learnable.all()


@pytest.mark.parametrize("name", ["handling", "town"])
def test_the_driver_stays_on_the_route(name: str) -> None:
    scenario = load_scenario(name)
    drive = simulate(scenario, duration_s=240.0)
    assert drive.arc_length[-1] > 1.1 * drive.route.length, "more than one lap"
    assert np.abs(offsets(drive)).max() < 1.5


def test_routes_close_and_have_the_given_bends() -> None:
    for name in scenarios():
        scenario = load_scenario(name)
        table = scenario.planned_route().table
        assert np.hypot(*(table[-1, [ROAD_X, ROAD_Y]] - table[0, [ROAD_X, ROAD_Y]])) < 0.05
        turned = table[-1, ROAD_HEADING] - table[0, ROAD_HEADING]
        assert turned == pytest.approx(2.0 * np.pi, abs=1e-3)
        tightest = min(part.bend.radius for part in scenario.route if part.bend is not None)
        assert np.abs(table[:, ROAD_CURVATURE]).max() == pytest.approx(1.0 / tightest, rel=0.02)
        lateral = np.square(table[:, ROAD_SPEED]) * np.abs(table[:, ROAD_CURVATURE])
        assert lateral.max() < 1.01 * scenario.speed.lateral_accel


def test_a_slalom_weaves_about_its_line() -> None:
    weave = Segment(slalom=Slalom(amplitude=1.5, wavelength=50.0, waves=6))
    half = [Segment.model_validate({"bend": {"radius": 60.0, "angle_deg": 90.0}})] * 2
    corner = Segment.model_validate({"bend": {"radius": 40.0, "angle_deg": 90.0}})
    back = [Segment(straight=300.0), corner, Segment(straight=40.0), corner]
    route = build_route([weave, Segment(straight=80.0), *half, *back], [], 1.0)
    woven = route.table[: int(300.0 / route.spacing)]
    assert np.ptp(woven[:, ROAD_Y]) == pytest.approx(3.2, abs=0.3)
    assert woven[-1, ROAD_Y] == pytest.approx(0.0, abs=0.1)


def test_velocity_is_the_integral_of_force_and_gravity() -> None:
    """dv_x/dt = a_x + r v_y - g sin(grade), dv_y/dt = a_y - r v_x - g sin(bank)."""
    places = [
        RoadPatch(start=100.0, end=700.0, grade=0.06, bank=-0.04),
        RoadPatch(start=900.0, end=1800.0, grade=-0.05, bank=0.05, mu=0.7),
    ]
    scenario = load_scenario("handling").model_copy(update={"places": places})
    route = scenario.planned_route()
    drive = simulate(scenario, duration_s=100.0)
    s = drive.arc_length % route.length
    grade = np.interp(s, route.spacing * np.arange(len(route.table)), route.table[:, 5])
    bank = np.interp(s, route.spacing * np.arange(len(route.table)), route.table[:, 6])
    v_x, v_y, r = drive.x.T
    rates = np.column_stack(
        [
            drive.a[:, 0] + r * v_y - GRAVITY * np.sin(grade),
            drive.a[:, 1] - r * v_x - GRAVITY * np.sin(bank),
        ]
    )
    summed = np.cumsum(0.5 * (rates[1:] + rates[:-1]), axis=0) * TICK_NS * 1e-9
    drift = drive.x[1:, :2] - drive.x[0, :2] - summed
    assert np.ptp(grade) > 0.1
    assert np.abs(np.diff(drift[::40], axis=0)).max() < 0.02, "m/s a second"


def test_streams_have_their_rates_and_phases(drive: SimulatedDrive) -> None:
    stamps = {source: stream.stamp_ns for source, stream in drive.streams.items()}
    for source, hertz in ((Source.IMU, 200), (Source.ODOMETRY, 50), (Source.COMMAND, 40)):
        assert np.median(np.diff(stamps[source])) == pytest.approx(1e9 / hertz, abs=1.0)
        assert len(stamps[source]) == pytest.approx(120 * hertz, rel=0.01)
    assert not set(stamps[Source.IMU]) & set(stamps[Source.ODOMETRY])
    assert not set(stamps[Source.COMMAND]) & set(stamps[Source.ODOMETRY])
    assert stamps[Source.COMMAND][0] < START_NS, "a command is in force as the drive starts"


def test_readings_come_in_order_of_arrival_and_after_their_stamp(drive: SimulatedDrive) -> None:
    assert len(drive.readings) == len(drive.log_ns)
    assert np.all(np.diff(drive.log_ns) >= 0)
    late = drive.log_ns - np.array([reading.stamp_ns for reading in drive.readings])
    assert late.min() >= 1_000_000
    assert late.max() < 9_000_000


def test_noise_bias_and_loss_are_as_set() -> None:
    scenario = load_scenario("handling")
    sensors = scenario.sensors
    assert sensors.imu is not None
    lossy = sensors.model_copy(
        update={
            "odometry": sensors.odometry.model_copy(
                update={"phase_s": 0.0, "dropout": 0.1, "bias_v_y": 0.3}
            )
        }
    )
    drive = simulate(scenario.model_copy(update={"sensors": lossy}), duration_s=200.0)
    odometry = drive.streams[Source.ODOMETRY]
    assert len(odometry.stamp_ns) == pytest.approx(0.9 * 10001, rel=0.02)
    on_tick = odometry.stamp_ns % TICK_NS == 0
    row = (odometry.stamp_ns[on_tick] - START_NS) // TICK_NS
    error = odometry.values[on_tick, :3] - drive.x[row]
    np.testing.assert_allclose(error.std(axis=0), [0.02, 0.02, 0.002], rtol=0.08)
    assert np.all(np.abs(error.mean(axis=0) - [0.0, 0.3, 0.0]) < [3e-3, 3e-3, 3e-4])


def test_clean_sensors_report_the_truth() -> None:
    scenario = load_scenario("town")
    imu = scenario.sensors.imu
    assert imu is not None
    silent = clean(scenario).sensors
    assert silent.imu is not None
    on_grid = clean(
        scenario,
        imu=silent.imu.model_copy(update={"phase_s": 0.0}),
        odometry=silent.odometry.model_copy(update={"phase_s": 0.0}),
    )
    drive = simulate(on_grid, duration_s=20.0)
    for source, truth in ((Source.IMU, drive.a), (Source.ODOMETRY, drive.x)):
        stream = drive.streams[source]
        ticks = stream.stamp_ns % TICK_NS == 0
        row = (stream.stamp_ns[ticks] - START_NS) // TICK_NS
        width = truth.shape[1]
        np.testing.assert_allclose(stream.values[ticks, :width], truth[row], atol=1e-12)
    commands = drive.streams[Source.COMMAND]
    given = np.searchsorted(commands.stamp_ns, drive.stamp_ns, side="right") - 1
    np.testing.assert_array_equal(drive.u, commands.values[given])


def test_a_vehicle_without_an_imu() -> None:
    scenario = load_scenario("town")
    sensors = scenario.sensors.model_copy(update={"imu": None})
    drive = simulate(scenario.model_copy(update={"sensors": sensors}), duration_s=5.0)
    assert set(drive.streams) == {Source.ODOMETRY, Source.COMMAND}
    assert not any(reading.source is Source.IMU for reading in drive.readings)


def test_progress_is_reported_to_the_end() -> None:
    told: list[tuple[float, float]] = []
    simulate(load_scenario("town"), duration_s=12.0, progress=lambda *at: told.append(at))
    assert [seconds for _, seconds in told] == [12.0] * len(told)
    assert told[-1][0] == pytest.approx(12.0)
    assert len(told) == 3


@pytest.mark.parametrize("duration_s", [0.0, -1.0, float("nan"), 1e9])
def test_durations_out_of_range_are_refused(duration_s: float) -> None:
    with pytest.raises(UsageError, match="duration must be"):
        simulate(load_scenario("town"), duration_s=duration_s)


def test_a_negative_seed_is_refused() -> None:
    with pytest.raises(UsageError, match="seed must not be negative"):
        simulate(load_scenario("town"), seed=-1)


def test_simulation_speed_of_the_planar_plant() -> None:
    """Wall time on a loaded machine is no property of the code: twice the aim is allowed here."""
    scenario = load_scenario("handling")
    simulate(scenario, duration_s=0.2)

    def spent_s() -> float:
        begin = time.perf_counter()
        simulate(scenario, duration_s=40.0)
        return time.perf_counter() - begin

    assert min(spent_s() for _ in range(3)) < 4.0 * 40.0 / 220.0 + 0.2


@pytest.mark.parametrize(("storage", "compression"), [("mcap", "zstd"), ("sqlite3", None)])
def test_a_bag_contains_the_sensor_messages(
    tmp_path: Path, storage: str, compression: str | None
) -> None:
    drive = simulate(load_scenario("town"), duration_s=5.0)
    told: list[tuple[int, int]] = []
    path = tmp_path / "bag"
    write_bag(drive, path, storage, compression, progress=lambda *at: told.append(at))
    assert told[-1] == (len(drive.readings), len(drive.readings))
    source_of = {topic: source for source, (topic, _) in TOPICS.items()}
    decoder = Decoder(SensorConfig())
    with Bag(path) as bag:
        assert {(topic.name, topic.msgtype) for topic in bag.topics} == set(TOPICS.values())
        content = list(bag.messages())
    read = [decoder.decode(source_of[topic], msg) for topic, _, msg in content]
    assert [log_ns for _, log_ns, _ in content] == drive.log_ns.tolist()
    # The messages of IMU and odometry report the variances of their noise.
    assert all((r.variances is None) == (r.source is Source.COMMAND) for r in read)
    assert sorted(r._replace(variances=None) for r in read) == sorted(drive.readings)
    imu = next(msg for topic, _, msg in content if topic == "/imu/data")
    assert imu.orientation_covariance[0] == -1.0
    assert imu.linear_acceleration.z == GRAVITY
    assert imu.header.frame_id == "imu_link"
    odometry = next(msg for topic, _, msg in content if topic == "/odometry")
    assert (odometry.header.frame_id, odometry.child_frame_id) == ("odom", "base_link")
    heading = 2.0 * np.arctan2(odometry.pose.pose.orientation.z, odometry.pose.pose.orientation.w)
    assert heading == pytest.approx(drive.streams[Source.ODOMETRY].values[0, 5], abs=1e-9)


def test_an_existing_bag_is_not_overwritten(tmp_path: Path) -> None:
    drive = simulate(load_scenario("town"), duration_s=1.0)
    write_bag(drive, tmp_path / "bag")
    with pytest.raises(UsageError, match="exists already"):
        write_bag(drive, tmp_path / "bag")
