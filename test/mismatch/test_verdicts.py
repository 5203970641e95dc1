# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Verdicts on recordings that mislead: what is said must be true of the car."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from adk_ros.bench.mismatch.case_generator import GeneratedCase, InjectedMismatch, make_case
from adk_ros.bench.vehicles.multibody import MULTI_BODY
from adk_ros.mismatch.analysis import identify_mismatch
from adk_ros.mismatch.inference.result import (
    EXPLAINED,
    NONE,
    NOT_EXPORTED,
    UNKNOWN,
    MismatchResult,
)
from adk_ros.mismatch.library.criteria import HELD_OUT_SHARE
from adk_ros.mismatch.report.result_files import as_dict
from adk_ros.mismatch.report.summary import sentence
from adk_ros.plant.injection.injectors import FULL, UNLISTED
from adk_ros.plant.injection.unlisted_changes import SLOSH_FREQUENCY_HZ, TORQUE_CUT_FROM

pytestmark = pytest.mark.slow(seconds=45)
SECONDS = (100.0, 150.0, 30.0)


def made(name: str, strength: float = 1.0, plant: str = "seven_dof") -> GeneratedCase:
    return _made(name, strength, plant)


@cache
def _made(name: str, strength: float, plant: str) -> GeneratedCase:
    if name in UNLISTED:
        injected = InjectedMismatch(unlisted={name: strength * UNLISTED[name]})
    else:
        injected = InjectedMismatch({name: FULL[name]} if name else {})
    return make_case(name or "clean", injected, 21, plant, seconds=SECONDS)


def result_of(name: str, strength: float = 1.0, plant: str = "seven_dof") -> MismatchResult:
    return _result_of(name, strength, plant)


@cache
def _result_of(name: str, strength: float, plant: str) -> MismatchResult:
    case = made(name, strength, plant)
    return identify_mismatch(case.simulation, case.recording, case.nominal)


def result_with(
    effects: dict[str, dict[str, float]],
    seed: int,
    plant: str = "seven_dof",
    kinds: dict[str, str] | None = None,
    unlisted: dict[str, float] | None = None,
) -> MismatchResult:
    """Return the result on a car with these changes, in a simulator of `plant`."""
    injected = InjectedMismatch(effects, kinds or {}, unlisted or {})
    case = make_case("changed", injected, seed, plant, seconds=SECONDS)
    return identify_mismatch(case.simulation, case.recording, case.nominal)


def claimed(result: MismatchResult) -> list[str]:
    """Return the effects that are named with a confidence of 0.9 or more."""
    return [x.effect.name for x in result.effects if x.confidence >= 0.9]


def test_a_sloshing_load_is_no_soft_tyre() -> None:
    result = result_of("sloshing_load")
    assert result.verdict == UNKNOWN
    assert claimed(result) == []
    assert result.unexplained is not None
    assert "moves sideways at 0.5" in result.unexplained.meaning


def test_an_oscillating_yaw_moment_is_no_yaw_inertia() -> None:
    result = result_of("time_periodic_yaw")
    assert result.verdict == UNKNOWN
    assert claimed(result) == []
    assert result.unexplained is not None
    assert "oscillates in time at 0.28 Hz" in result.unexplained.meaning


def test_a_torque_cut_is_described_with_its_threshold() -> None:
    result = result_of("torque_cut")
    assert result.verdict == UNKNOWN
    assert claimed(result) == []
    assert result.unexplained is not None
    assert result.unexplained.equations[0] == "v_x"
    found = re.search(r"lateral acceleration is above ([\d.]+) m/s²", result.unexplained.text)
    assert found is not None
    assert float(found[1]) == pytest.approx(TORQUE_CUT_FROM, abs=0.2)


def test_downforce_comes_alone() -> None:
    result = result_of("aero_downforce", plant="spring_car")
    assert result.verdict == EXPLAINED
    assert claimed(result) == ["aero_downforce"]


def test_rotating_inertia_is_no_build_tolerance() -> None:
    result = result_of("rotating_inertia")
    assert result.verdict in {EXPLAINED, UNKNOWN}
    if result.verdict == EXPLAINED:
        assert "rotating_inertia" in {x.effect.name for x in result.effects} | {
            name for x in result.effects for name in x.alternatives
        }


def test_rotating_inertia_is_no_pair_of_torque_gain_and_wheel_radius() -> None:
    """Screening leaves it a quarter above the loss that a joint fit reaches."""
    result = result_of("rotating_inertia", plant="spring_car")
    assert result.verdict == EXPLAINED
    (found,) = result.effects
    assert found.effect.name == "rotating_inertia"
    assert found.parameters["inertia"].value == pytest.approx(20.0, rel=0.15)


def test_a_power_limit_of_a_foreign_car_leaves_no_yaw_error() -> None:
    """The yaw moment of its drive ends with the torque that acts, not with the command."""
    result = result_with({"power_limit": FULL["power_limit"]}, 23, MULTI_BODY)
    assert result.verdict == EXPLAINED
    assert [x.effect.name for x in result.effects] == ["power_limit"]


@pytest.mark.parametrize("seed", [22, 23])
def test_a_foreign_car_steers_less(seed: int) -> None:
    """The multi-body model of another project, on both sides."""
    result = result_with({"steering_ratio": {"scale": 0.93}}, seed, MULTI_BODY)
    assert claimed(result) == ["steering_ratio"]
    (found,) = result.effects
    assert found.parameters["scale"].value == pytest.approx(0.93, rel=0.01)


def test_a_foreign_car_has_more_yaw_inertia() -> None:
    result = result_with({"yaw_inertia": {"scale": 1.25}}, 22, MULTI_BODY)
    assert claimed(result) == ["yaw_inertia"]
    (found,) = result.effects
    assert found.parameters["scale"].value == pytest.approx(1.25, rel=0.03)


def test_a_foreign_car_has_softer_tyres() -> None:
    """
    On both axles: what the front tyres do to the yaw rate the rear ones undo.

    An axle's stiffness changes by more than the coefficient (`multibody_changes`).
    """
    result = result_with(
        {"front_tyre_stiffness": {"scale": 0.8}, "rear_tyre_stiffness": {"scale": 0.8}},
        22,
        MULTI_BODY,
    )
    assert result.verdict == EXPLAINED
    assert sorted(claimed(result)) == ["front_tyre_stiffness", "rear_tyre_stiffness"]
    for effect in result.effects:
        assert effect.parameters["scale"].value == pytest.approx(0.79, abs=0.06)


def test_a_foreign_car_is_loaded() -> None:
    result = result_with({"payload": {"mass": 200.0}}, 22, MULTI_BODY)
    assert claimed(result) == ["payload"]
    (found,) = result.effects
    assert found.parameters["mass"].value == pytest.approx(200.0, rel=0.03)


def test_a_foreign_car_without_a_change_is_clean() -> None:
    result = result_with({}, 22, MULTI_BODY)
    assert (result.verdict, result.effects) == (NONE, [])


def test_a_slippery_stretch_lowers_the_held_out_errors() -> None:
    """Further effects that end at their bounds do not hide it."""
    result = result_with(
        {"low_friction": FULL["low_friction"]}, 21, kinds={"low_friction": "place"}
    )
    assert result.verdict == EXPLAINED
    assert claimed(result) == ["low_friction"]
    (found,) = result.effects
    assert found.kind == "place"
    assert found.parameters["mu_scale"].value == pytest.approx(0.6, abs=0.05)
    assert result.held_out is not None
    assert result.held_out.export != NOT_EXPORTED
    ratios = [result.after[state] / before for state, before in result.before.items()]
    assert max(ratios) <= 1.02
    assert min(ratios) < 0.98


def test_brakes_that_pulse_are_episodes() -> None:
    """Their times are said, not that they depend on a constant."""
    result = result_of("phantom_braking")
    assert result.verdict == UNKNOWN
    assert claimed(result) == []
    assert result.unexplained is not None
    assert result.unexplained.equations == ["v_x"]
    said = re.search(r"against time: (\d+) episodes of ([\d.]+) to", result.unexplained.text)
    assert said is not None
    assert int(said[1]) >= 10
    assert "constant" not in sentence(result)


def test_weak_gusts_are_episodes_though_no_reading_shows_one() -> None:
    result = result_of("gust_series", 0.3)
    assert result.verdict == UNKNOWN
    assert result.unexplained is not None
    assert set(result.unexplained.equations) == {"v_y", "yaw_rate"}
    said = re.search(r"against time: (\d+) episodes of", result.unexplained.text)
    assert said is not None
    assert int(said[1]) >= 8


def test_a_weak_formula_is_found_where_all_channels_leave_no_more_than_noise() -> None:
    result = result_of("sloshing_load", 0.3)
    assert result.steps[0].loss < result.expected_loss
    assert result.verdict == UNKNOWN
    assert result.unexplained is not None
    (term,) = result.unexplained.terms
    kind, signal, frequency, _ = term.feature.split(":")
    assert (term.equation, kind, signal) == ("v_y", "resonance", "a_y")
    assert float(frequency) == pytest.approx(SLOSH_FREQUENCY_HZ, rel=0.05)
    clean = result_of("")
    assert (clean.verdict, clean.unexplained, clean.downweighted) == (NONE, None, None)


def test_softer_tyres_do_not_hide_a_swaying_trailer() -> None:
    result = result_of("trailer_sway")
    assert result.verdict == UNKNOWN
    assert result.unexplained is not None
    assert any("resonance" in x.feature for x in result.unexplained.terms)


def test_a_lag_below_the_threshold_is_listed_with_its_size() -> None:
    """Next to larger unexplained pulses, it is no claim."""
    result = result_with({"steering_lag": {"tau": 0.02}}, 21, unlisted={"phantom_braking": 1.0})
    assert result.verdict == UNKNOWN
    assert result.effects == []
    (lag,) = (x for x in result.candidates if x.name == "steering_lag")
    assert lag.parameters["tau"].value == pytest.approx(0.02, rel=0.25)
    assert 0.02 < lag.share < 0.25
    assert re.fullmatch(r"it reduces the loss by \d+; at least \d+ is required", lag.reason)


def test_a_change_in_the_held_out_part_alone_is_not_selected() -> None:
    """Effects are selected on the part before; what they leave later is said."""
    case = made("")
    log = case.recording
    later = log.command_s > log.duration_s * (1.0 - HELD_OUT_SHARE) + 2.0
    command = log.command.copy()
    command[later, 0] *= 1.4
    result = identify_mismatch(case.simulation, replace(log, command=command), case.nominal)
    assert result.effects == []
    assert result.verdict == UNKNOWN
    assert result.unexplained is not None
    assert "v_x" in result.unexplained.equations


def test_a_different_build_is_no_mismatch() -> None:
    result = result_of("")
    assert (result.verdict, result.effects) == (NONE, [])


@pytest.mark.parametrize(
    ("name", "plant"),
    [("sloshing_load", "seven_dof"), ("time_periodic_yaw", "seven_dof"), ("", "seven_dof"),
     ("rotating_inertia", "seven_dof"), ("aero_downforce", "spring_car")],
)  # fmt: skip
def test_no_correction_makes_held_out_data_worse(name: str, plant: str) -> None:
    result = result_of(name, plant=plant)
    for state, before in result.before.items():
        assert result.after[state] <= 1.02 * before, state
    assert not re.search(r"\bnan\b", sentence(result), re.IGNORECASE)
    assert not re.search(r"\bnan\b", str(as_dict(result)), re.IGNORECASE)


def test_every_claim_has_a_probability() -> None:
    for effect in result_of("rotating_inertia").effects:
        total = effect.confidence + sum(
            p for name, p in effect.posterior.items() if name not in effect.alternatives
        )
        assert total == pytest.approx(1.0, abs=2e-3)
        assert np.isfinite(effect.confidence)
