# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Score of an answer against a label."""

from __future__ import annotations

import math
from typing import Any

import pytest

from adk_ros.bench.mismatch.case_score import (
    described,
    detectable,
    formed,
    overlap,
    raised_error,
    score_case,
)
from adk_ros.bench.mismatch.reliability import ScoredClaim
from adk_ros.mismatch.library.parametric_features import form_of


def label(*effects: str, kind: str = "always", **params: float) -> dict[str, Any]:
    return {
        "effects": [
            {"name": name, "params": params, "kind": kind, "time_intervals_s": [[0.0, 100.0]]}
            for name in effects
        ]
    }


def answer(verdict: str, *effects: str, **alternatives: list[str]) -> dict[str, Any]:
    return {
        "verdict": verdict,
        "effects": [
            {
                "name": name,
                "alternatives": alternatives.get(name, []),
                "parameters": {"cda": {"value": 1.1, "low": 0.9, "high": 1.2, "unit": "m^2"}},
                "where": {"kind": "always", "time_intervals_s": [[0.0, 50.0]]},
            }
            for name in effects
        ],
    }


@pytest.mark.parametrize(
    ("truth", "said", "right", "f1"),
    [
        (label(), answer("none"), 1.0, 1.0),
        (label(), answer("explained", "aero_drag"), 0.0, 0.0),
        (label("aero_drag"), answer("explained", "aero_drag"), 1.0, 1.0),
        (label("aero_drag"), answer("none"), 0.0, 0.0),
        (label("aero_drag"), answer("explained", "headwind", headwind=["aero_drag"]), 0.5, 0.5),
        (label("aero_drag"), answer("explained", "aero_drag", "payload"), 0.0, 2.0 / 3.0),
        (
            label("wheel_radius"),
            answer("explained", "drive_torque_gain", drive_torque_gain=["wheel_radius"]),
            1.0,
            1.0,
        ),
        (
            label("torque_offset"),
            answer(
                "explained",
                "rolling_resistance",
                rolling_resistance=["torque_offset", "aero_drag"],
            ),
            0.5,
            0.5,
        ),
        (label("wheel_radius"), answer("explained", "drive_torque_gain"), 0.0, 0.0),
        (label("aero_drag", "payload"), answer("explained", "payload"), 0.0, 2.0 / 3.0),
        (label("unknown"), answer("unknown"), 1.0, 1.0),
        (label("unknown"), answer("explained", "aero_drag"), 0.0, 0.0),
    ],
)
def test_credit_for_names(
    truth: dict[str, Any], said: dict[str, Any], right: float, f1: float
) -> None:
    result = score_case("x", truth, said)
    assert (result.right, result.f1) == pytest.approx((right, f1))


def test_parameters_and_times() -> None:
    result = score_case(
        "x", label("aero_drag", kind="place", cda=1.0), answer("explained", "aero_drag")
    )
    assert result.errors["aero_drag.cda"] == pytest.approx(0.1)
    assert result.covered["aero_drag.cda"]
    assert result.iou["aero_drag"] == pytest.approx(0.5, abs=1e-3)


def test_overlap_of_empty_sets_is_one() -> None:
    assert overlap([], [], 10.0) == 1.0
    assert overlap([[1.0, 2.0]], [[1.5, 3.0]], 10.0) == pytest.approx(0.25, abs=0.01)


LOCKED = {
    "effects": [
        {
            "name": "unknown",
            "params": {},
            "kind": "always",
            "time_intervals_s": [[0.0, 100.0]],
            "equations": ["yaw_rate"],
            "driven_by": ["yaw_rate_per_speed", "yaw_rate"],
        }
    ]
}


@pytest.mark.parametrize(
    ("equations", "text", "right"),
    [
        (["yaw_rate"], "yaw acceleration against yaw rate (wheel-speed difference)", True),
        (
            ["yaw_rate", "v_y"],
            "yaw acceleration against torque; yaw acceleration against relative wheel-speed "
            "difference (path curvature)",
            True,
        ),
        (["yaw_rate"], "yaw acceleration against torque", False),
        (["v_y"], "lateral acceleration against yaw rate (wheel-speed difference)", False),
        ([], "", False),
    ],
)
def test_unlisted_effects_need_equation_and_variable(
    equations: list[str], text: str, right: bool
) -> None:
    said = answer("unknown") | {"unexplained": {"equations": equations, "text": text}}
    result = score_case("x", LOCKED, said)
    assert result.described is right
    assert result.right == float(right)


def test_strength_and_plant_come_from_the_label() -> None:
    result = score_case("x", label("gyro_scale") | {"strength": 0.3, "plant": "p"}, answer("none"))
    assert (result.strength, result.plant, result.correctable) == (0.3, "p", False)


@pytest.mark.parametrize(
    ("text", "right"),
    [
        ("longitudinal acceleration against drive torque", True),
        (
            "longitudinal acceleration against drive torque where the lateral acceleration "
            "is above 3.4 m/s²",
            True,
        ),
        ("longitudinal acceleration against drive torque with a lag of 0.4 s", True),
        (
            "longitudinal acceleration against a mass on a spring moved by drive torque (0.5 Hz, "
            "damping ratio 0.1)",
            True,
        ),
        ("longitudinal acceleration against drive torque squared", False),
        ("lateral acceleration against drive torque", False),
    ],
)
def test_features_with_parameters_are_described_by_their_variable(text: str, right: bool) -> None:
    label = {"effects": [{"name": "unknown", "equations": ["v_x"], "driven_by": ["drive_torque"]}]}
    equation = "v_x" if text.startswith("longitudinal") else "v_y"
    answer = {"unexplained": {"equations": [equation], "text": text}}
    assert described(label, answer) is right


FAULTY = label("unknown")
FAULTY["effects"][0] |= {"accepts": ["none", "unknown"], "sensor": True}


def test_a_faulty_sensor_is_no_effect_of_the_car() -> None:
    for said, right in (
        (answer("none"), 1.0),
        (answer("unknown"), 1.0),
        (answer("explained", "aero_drag"), 0.0),
        (answer("unknown", "aero_drag"), 0.0),
    ):
        result = score_case("x", FAULTY, said)
        assert (result.right, result.correctable) == (right, False)


@pytest.mark.parametrize(
    ("variable", "text", "right"),
    [
        ("time", "yaw acceleration against an oscillation in time at 0.28 Hz", True),
        ("time", "yaw acceleration against a constant that changes with the time over 55 s", True),
        ("time", "yaw acceleration against a constant from 120 s", True),
        ("time", "yaw acceleration against a constant", False),
        ("time", "yaw acceleration against an oscillation with speed", False),
        ("distance", "yaw acceleration against an oscillation every 2.04 m travelled", True),
        ("distance", "yaw acceleration against speed", False),
        ("torque", "yaw acceleration against torque with a hysteresis of ±120 N·m", True),
        ("yaw_rate", "yaw acceleration against yaw rate (wheel-speed difference) beyond 0.2 rad/s",
         True),
    ],
)  # fmt: skip
def test_time_distance_and_memory_are_driving_variables(
    variable: str, text: str, right: bool
) -> None:
    truth = {"effects": [LOCKED["effects"][0] | {"driven_by": [variable]}]}
    said = answer("unknown") | {"unexplained": {"equations": ["yaw_rate"], "text": text}}
    assert described(truth, said) is right


@pytest.mark.parametrize(
    ("forms", "features", "text", "right"),
    [
        (["threshold"], ["gate:drive_torque:lateral_size>2.5"], "", True),
        (["threshold"], ["drive_torque"], "", False),
        # Another variable has that form, the right one another.
        (["threshold"], ["drive_torque", "gate:delta:speed>20"], "", False),
        (["static"], ["speed", "drive_torque"], "", True),
        (["hysteresis"], ["hysteresis:torque:120"], "", False),
        (["oscillation in time"], ["pulsation:2.5:0.1:drive_torque"], "", True),
        (["change with time"], ["decay:drive_torque:time:100"], "", True),
        (["episodes"], [], "acceleration against time: 3 episodes", True),
        (["static"], [], "acceleration against time: 3 episodes", False),
        ([], ["speed"], "", None),
    ],
)
def test_a_term_of_the_right_variable_has_the_right_form(
    forms: list[str], features: list[str], text: str, right: bool | None
) -> None:
    unknown = {"name": "unknown", "equations": ["v_x"], "driven_by": ["drive_torque"]}
    terms = [
        {"equation": "v_x", "feature": name, "form": form_of(name), "coefficient": 1.0}
        for name in features
    ]
    answer = {"unexplained": {"equations": ["v_x"], "text": text, "terms": terms}}
    assert formed({"effects": [unknown | {"forms": forms}]}, answer) is right


def test_claims_are_right_if_an_alternative_is_labelled() -> None:
    said = answer("explained", "headwind", "payload", headwind=["aero_drag"])
    for effect, confidence in zip(said["effects"], (0.8, None), strict=True):
        effect["confidence"] = confidence
    assert score_case("x", label("aero_drag"), said).claims == [
        ScoredClaim("headwind|aero_drag", 0.8, True)
    ]
    assert not score_case("x", label("crosswind"), said).claims[0].right


def test_one_effect_does_not_make_two_claims_right() -> None:
    def right(*named: str, labelled: str = "aero_drag", **alternatives: list[str]) -> list[bool]:
        said = answer("explained", *named, **alternatives)
        for effect in said["effects"]:
            effect["confidence"] = 0.9
        return [claim.right for claim in score_case("x", label(labelled), said).claims]

    drag = ["aero_drag"]
    assert right("headwind", "payload", headwind=drag, payload=drag) == [True, False]
    assert right("headwind", "aero_drag", headwind=drag) == [False, True]
    # At two places, for example.
    assert right("aero_drag", "aero_drag") == [True, True]


def test_the_largest_raised_error() -> None:
    fit = {
        "before": {"v_x": 0.1, "v_y": 0.02},
        "after": {"v_x": 0.02, "v_y": 0.021},
        "horizons": {"2": {"before": {"v_x": 0.2, "v_y": None}, "after": {"v_x": 0.22}}},
    }
    assert raised_error({"fit": fit}) == pytest.approx(0.05)
    assert raised_error({"fit": fit}, all_horizons=True) == pytest.approx(0.1)
    assert math.isnan(raised_error({}))


@pytest.mark.parametrize(
    ("effect", "params", "size", "expected"),
    [
        ("aero_drag", {"cda": 0.1}, 0.05, True),
        ("aero_drag", {"cda": 0.1}, 0.2, False),
        ("aero_drag", {"cda": 0.1}, math.nan, False),
        ("yaw_inertia", {"scale": 0.97}, 0.02, True),
        # A limit of power is the more detectable the smaller it is.
        ("power_limit", {"power": 2e4}, 4e4, True),
        ("power_limit", {"power": 7e4}, 4e4, False),
    ],
)
def test_an_effect_is_detectable_from_its_size_on(
    effect: str, params: dict[str, Any], size: float, expected: bool
) -> None:
    sizes = {(effect, name): size for name in params} | {("payload", "mass"): 1.0}
    assert detectable(label(effect, **params), sizes) is expected
    assert detectable(label("gyro_scale", scale=1.01), sizes) is None
