# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Packaged scenarios of the fourteen-degree-of-freedom plant, and the scenario file format."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from helpers.plant import offsets

from adk_ros.errors import UsageError
from adk_ros.plant.environment.wind import Wind, wind_series
from adk_ros.plant.scenario.scenario_file import Scenario, load_scenario, scenarios
from adk_ros.plant.scenario.sensor_simulation import START_NS
from adk_ros.plant.scenario.simulate import simulate
from adk_ros.plant.scenario.swept_sine import SweptSine, steering_angles
from adk_ros.signals.channels import TICK_NS, Source

PAPER = ("xyz_edges", "mass_plus_160", "mass_minus_170", "inertia_plus_142",
         "inertia_minus_158", "mountain", "slalom")  # fmt: skip
FOURTEEN = (*PAPER, "winter", "gusts", "worn_tyres")
STEERED = tuple(name for name in FOURTEEN if name != "slalom")
KMH = 1.0 / 3.6


def written(folder: Path, text: str, name: str = "own.yaml") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def test_every_test_of_the_paper_has_a_scenario() -> None:
    of_plant = {name for name in scenarios() if load_scenario(name).plant == "fourteen_dof"}
    assert of_plant == set(FOURTEEN)
    assert {name for name in FOURTEEN if load_scenario(name).steering is None} == set(STEERED)
    assert load_scenario("xyz_edges").duration_s == 1400.0
    for name in set(PAPER) - {"slalom"}:
        assert load_scenario(name).mu == 0.85
    assert load_scenario("slalom").mu == 0.6


@pytest.mark.slow
@pytest.mark.parametrize("name", STEERED)
def test_the_driver_stays_on_the_road(name: str) -> None:
    drive = simulate(load_scenario(name), duration_s=100.0)
    assert np.abs(offsets(drive)).max() < 0.8
    assert drive.x[:, 0].min() > 3.0
    assert np.abs(drive.x[:, 1]).max() < 2.0, "m/s: it does not skid"


@pytest.mark.parametrize(
    ("vehicle", "base", "speed"),
    [
        ("race_car", "xyz_edges", "{top: 50.0, lateral_accel: 7.0, accel: 2.5, brake: 5.0}"),
        ("light_truck", "mountain", "{lateral_accel: 2.5, accel: 1.2, brake: 2.0}"),
    ],
)
def test_other_vehicles_stay_on_the_road(
    tmp_path: Path, vehicle: str, base: str, speed: str
) -> None:
    path = written(tmp_path, f"base: {base}\nvehicle: {vehicle}\nspeed: {speed}\n")
    drive = simulate(load_scenario(path), duration_s=100.0)
    assert drive.vehicle.name == vehicle
    assert np.abs(offsets(drive)).max() < 0.8


def test_a_lap_of_the_training_road_is_normal_driving() -> None:
    drive = simulate(load_scenario("xyz_edges"), duration_s=250.0)
    assert drive.arc_length[-1] > drive.route.length, "a lap and more"
    assert np.abs(drive.a[:, 1]).max() < 5.5
    assert drive.a[:, 1].max() > 2.5
    assert drive.a[:, 1].min() < -2.5
    assert 60.0 * KMH < drive.x[:, 0].mean() < 90.0 * KMH
    assert np.ptp(drive.states[:, 22]) > 15.0, "it climbs and falls"


def test_the_mountain_starts_slow_and_drops_deep() -> None:
    drive = simulate(load_scenario("mountain"))
    assert drive.x[0, 0] == pytest.approx(20.0 * KMH, abs=0.01)
    assert np.ptp(drive.states[:, 22]) > 60.0
    assert np.degrees(np.ptp(drive.states[:, 24])) > 10.0
    assert np.abs(drive.x[:, 2]).max() > np.radians(30.0), "hairpins"


def test_the_slalom_is_fast_then_slow_and_open_loop() -> None:
    scenario = load_scenario("slalom")
    drive = simulate(scenario)
    v_x = drive.x[:, 0]
    assert v_x[0] == pytest.approx(20.0 * KMH, abs=0.01)
    assert 118.0 * KMH < v_x.max() <= 120.0 * KMH
    t = (drive.stamp_ns - START_NS) * 1e-9
    turns = np.flatnonzero(np.diff(np.sign(drive.x[:, 2])))
    fast = ((t[turns] > 15.0) & (t[turns] < 50.0)).sum() / 35.0
    slow = ((t[turns] > 55.0) & (t[turns] < 100.0)).sum() / 45.0
    assert fast > 4.0 * slow > 0.0
    other = simulate(scenario, seed=99)
    np.testing.assert_array_equal(other.u[:, 1], drive.u[:, 1])
    assert np.abs(other.u[:, 0] - drive.u[:, 0]).max() > 10.0
    assert np.ptp(drive.states[:, 22]) < 0.02, "flat"


def test_a_swept_sine_has_its_frequencies() -> None:
    sine = SweptSine(amplitude=0.02, slow_hz=0.05, fast_hz=0.5)
    t = np.asarray(0.01 * np.arange(20000), dtype=np.float64)
    angle = steering_angles(sine, t)
    assert np.abs(angle).max() <= 0.02
    for begin, end, hertz in ((20.0, 45.0, 0.5), (60.0, 100.0, 0.05), (120.0, 145.0, 0.5)):
        inside = angle[(t >= begin) & (t < end)]
        crossings = np.count_nonzero(np.diff(np.sign(inside)))
        assert crossings == pytest.approx(2.0 * hertz * (end - begin), abs=1.0)
    with pytest.raises(ValueError, match="fast part must end"):
        SweptSine(amplitude=0.1, fast_until=99.0)
    with pytest.raises(ValueError, match="before fast_until"):
        SweptSine(amplitude=0.1, fast_from=40.0, fast_until=41.0)


def test_gusts_depend_on_time_and_seed() -> None:
    wind = Wind(x=1.0, y=-2.0, gust=4.0, gust_bandwidth_hz=0.3)
    series = wind_series(np.random.default_rng(1), wind, 40000)
    np.testing.assert_allclose(series.mean(axis=0), [1.0, -2.0], atol=0.5)
    np.testing.assert_allclose(series.std(axis=0), 4.0, rtol=0.1)
    still = wind_series(np.random.default_rng(1), Wind(x=3.0), 10)
    np.testing.assert_array_equal(still, np.tile([3.0, 0.0], (11, 1)))
    drive = simulate(load_scenario("gusts"), duration_s=20.0)
    again = simulate(load_scenario("gusts"), duration_s=20.0)
    np.testing.assert_array_equal(drive.x, again.x)
    assert drive.wind.shape == (801, 2)
    assert np.ptp(drive.wind[:, 1]) > 4.0
    calm = load_scenario("gusts").model_copy(update={"wind": Wind()})
    assert np.abs(simulate(calm, duration_s=20.0).x[:, 1] - drive.x[:, 1]).max() > 0.01


def test_worn_tyres_and_winter_have_less_grip() -> None:
    new, worn = load_scenario("xyz_edges").car(), load_scenario("worn_tyres").car()
    assert worn.front_tyre.mu < new.front_tyre.mu
    assert worn.front_tyre.c_y == new.front_tyre.c_y, "single keys of a tyre are replaced"
    mu = load_scenario("winter").planned_route().table[:, 4]
    assert np.median(mu) == 0.3
    assert mu.min() < 0.2
    assert mu.max() > 0.5


def test_planar_scenarios_do_not_change() -> None:
    """README figures and sample bags depend on them."""
    drive = simulate(load_scenario("handling"), duration_s=60.0, seed=5)
    first = [round(float(value), 9) for value in drive.x[1234]]
    assert drive.plant == "seven_dof"
    assert drive.states.shape[1] == 22
    assert first == [14.201235905, -0.029716407, -0.224276684]


def test_a_base_supplies_missing_keys(tmp_path: Path) -> None:
    base = load_scenario("xyz_edges")
    own = load_scenario(written(tmp_path, "base: xyz_edges\nspeed: {top: 20.0}\nseed: 5\n"))
    assert own.name == "own"
    assert own.speed == base.speed.model_copy(update={"top": 20.0}), "mappings key by key"
    assert own.route == base.route
    assert own.model_copy(update={"name": base.name, "seed": 11, "speed": base.speed}) == base
    second = load_scenario(written(tmp_path, "base: own.yaml\nplaces: []\n", "second.yaml"))
    assert (second.name, second.seed, second.speed.top) == ("second", 5, 20.0)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("base: ghost\n", "ghost: no such scenario; give a YAML file or one of: .*xyz_edges"),
        ("base: own.yaml\n", "base: a cycle, or more than 8 levels"),
        ("base: 7\n", "base: give the name or the file of one scenario"),
        ("base: [town]\n", "base: give the name"),
        ("base: nowhere.yaml\n", "nowhere.yaml: no such scenario file"),
        ("base: town\nbasis: town\n", "own.yaml: basis: no such parameter"),
        ("base: town\nspeed: {tops: 3.0}\n", r"speed\.tops: no such parameter"),
        ("base: town\nplant: nine_dof\n", "plant: .*'seven_dof' or 'fourteen_dof', got 'nine"),
        ("base: town\nstart_speed: -1\n", "start_speed: .*greater than or equal to 0"),
        ("base: town\nheights: [{at: 3, hight: 2}]\n", r"heights\.0\.hight: no such parameter"),
        ("base: town\nheights: [{at: 3, height: 2}]\n", "needs at least three heights"),
        (
            "base: town\nundulations: [{start: 9, end: 2, amplitude: 1, wavelength: 9}]\n",
            r"undulations\.0: end must be greater than start",
        ),
        ("base: town\nwind: {gust: -1}\n", r"wind\.gust: "),
        ("base: slalom\nsteering: {fast_hz: 0}\n", r"steering\.fast_hz: "),
        ("mass: 2000.0\nyaw_inertia: 3000.0\n", "this is a vehicle file; give a scenario"),
    ],
)
def test_a_bad_file_gives_a_one_line_message(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(UsageError, match=said) as caught:
        load_scenario(written(tmp_path, text))
    assert "\n" not in str(caught.value)


def test_a_start_speed_rises_at_the_plans_rate(tmp_path: Path) -> None:
    path = written(tmp_path, "base: town\nstart_speed: 4.0\n")
    drive = simulate(load_scenario(path), duration_s=6.0)
    assert drive.x[0, 0] == 4.0
    assert drive.x[80, 0] == pytest.approx(4.0 + 1.8 * 2.0, abs=0.8)
    assert drive.x[:, 0].max() < 20.0


def test_a_command_stream_without_phase_starts_at_zero() -> None:
    """With no phase a command is given at the start, and it is the one in force."""
    scenario = load_scenario("town")
    command = scenario.sensors.command.model_copy(update={"phase_s": 0.0})
    sensors = scenario.sensors.model_copy(update={"command": command})
    drive = simulate(scenario.model_copy(update={"sensors": sensors}), duration_s=2.0)
    np.testing.assert_array_equal(drive.commands[0], drive.commands[1])
    np.testing.assert_array_equal(drive.u, drive.commands[1:])
    assert drive.streams[Source.COMMAND].stamp_ns[1] == START_NS
    assert np.all(drive.command_step[1:] * 1_000_000 % TICK_NS == 0)


def test_simulation_speed_on_the_mountain() -> None:
    """1400 s in 15 s are 0.21 s; five times that is allowed on a loaded machine."""
    scenario: Scenario = load_scenario("xyz_edges")
    simulate(scenario, duration_s=0.2)
    best = np.inf
    for _ in range(3):
        begin = time.perf_counter()
        simulate(scenario, duration_s=20.0)
        best = min(best, time.perf_counter() - begin)
    assert best < 1.05
