# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Comparison with an independent model: CommonRoad's multi-body model of the same vehicle."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from adk_ros.numerics.constants import GRAVITY
from adk_ros.plant.vehicle.sprung_mass import resolve
from adk_ros.plant.vehicle.tyre import axle_tyre, combined_slip_utilisation

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(scope="module")
def script() -> ModuleType:
    path = ROOT / "scripts" / "compare_multibody.py"
    spec = importlib.util.spec_from_file_location("compare_multibody", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    # Its NamedTuples look their module up.
    sys.modules["compare_multibody"] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def upright(script: ModuleType) -> dict[tuple[str, str], Any]:
    found = script.compare(shifts=False)
    print("\n" + "\n".join(str(difference) for difference in found))
    return {(d.manoeuvre, d.quantity): d for d in found}


def test_the_vehicle_equals_the_reference(script: ModuleType) -> None:
    p = script.parameters()
    vehicle = script.equivalent(p)
    body = resolve(vehicle)
    assert body.sprung_mass == pytest.approx(p.m_s, rel=1e-6)
    assert body.sprung_z + vehicle.cg_height == pytest.approx(p.h_s, abs=1e-6)
    assert vehicle.yaw_inertia == p.I_z
    front = body.load_f * vehicle.front_tyre.b_y
    theirs = 0.5 * GRAVITY * (p.m_s * p.b / (p.a + p.b) + p.m_uf)
    slip = vehicle.front_tyre.c_y * vehicle.front_tyre.mu
    assert front * slip == pytest.approx(-p.tire.p_ky1 * theirs, rel=1e-6)


def test_the_tyres_equal_the_reference(script: ModuleType) -> None:
    """Pure slip at the static load; the y axis of the reference points to the other side."""
    from vehiclemodels.utils.tire_model import formula_lateral, formula_longitudinal

    p = script.parameters(shifts=False)
    vehicle = script.equivalent(p)
    tyre = axle_tyre(vehicle.constants(), True)
    ratio = -p.tire.p_ky1 / (tyre.b_y * tyre.c_y * tyre.mu)
    for slip in (0.005, 0.02, 0.06, 0.15):
        lateral = -formula_lateral(slip, 0.0, 3000.0, p.tire)[0]
        ours = (
            3000.0
            * tyre.mu
            * combined_slip_utilisation(tyre, 0.0, ratio * tyre.b_y * np.tan(slip))[1]
        )
        assert ours == pytest.approx(lateral, rel=0.005)
        along = formula_longitudinal(-slip, 0.0, 3000.0, p.tire)
        ours = 3000.0 * tyre.mu * combined_slip_utilisation(tyre, tyre.b_x * slip, 0.0)[0]
        assert ours == pytest.approx(along, rel=0.03 if slip < 0.05 else 0.12)


@pytest.mark.slow
@pytest.mark.parametrize("circle", ["circle, 15 m/s, 2.3 deg", "circle, 20 m/s, 2.3 deg"])
def test_circles_agree(upright: dict[tuple[str, str], Any], circle: str) -> None:
    assert abs(upright[circle, "yaw_rate"].at_end) < 0.01
    assert abs(upright[circle, "a_y"].at_end) < 0.01
    assert abs(upright[circle, "v_y"].at_end) < 0.04
    # There a solid axle carries the wheels' own tipping, here the springs do.
    assert abs(upright[circle, "roll"].at_end) < 0.08
    assert upright[circle, "yaw_rate"].on_the_way < 0.01
    assert upright[circle, "a_y"].on_the_way < 0.03


@pytest.mark.slow
def test_step_steer_agrees(upright: dict[tuple[str, str], Any]) -> None:
    step = "step steer, 20 m/s, 1.7 deg"
    assert abs(upright[step, "yaw_rate"].at_end) < 0.01
    assert abs(upright[step, "a_y"].at_end) < 0.01
    assert upright[step, "yaw_rate"].on_the_way < 0.05
    # Theirs forms slips without what the body's rolling adds at the road.
    assert upright[step, "a_y"].on_the_way < 0.20
    assert upright[step, "roll"].on_the_way < 0.20


@pytest.mark.slow
@pytest.mark.parametrize("braking", ["braking, 30 m/s, 3 m/s^2", "braking, 30 m/s, 6 m/s^2"])
def test_braking_agrees(upright: dict[tuple[str, str], Any], braking: str) -> None:
    assert abs(upright[braking, "v_x"].at_end) < 0.002
    assert upright[braking, "v_x"].on_the_way < 0.005
    # There all of the car's inertia tips it from the sprung mass's height.
    assert abs(upright[braking, "pitch"].at_end) < 0.08
    assert upright[braking, "pitch"].on_the_way < 0.12


@pytest.mark.slow
def test_published_reference_tyres_shift_the_circle_slightly(script: ModuleType) -> None:
    """The effect of camber, conicity and ply-steer, which this tyre model leaves out."""
    found = {(d.manoeuvre, d.quantity): d for d in script.compare()}
    for circle in ("circle, 15 m/s, 2.3 deg", "circle, 20 m/s, 2.3 deg"):
        assert abs(found[circle, "yaw_rate"].at_end) < 0.05
        assert abs(found[circle, "a_y"].at_end) < 0.05
    assert abs(found["braking, 30 m/s, 6 m/s^2", "v_x"].at_end) < 0.002
