# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Three-dimensional roads: closed profiles, tangent planes, and a vehicle on them."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.plant import IMDV

from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import GRAVITY
from adk_ros.plant.environment.elevation import Height, Undulation
from adk_ros.plant.environment.road import (
    ROAD_GRADE,
    ROAD_HEIGHT,
    ROAD_SLOPE,
    ROAD_X,
    ROAD_Y,
    RoadPatch,
    Route,
    Segment,
    build_route,
)
from adk_ros.plant.environment.surface import even_planes, tangent_plane
from adk_ros.plant.scenario.route_step import planes_under
from adk_ros.plant.scenario.scenario_file import Scenario, load_scenario, scenarios
from adk_ros.plant.scenario.simulate import simulate
from adk_ros.plant.vehicle.fourteen_dof import PITCH, TRAVEL, Z

SQUARE = [
    Segment.model_validate(part)
    for part in [{"straight": 300.0}, {"bend": {"radius": 60.0, "angle_deg": 90.0}}] * 4
]
WAVES = Undulation(start=50.0, end=290.0, amplitude=0.2, wavelength=40.0)


def route(**more: object) -> Route:
    return build_route(SQUARE, more.pop("places", []), 0.9, **more)  # type: ignore[arg-type]


def plane_at(road: Route, s: float, across: float = 0.0) -> FloatArray:
    i = round(s / road.spacing)
    row = road.table[i % (len(road.table) - 1)]
    heading = row[2]
    x, y = row[ROAD_X] - across * np.sin(heading), row[ROAD_Y] + across * np.cos(heading)
    plane = np.empty(5)
    tangent_plane(road.table, road.spacing, i * road.spacing, x, y, plane)
    return np.append(plane, (plane[4] - plane[1] * x - plane[2] * y) / plane[3])


@pytest.mark.parametrize("name", scenarios())
def test_packaged_roads_close_in_height(name: str) -> None:
    table = load_scenario(name).planned_route().table
    assert table[-1, ROAD_HEIGHT] == pytest.approx(0.0, abs=1e-6)
    assert table[0, ROAD_HEIGHT] == 0.0
    np.testing.assert_allclose(table[:, ROAD_SLOPE], np.tan(table[:, ROAD_GRADE]), atol=1e-12)


def test_the_profile_interpolates_its_heights() -> None:
    knots = [Height(at=at, height=h) for at, h in ((0, 2.0), (300, 9.0), (700, -4.0), (1000, 3.0))]
    road = route(heights=knots)
    s = road.spacing * np.arange(len(road.table))
    for knot in knots[1:]:
        height = np.interp(knot.at, s, road.table[:, ROAD_HEIGHT]) + 2.0
        assert height == pytest.approx(knot.height, abs=0.02)
    bent = np.diff(road.table[:, ROAD_SLOPE], append=road.table[1, ROAD_SLOPE])
    assert np.abs(bent).max() < 0.001, "no kink, not at the lap's end either"


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"heights": [Height(at=0, height=1.0), Height(at=9, height=0.0)]}, "three heights"),
        ({"heights": [Height(at=a, height=0.0) for a in (5, 3, 9)]}, "must increase"),
        ({"heights": [Height(at=a, height=0.0) for a in (0, 3, 9000)]}, "at 9000 m, but the lap"),
        ({"undulations": [WAVES.model_copy(update={"end": 5e3})]}, "ends at 5000 m, but the lap"),
    ],
)
def test_profiles_that_do_not_fit_are_refused(more: dict[str, object], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        route(**more)


def test_planes_are_tangent_to_the_road() -> None:
    road = route(
        heights=[Height(at=a, height=h) for a, h in ((0, 0), (400, 12), (900, -5), (1300, 2))],
        places=[RoadPatch(start=20.0, end=600.0, bank=0.05, mu=0.6)],
    )
    for s in (3.0, 55.5, 310.0, 444.0, 800.0, 1333.0):
        i = round(s / road.spacing)
        for across in (-1.5, 0.0, 1.5):
            plane = plane_at(road, s, across)
            row = road.table[i]
            assert np.linalg.norm(plane[1:4]) == pytest.approx(1.0)
            expected = row[ROAD_HEIGHT] + across * np.tan(row[6])
            assert plane[5] == pytest.approx(expected, abs=1e-9)
            assert plane[0] == row[4]
        # The normal against the finite difference of the surface along and across the road.
        ahead, behind = plane_at(road, s + road.spacing), plane_at(road, s - road.spacing)
        slope = (ahead[5] - behind[5]) / (2.0 * road.spacing)
        here = plane_at(road, s)
        along = -(here[1] * np.cos(row[2]) + here[2] * np.sin(row[2])) / here[3]
        assert along == pytest.approx(slope, abs=1e-4)
        left = (plane_at(road, s, 0.5)[5] - plane_at(road, s, -0.5)[5]) / 1.0
        side = -(here[2] * np.cos(row[2]) - here[1] * np.sin(row[2])) / here[3]
        assert side == pytest.approx(left, abs=1e-6)


def test_a_road_of_rising_patches_keeps_rising() -> None:
    road = route(places=[RoadPatch(start=100.0, end=300.0, grade=0.05, blend=20.0)])
    climb = road.table[-1, ROAD_HEIGHT]
    assert climb == pytest.approx(180.0 * np.tan(0.05), rel=0.01)
    plane = np.empty(5)
    row = road.table[20]
    for lap in (0, 1, 3):
        s = 20 * road.spacing + lap * road.length
        tangent_plane(road.table, road.spacing, s, row[ROAD_X], row[ROAD_Y], plane)
        height = plane[4] - plane[1] * row[ROAD_X] - plane[2] * row[ROAD_Y]
        assert height / plane[3] == pytest.approx(lap * climb, abs=1e-9)


def test_each_wheel_has_its_own_road_plane() -> None:
    road = route(undulations=[WAVES])
    planes = np.empty((4, 5))
    planes_under(IMDV.c, road.table, road.spacing, 110.0, (110.0, 0.0, 0.0), planes)
    height = planes[:, 4] - planes[:, 1] * (110.0 + np.array([1.315, 1.315, -1.355, -1.355]))
    height /= planes[:, 3]
    expected = 0.2 * np.sin(2.0 * np.pi * (np.array([111.315, 108.645]) - 50.0) / 40.0)
    np.testing.assert_allclose(height, np.repeat(expected, 2), atol=2e-3)
    assert abs(height[0] - height[2]) > 0.05


def test_constant_slope_gives_identical_planes() -> None:
    planes = even_planes(0.8, 0.1, 0.02, heading=np.pi / 2)
    assert planes[0, 2] / planes[0, 3] == pytest.approx(-np.tan(0.1))
    assert planes[0, 1] / planes[0, 3] == pytest.approx(np.tan(0.02)), "left of north is west"
    assert np.isfinite(even_planes(1.0, 1e300, -1e300)).all()


def quiet(**more: object) -> Scenario:
    """A car driven evenly round the square at 12 m/s, at most."""
    content: dict[str, object] = {
        "duration_s": 24.0, "route": [part.model_dump(exclude_none=True) for part in SQUARE],
        "speed": {"top": 12.0, "variation": 0.0},
        "excitation": {"steer": 0.0, "torque": 0.0, "torque_step": 0.0},
    }  # fmt: skip
    return Scenario.model_validate(content | more)


def test_the_body_follows_undulations_and_springs_deflect() -> None:
    drive = simulate(quiet(undulations=[WAVES.model_dump()]))
    rows = (drive.arc_length > 90.0) & (drive.arc_length < 250.0)
    s, table = drive.arc_length[rows], drive.route.table
    road = np.interp(s, drive.route.spacing * np.arange(len(table)), table[:, ROAD_HEIGHT])
    body = drive.states[rows, Z] - 0.53
    # 12 m/s over 40 m: 0.3 Hz, far below the 1.4 Hz of the springs.
    assert np.abs(body - road).max() < 0.04
    assert np.corrcoef(body, road)[0, 1] > 0.99
    slope = np.interp(s, drive.route.spacing * np.arange(len(table)), table[:, ROAD_SLOPE])
    assert np.corrcoef(-drive.states[rows, PITCH], slope)[0, 1] > 0.97
    assert 0.003 < np.ptp(drive.states[rows, TRAVEL]) < 0.05
    # Speed is held: what the accelerometer senses is the slope.
    assert np.corrcoef(drive.a[rows, 0], np.sin(slope))[0, 1] > 0.95


def test_velocity_is_the_integral_of_force_and_gravity() -> None:
    """du/dt = a_x + r v - q w + g sin(pitch), in body axes: as a strapped-down unit has it."""
    drive = simulate(load_scenario("mountain"), duration_s=60.0)
    v_x, v_y, r = drive.x.T
    v_z, p, q = drive.states[:, [15, 16, 17]].T
    roll, pitch = drive.states[:, 23], drive.states[:, 24]
    rates = np.column_stack([
        drive.a[:, 0] + r * v_y - q * v_z + GRAVITY * np.sin(pitch),
        drive.a[:, 1] - r * v_x + p * v_z - GRAVITY * np.cos(pitch) * np.sin(roll),
    ])  # fmt: skip
    summed = np.cumsum(0.5 * (rates[1:] + rates[:-1]), axis=0) * 0.025
    drift = drive.x[1:, :2] - drive.x[0, :2] - summed
    assert np.ptp(pitch) > 0.1
    assert np.abs(np.diff(drift[::40], axis=0)).max() < 0.02, "m/s a second"
