# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk bench real: terms removed from a model of the car, and their scores."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.calibration import driven, write_streams
from helpers.mismatch import CAR, car, case
from helpers.mismatch_report import identified, result_of

from adk_ros.bench.real import calibrated_model, removed_terms
from adk_ros.bench.real.outcome import score
from adk_ros.bench.real.real_bench import TERMS as TERMS_PART
from adk_ros.bench.real.real_bench import RealBench, bench_real
from adk_ros.bench.real.removed_terms import TERMS, Term, TermOutcome, parts
from adk_ros.bench.real.scores import as_dict, criteria
from adk_ros.bench.real.withheld_attitude import SlopeOutcome
from adk_ros.mismatch.inference.hypothesis import ActiveEffect
from adk_ros.mismatch.inference.identifiability import CompetingEffect
from adk_ros.mismatch.inference.result import MismatchResult
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.mismatch.surrogate.identification import SurrogateModel


def model(**changes: float) -> SurrogateModel:
    p = car(**changes)
    return SurrogateModel(p, np.zeros(6), np.zeros((6, 1)), np.empty((0, p.size)))


def sentence(result: MismatchResult) -> str:
    return result.verdict


def outcome(**changes: object) -> TermOutcome:
    default = TermOutcome(
        vehicle="car",
        recording="drive",
        term="steering_ratio",
        expected=1.2,
        is_named=True,
        is_alone=True,
        estimate=1.22,
        low=1.1,
        high=1.3,
        error=0.1,
        is_inside=True,
        verdict="explained",
        sentence="",
    )
    return replace(default, **changes)  # type: ignore[arg-type]


@pytest.mark.parametrize("term", TERMS, ids=lambda x: x.effect)
def test_the_effect_of_the_expected_size_restores_the_term(term: Term) -> None:
    whole = model(steer_gain=1.1, drag_area=0.8, steer_delay=0.02, stiffness_f=20.0)
    less = term.out_of(whole).parameters
    (parameter,) = EFFECTS[term.effect].parameters
    assert parameter.name == term.parameter
    assert parameter.neutral == term.neutral
    theta = parameter.theta(term.expected(whole))
    restored = less.copy()
    for i, amount in parameter.amounts(theta, less):
        restored[i] += amount
    assert restored[INDEX[term.entry]] == pytest.approx(whole.parameters[INDEX[term.entry]])
    assert np.flatnonzero(less != whole.parameters).tolist() == [INDEX[term.entry]]


def test_the_rest_begins_at_zero() -> None:
    log = case().recording
    stamps_s = np.arange(0.0, log.odometry_s[-1], 0.1)
    attitude = np.stack([0.01 * stamps_s, 0.02 * stamps_s], axis=1)
    log = replace(log, attitude_s=stamps_s, attitude=attitude)
    first, rest = parts(log)
    assert rest.odometry_s[0] < 0.1
    assert 0.0 <= rest.attitude_s[0] < 0.1
    assert rest.attitude_s[-1] < rest.duration_s
    # The attitude belongs to the same moments as before.
    begin_s = 1e-9 * (rest.start_ns - log.start_ns)
    roll = np.interp(rest.odometry_s + begin_s, stamps_s, attitude[:, 0])
    np.testing.assert_allclose(
        np.interp(rest.odometry_s, rest.attitude_s, rest.attitude[:, 0]), roll, atol=1e-9
    )
    assert rest.duration_s == pytest.approx(0.4 * (log.odometry_s[-1] - log.odometry_s[0]))
    assert rest.duration_s > rest.odometry_s[-1]
    assert first.odometry_s.size + rest.odometry_s.size == pytest.approx(
        log.odometry_s.size, abs=2
    )


def outcomes_of(result: MismatchResult, monkeypatch: pytest.MonkeyPatch) -> list[TermOutcome]:
    """Return the outcomes on a short drive, where every analysis has the same result."""
    monkeypatch.setattr(removed_terms, "identify_mismatch", lambda *arguments: result)
    monkeypatch.setattr(calibrated_model, "open_loop_error", lambda *arguments: np.zeros((3, 3)))
    monkeypatch.setattr(calibrated_model, "calibrate_surrogate", _Calibrated)
    found: Iterator[TermOutcome] = removed_terms.removed_term_outcomes(
        "car", case().recording, CAR, sentence, []
    )
    return list(found)


class _Calibrated:
    def __init__(self, *arguments: object, **options: object) -> None:
        self.surrogate = model(drag_area=0.5)
        self.drive = case().recording


def test_what_is_said_is_scored(monkeypatch: pytest.MonkeyPatch) -> None:
    drag = identified("aero_drag", 0.5, 0.4, 0.6)
    nothing, ratio, delay, stiffness, aero = outcomes_of(result_of("", (drag,)), monkeypatch)
    assert nothing.term == ""
    assert nothing.false_claims == ("aero_drag",)
    assert not ratio.is_named
    assert [x.false_claims for x in (ratio, delay, stiffness)] == [("aero_drag",)] * 3
    assert aero.is_named
    assert aero.is_inside
    assert aero.error == pytest.approx(0.0)
    assert aero.false_claims == ()


def test_a_competitor_is_as_uncertain_as_what_it_competes_with(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    drag = EFFECTS["aero_drag"]
    fitted = ActiveEffect(drag, (0.48,))
    competitor = CompetingEffect("rolling_resistance", "aero_drag", 0.5, fitted, True)
    rolling = replace(
        identified("rolling_resistance", 0.01, 0.008, 0.013),
        alternatives=["aero_drag"],
        competitors=(competitor,),
    )
    aero = outcomes_of(result_of("", (rolling,)), monkeypatch)[-1]
    assert aero.is_named
    assert not aero.is_alone
    assert (aero.estimate, aero.low, aero.high) == pytest.approx((0.48, 0.384, 0.624))
    assert aero.is_inside


def test_scores_and_criteria_of_terms_and_slopes() -> None:
    missed = outcome(is_named=False, is_alone=False, error=None, is_inside=False)
    total = score("all", [outcome(error=0.04), missed])
    assert (total.named, total.median_error, total.inside) == (0.5, 0.04, 1.0)
    nothing = replace(missed, term="", verdict="none")
    grade = SlopeOutcome("car", "drive", "grade", 0.97, 1.0, 0.02, True, (0.4, 0.07, 0.06))
    flat = replace(grade, correlation=0.2, is_counted=False)

    def verdicts(*terms: TermOutcome, slope: SlopeOutcome = grade) -> list[str]:
        result = RealBench([], {}, [], list(terms), slopes=[slope, flat])
        assert as_dict(result)["removed_terms"] == [x.as_dict() for x in terms]
        return [x.verdict for x in criteria(result)]

    none, passed = ["NONE"], ["PASS"]
    # Of faults, terms, changed conditions, slopes, predictions and answers.
    assert verdicts(outcome(), nothing) == 3 * none + 3 * passed + 2 * none + 2 * passed + 3 * none
    assert verdicts(missed, nothing)[3:5] == ["FAIL", "FAIL"]
    claimed = replace(nothing, false_claims=("formula",))
    assert verdicts(outcome(), claimed)[5] == "FAIL"
    assert verdicts(nothing, slope=replace(grade, correlation=0.9))[8] == "FAIL"
    assert verdicts(nothing, slope=replace(grade, v_x_error=(0.4, 0.1, 0.06)))[9] == "FAIL"
    # Where the attitude does not remove the error either, something else dominates it.
    assert verdicts(nothing, slope=replace(grade, v_x_error=(0.4, 0.1, 0.1)))[9] == "NONE"


def test_a_vehicle_without_file_is_listed(tmp_path: Path) -> None:
    write_streams(replace(driven("handling", 1, 40.0), imu=None), tmp_path / "car" / "drive")
    result = bench_real(tmp_path, {}, None, (TERMS_PART,))
    assert result.refused == ["car: no vehicle.yaml in its folder: no term is removed"]
    assert not result.outcomes
