# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Held-out errors: what a correct model leaves, which correction is exported, which verdict."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import yaml
from helpers.mismatch import car, case, steady

from adk_ros.errors import DataError
from adk_ros.files.yaml_file import validate
from adk_ros.mismatch import export_choice
from adk_ros.mismatch.analysis import identify_mismatch
from adk_ros.mismatch.deployment.held_out import (
    HORIZONS_S,
    REPORTED_HORIZON,
    Evidence,
    HeldOutErrors,
    check_held_out,
    horizon_errors,
    noise_error,
    persistence_errors,
    rmse,
    without_sensor_faults,
)
from adk_ros.mismatch.deployment.open_loop import ASSIMILATION_GAINS
from adk_ros.mismatch.deployment.raised_errors import (
    improves,
    largest_rise,
    lowers_on_the_whole,
    raised_states,
    significant_rise,
)
from adk_ros.mismatch.deployment.surrogate_file import SurrogateFile
from adk_ros.mismatch.deployment.surrogate_writer import simulation_yaml
from adk_ros.mismatch.export_choice import Correction, choose_correction
from adk_ros.mismatch.inference.decision import Decision
from adk_ros.mismatch.inference.hypothesis import ActiveEffect, Hypothesis
from adk_ros.mismatch.inference.nuisances import N_FIXED_NUISANCES
from adk_ros.mismatch.inference.result import (
    EXPLAINED,
    FULL,
    HALF_TOLERANCES,
    NONE,
    NOT_CHECKED,
    NOT_EXPORTED,
    UNKNOWN,
    WITHOUT_FEATURES,
    WITHOUT_TOLERANCES,
    MismatchResult,
)
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.criteria import INEXACT_EQUATION_SHARE, MAX_EXPLAINED_RATIO
from adk_ros.mismatch.recording.sensor_log import CHANNELS
from adk_ros.mismatch.report.result_files import as_dict
from adk_ros.mismatch.report.summary import sentence
from adk_ros.mismatch.surrogate.activation import Activation
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.mismatch.validation import (
    Validation,
    coherent,
    validate_on_held_out,
)
from adk_ros.mismatch.withdrawal import (
    described_by_errors,
    is_contradicted,
    is_refuted,
    nothing_missing,
    nothing_named,
    withdrawn,
)
from adk_ros.numerics.arrays import FloatArray

SHAPE = (len(HORIZONS_S), 3)


def surrogate(**changes: float) -> SurrogateModel:
    """A surrogate of known parameters, exact on its simulation."""
    n = len(CHANNELS)
    p = car(**changes)
    return SurrogateModel(p, np.zeros(n), np.zeros((n, 100)), np.empty((0, p.shape[0])))


def effect(name: str, *theta: float, activation: Activation | None = None) -> ActiveEffect:
    return ActiveEffect(EFFECTS[name], theta, activation or Activation())


def hypothesis(*effects: ActiveEffect, tolerance: float = 0.0) -> Hypothesis:
    nuisances = np.zeros(N_FIXED_NUISANCES)
    nuisances[0] = tolerance
    return Hypothesis(effects, nuisances, 0.0)


def table(value: float) -> FloatArray:
    return np.full(SHAPE, value)


def errors(before: float, corrected: float, expected: float = 0.02) -> HeldOutErrors:
    """The same error of all states and horizons."""
    return HeldOutErrors(
        table(before), table(corrected), table(1.0), table(expected), table(corrected), 50
    )


def test_noise_error_is_that_of_the_filter() -> None:
    log = case().recording
    random = np.random.default_rng(0)
    sigma = log.noise()[3:]
    state, seen = np.zeros((4000, 3)), np.zeros((4000, 3))
    for _ in range(200):
        seen = random.normal(0.0, sigma, state.shape)
        state += ASSIMILATION_GAINS * (seen - state)
    ahead = state - random.normal(0.0, sigma, state.shape)
    np.testing.assert_allclose(noise_error(log), ahead.std(axis=0), rtol=0.05)


def test_errors_of_one_horizon_are_those_among_several() -> None:
    log, model = case().held_out, surrogate()
    parsed = validate("model", yaml.safe_load(simulation_yaml(model)), SurrogateFile)
    several = horizon_errors(parsed, [Evidence(log)])
    assert rmse(several).shape == SHAPE
    # Starts of the shorter horizon end 1 s later.
    one = horizon_errors(parsed, [Evidence(log)], (1.0,))
    assert one.shape[0] == several.shape[0] + 4
    np.testing.assert_allclose(one[:-4, 0], several[:, 1])
    still = rmse(persistence_errors([Evidence(log)]))
    assert np.all(still[2] > still[0])


def test_evidence_is_the_part_that_is_given() -> None:
    log = case().held_out
    whole = persistence_errors([Evidence(log)])
    part = persistence_errors([Evidence(log, 10.0, 20.0)])
    assert 0 < part.shape[0] < whole.shape[0]
    twice = persistence_errors([Evidence(log, 10.0, 20.0), Evidence(log, 10.0, 20.0)])
    np.testing.assert_array_equal(twice, np.concatenate([part, part]))
    assert persistence_errors([Evidence(log, 1e4)]).shape == (0, *SHAPE)


def test_a_recording_without_motion_is_refused() -> None:
    with pytest.raises(DataError, match="steady: the vehicle is never faster than 3 m/s"):
        check_held_out(steady(speed=1.0))
    check_held_out(steady(speed=10.0))


@pytest.mark.parametrize(
    ("before", "corrected", "explained"),
    [
        (0.02, 0.02, True),
        (0.7, 0.7, False),
        (0.7, 0.02, True),
        (0.27, 0.14, False),
        (0.7, 0.9 * INEXACT_EQUATION_SHARE * 0.7, True),
        (0.04, 0.99 * MAX_EXPLAINED_RATIO * 0.02, True),
    ],
)
def test_errors_are_explained_or_not(before: float, corrected: float, explained: bool) -> None:
    assert errors(before, corrected).is_explained is explained


@pytest.mark.parametrize("verdict", [NONE, EXPLAINED])
def test_no_verdict_hides_an_error(verdict: str) -> None:
    found = [] if verdict == NONE else [object()]
    decision = Decision(verdict, found, None, hypothesis(), None)  # type: ignore[arg-type]
    fine = Validation(errors(0.02, 0.02), FULL, "")
    assert coherent(decision, fine) is decision
    changed = coherent(decision, Validation(errors(0.7, 0.7), FULL, ""))
    assert changed.verdict == UNKNOWN
    assert changed.effects == found
    assert changed.unexplained is not None
    assert "with an error of 0.7 m/s" in changed.unexplained.text
    assert "explain 0.02 m/s" in changed.unexplained.text
    assert changed.unexplained.share == pytest.approx(1.0)


@pytest.mark.parametrize("verdict", [NONE, EXPLAINED])
def test_no_verdict_without_a_prediction(verdict: str) -> None:
    """Where nothing could be measured, nothing is confirmed."""
    found = [] if verdict == NONE else [object()]
    decision = Decision(verdict, found, None, hypothesis(), None)  # type: ignore[arg-type]
    nan = table(np.nan)
    nothing = Validation(HeldOutErrors(nan, nan, nan, nan, nan, 0), NOT_EXPORTED, "")
    changed = coherent(decision, nothing)
    assert changed.verdict == UNKNOWN
    assert changed.effects == found
    assert changed.unexplained is not None
    assert changed.unexplained.text == NOT_CHECKED
    # As uncertain as at the limit of what is explained, not as certain as without any error.
    assert nothing.error_ratio == 1.0
    assert not is_refuted(changed, nothing)


def test_a_recording_that_stands_at_its_end_confirms_nothing() -> None:
    log = case().recording
    late = log.odometry_s > 0.6 * log.duration_s
    odometry = log.odometry.copy()
    odometry[late] = 0.0
    evidence = Evidence(replace(log, odometry=odometry), from_s=0.75 * log.duration_s)
    done = validate_on_held_out(surrogate(), hypothesis(), None, [evidence])
    assert done.errors.starts == 0
    decision = coherent(Decision(NONE, [], None, hypothesis(), None), done)
    assert decision.verdict == UNKNOWN


def test_what_leaves_most_of_the_error_is_refuted() -> None:
    drag = hypothesis(effect("aero_drag", 1.0))
    unknown = Decision(UNKNOWN, [], None, drag, None)
    assert is_refuted(unknown, Validation(errors(0.7, 0.6), FULL, ""))
    assert not is_refuted(unknown, Validation(errors(0.7, 0.3), FULL, ""))
    assert not is_refuted(unknown, Validation(errors(0.02, 0.02), FULL, ""))
    # A correction that raises another error is not exported, and still describes this one.
    kept = Validation(errors(0.7, 0.7), NOT_EXPORTED, "", raised=("v_y",))
    raising = table(0.8)
    raising[:, 0] = 0.03
    assert not is_refuted(unknown, replace(kept, rejected=raising))
    # It must explain that error in full, at every horizon.
    assert is_refuted(unknown, replace(kept, rejected=table(0.1)))
    raising[1, 0] = 0.1
    assert is_refuted(unknown, replace(kept, rejected=raising))
    # A horizon that no prediction reaches says nothing.
    partly = table(0.6)
    partly[-1] = np.nan
    assert is_refuted(unknown, replace(kept, rejected=partly))
    short = errors(0.7, 0.6)
    assert is_refuted(unknown, Validation(replace(short, after=partly), FULL, ""))
    explained = replace(unknown, verdict=EXPLAINED)
    assert not is_refuted(explained, Validation(errors(0.7, 0.6), FULL, ""))
    of_sensor = replace(unknown, hypothesis=hypothesis(effect("gyro_scale", 1.1)))
    assert not is_refuted(of_sensor, Validation(errors(0.7, 0.6), FULL, ""))


def test_effects_that_held_out_data_contradict_are_withdrawn() -> None:
    """Nothing had to be explained, and the correction raises an error beyond chance."""
    tyres = hypothesis(effect("rear_tyre_stiffness", 1.05))
    explained = Decision(EXPLAINED, [], None, tyres, None)
    fine = Validation(errors(0.02, 0.02), NOT_EXPORTED, "", ("yaw_rate",), ("yaw_rate",))
    assert is_contradicted(explained, fine)
    nothing = nothing_missing(hypothesis())
    assert (nothing.verdict, nothing.effects, nothing.unexplained) == (NONE, [], None)
    # Errors that something must explain, a rise that chance may cause, and faults of sensors,
    # which no correction concerns, withdraw nothing.
    large = errors(1.01 * MAX_EXPLAINED_RATIO * 0.02, 0.02)
    assert not is_contradicted(explained, replace(fine, errors=large))
    assert not is_contradicted(explained, replace(fine, contradicted=()))
    of_sensor = hypothesis(effect("rear_tyre_stiffness", 1.05), effect("gyro_scale", 1.1))
    assert not is_contradicted(replace(explained, hypothesis=of_sensor), fine)
    unknown = replace(explained, verdict=UNKNOWN)
    assert not is_contradicted(unknown, fine)
    # A formula next to which nothing had to be explained is such a claim, too.
    assert is_contradicted(replace(unknown, excess_is_small=True), fine)


def test_nothing_is_missing_where_a_weak_formula_is_withdrawn() -> None:
    formula = Decision(UNKNOWN, [], None, hypothesis(effect("aero_drag", 1.0)), None)
    assert withdrawn(formula, hypothesis()).verdict == UNKNOWN
    weak = withdrawn(replace(formula, excess_is_small=True), hypothesis())
    assert (weak.verdict, weak.unexplained) == (NONE, None)
    # Unless the held-out errors show that something is.
    large = Validation(errors(0.7, 0.7), NOT_EXPORTED, "")
    assert coherent(weak, large).verdict == UNKNOWN


def test_a_withdrawn_claim_is_described_by_the_errors() -> None:
    none = hypothesis()
    claimed = Decision(UNKNOWN, [], None, hypothesis(effect("aero_drag", 1.0)), None)
    decision = withdrawn(claimed, none)
    assert nothing_named(decision)
    assert decision.hypothesis is none
    said = described_by_errors(decision, Validation(errors(0.7, 0.7), FULL, ""), "no effect")
    assert said.unexplained is not None
    assert said.unexplained.text.startswith("v_x is predicted with an error of 0.7 m/s")
    assert said.unexplained.text.endswith("; no effect")
    fine = described_by_errors(decision, Validation(errors(0.02, 0.02), FULL, ""), "no effect")
    assert fine.unexplained is not None
    assert fine.unexplained.text == "no effect"


def test_a_correction_that_raises_an_error_is_not_exported() -> None:
    model, evidence = surrogate(), [Evidence(case().held_out)]
    done = validate_on_held_out(model, hypothesis(effect("aero_drag", 8.0)), None, evidence)
    assert done.export == NOT_EXPORTED
    assert "v_x" in done.raised
    assert "v_x" in done.contradicted
    assert done.held_out_yaml == simulation_yaml(model)
    np.testing.assert_array_equal(done.errors.after, done.errors.before)


@pytest.mark.parametrize(("yaw_ratio", "contradicted"), [(0.9, ()), (1.01, ("v_x",))])
def test_a_rise_contradicts_only_what_lowers_no_errors_on_the_whole(
    yaw_ratio: float, contradicted: tuple[str, ...]
) -> None:
    """Nine errors are tested: one alone, 4 % higher, does not outweigh another, 10 % lower."""
    before = np.full((400, 3, 3), 0.01)
    after = before * [1.04, 1.0, yaw_ratio]
    simulation = Correction(NOT_EXPORTED, "plain", before)
    full = hypothesis(effect("load_sensitivity", 0.04))
    chosen = choose_correction(
        simulation, full, lambda part, _: Correction(part, "", after), np.full((3, 3), 0.02), ()
    )
    assert chosen.part == NOT_EXPORTED
    assert chosen.raised == ("v_x",)
    assert chosen.contradicted == contradicted


def test_what_a_refused_correction_explains_is_judged(monkeypatch: pytest.MonkeyPatch) -> None:
    """A drag is there, whether or not its correction raises the yaw rate's error by chance."""
    monkeypatch.setattr(export_choice, "raised_states", lambda *args: ["yaw_rate"])
    monkeypatch.setattr(export_choice, "improves", lambda *args: False)
    c = case("aero_drag", cda=1.0)
    model = replace(surrogate(), parameters=c.nominal.parameters())
    done = validate_on_held_out(
        model, hypothesis(effect("aero_drag", 1.0)), None, [Evidence(c.held_out)]
    )
    assert (done.export, done.raised) == (NOT_EXPORTED, ("yaw_rate",))
    np.testing.assert_array_equal(done.errors.after, done.errors.before)
    assert done.errors.corrected[1, 0] < 0.7 * done.errors.before[1, 0]


def test_only_at_other_horizons_may_an_error_rise_by_chance() -> None:
    rng, expected = np.random.default_rng(0), table(0.016)

    def errors(v_x: float, others: float) -> FloatArray:
        return rng.normal(0.0, 1.0, (110, *SHAPE)) * [v_x, others, others]

    def raised(horizon: int, ratio: float, size: float = 0.01) -> bool:
        before = errors(1.0, size)
        after = before * [0.02, 0.99, 0.99]
        after[:, horizon, 1] = ratio * before[:, horizon, 1]
        return improves(before, after, expected, [])

    assert raised(0, 1.2)  # A fifth larger at every start, but within the noise.
    assert raised(0, 1.01, 0.03)
    assert not raised(0, 1.2, 0.03)
    assert raised(REPORTED_HORIZON, 1.01)
    assert not raised(REPORTED_HORIZON, 1.03)
    # Above the noise, but not significant: another sample of the same size.
    before, after = errors(1.0, 0.02), errors(0.02, 0.015)
    after[:, 0] = before[::-1, 0] * [0.02, 1.05, 1.05]
    assert improves(before, after, expected, [])
    # Nothing above the noise is gained.
    assert not improves(errors(0.01, 0.01), errors(0.009, 0.009), expected, [])


def test_a_rise_is_significant_over_blocks() -> None:
    errors = np.random.default_rng(1).normal(0.0, 1.0, (110, 3))
    assert significant_rise(errors, 1.1 * errors).all()
    assert not significant_rise(errors, errors[::-1]).any()
    assert not significant_rise(errors[:30], 2.0 * errors[:30]).any()
    once = errors.copy()
    once[:5] *= 10.0
    assert not significant_rise(errors, once).any()


def test_tolerances_are_dropped_before_the_effect() -> None:
    c = case("aero_drag", cda=1.0)
    model = replace(surrogate(), parameters=c.nominal.parameters())
    drag, evidence = effect("aero_drag", 1.0), [Evidence(c.held_out)]
    # The car's build is not fitted here: v_y is far off, with and without the drag.
    full = validate_on_held_out(model, hypothesis(drag), None, evidence, ["v_y"])
    assert full.export == FULL
    assert full.errors.after[1, 0] < 0.7 * full.errors.before[1, 0]
    # Tolerances that raise an error are left out; the drag is not.
    done = validate_on_held_out(model, hypothesis(drag, tolerance=0.4), None, evidence, ["v_y"])
    assert done.export == WITHOUT_TOLERANCES
    np.testing.assert_allclose(done.errors.after, full.errors.after)


def choice_with(errors_of: dict[str, float], *effects: ActiveEffect) -> Correction:
    """Return the choice among parts with the given errors; those not named are twice as bad."""
    simulation = Correction(NOT_EXPORTED, "", np.full((40, *SHAPE), 0.1))

    def evaluate(part: str, _: Hypothesis) -> Correction:
        return Correction(part, part, np.full((40, *SHAPE), errors_of.get(part, 0.2)))

    return choose_correction(
        simulation, hypothesis(*effects, tolerance=0.1), evaluate, table(0.02), []
    )


def test_the_largest_part_that_lowers_the_errors_is_exported() -> None:
    drag = effect("aero_drag", 1.0)
    assert choice_with({FULL: 0.05, HALF_TOLERANCES: 0.01}, drag).part == FULL
    assert choice_with({HALF_TOLERANCES: 0.05, WITHOUT_TOLERANCES: 0.01}, drag).part == (
        HALF_TOLERANCES
    )
    assert choice_with({WITHOUT_TOLERANCES: 0.05}, drag).part == WITHOUT_TOLERANCES
    none = choice_with({FULL: 0.101, HALF_TOLERANCES: 0.1005, WITHOUT_TOLERANCES: 0.1}, drag)
    assert none.part == NOT_EXPORTED
    assert none.refused is not None
    assert (none.raised, none.refused.part) == ((), FULL)
    assert choice_with({FULL: 0.05}, drag).refused is None
    assert choice_with({}, drag).raised == ("v_x", "v_y", "yaw_rate")
    # Where nothing is missing, or only a sensor is at fault, there is nothing to correct.
    better = {FULL: 0.01}
    bias = effect("imu_bias", 0.1, 0.0)
    assert choice_with(better).part == NOT_EXPORTED
    assert choice_with(better, bias).part == NOT_EXPORTED
    assert choice_with(better, bias, drag).part == FULL


def test_a_rise_at_any_horizon_counts() -> None:
    after = table(0.05)
    after[0, 1] = 0.103
    assert raised_states(table(0.1), after, []) == ["v_y"]
    assert raised_states(table(0.1), after, ["v_y"]) == []
    assert largest_rise(table(0.1), after, []) == pytest.approx(1.03)
    assert lowers_on_the_whole(table(0.1), after, [])
    assert not lowers_on_the_whole(table(0.1), table(0.1), [])


def test_a_state_without_evidence_is_not_judged() -> None:
    done = validate_on_held_out(
        surrogate(), hypothesis(), None, [Evidence(case().held_out)], ["v_x"]
    )
    assert np.isnan(done.errors.before[:, 0]).all()
    assert "v_x" not in done.errors.unexplained_states()


def test_sensor_faults_are_removed() -> None:
    log = case().held_out
    faulty = replace(log, odometry=log.odometry * [1.05, 1.0, 1.0])
    restored = without_sensor_faults(faulty, [effect("odometry_scale", 1.05)])
    np.testing.assert_allclose(restored.odometry, log.odometry)
    late = without_sensor_faults(log, [effect("clock_offset", 0.1)])
    np.testing.assert_allclose(late.command_s, log.command_s + 0.1)
    from_20 = Activation(onset_s=20.0)
    part = without_sensor_faults(faulty, [effect("odometry_scale", 1.05, activation=from_20)])
    before = log.odometry_s < 20.0
    np.testing.assert_array_equal(part.odometry[before], faulty.odometry[before])
    np.testing.assert_allclose(part.odometry[~before], log.odometry[~before])


def test_the_gyro_replaces_a_filtered_yaw_rate() -> None:
    log = case().held_out
    slow = replace(log, odometry=log.odometry * [1.0, 1.0, 0.0])
    restored = without_sensor_faults(slow, [effect("odometry_filter", 0.25)])
    # Noise of both sensors is left.
    noise = np.hypot(log.noise()[2], log.noise()[5])
    assert np.std(restored.odometry[:, 2] - log.odometry[:, 2]) < 2.0 * noise
    np.testing.assert_array_equal(restored.odometry[:, :2], log.odometry[:, :2])
    blind = replace(slow, imu_s=np.empty(0), imu=np.empty((0, 3)))
    assert without_sensor_faults(blind, [effect("odometry_filter", 0.25)]) is blind


@cache
def torque_cut() -> MismatchResult:
    """A car whose drive torque is cut by 60 % in curves; its simulator does not know."""
    c = case()
    log = c.recording
    a_y = np.abs(np.interp(log.command_s, log.odometry_s, log.odometry[:, 0] * log.odometry[:, 2]))
    command = log.command.copy()
    cut = (a_y > 3.0) & (command[:, 0] > 0.0)
    assert 0.05 < cut.mean() < 0.6
    # The car is the same; what was commanded is more than what the wheels got.
    command[cut, 0] /= 0.4
    return identify_mismatch(c.simulation, replace(log, command=command), c.nominal)


@pytest.mark.slow
def test_what_is_not_explained_is_said() -> None:
    result = torque_cut()
    assert result.verdict == UNKNOWN
    assert result.unexplained is not None
    assert "No significant mismatch" not in sentence(result)
    for name in ("v_x", "v_y", "yaw_rate"):
        assert result.after[name] <= 1.02 * result.before[name]


@pytest.mark.slow
def test_the_result_lists_horizons_and_candidates() -> None:
    answer = as_dict(torque_cut())
    assert set(answer["fit"]["horizons"]) == {"0.25", "1", "2"}
    one = answer["fit"]["horizons"]["1"]
    assert one["before"]["v_x"] == answer["fit"]["before"]["v_x"]
    assert answer["fit"]["data"].startswith("the last ")
    assert answer["fit"]["exported"] in {
        FULL,
        HALF_TOLERANCES,
        WITHOUT_TOLERANCES,
        WITHOUT_FEATURES,
        NOT_EXPORTED,
    }
    assert answer["fit"]["sizes_from"] == "all data"
    assert answer["candidates"]
    for candidate in answer["candidates"]:
        assert candidate["not_claimed_because"]
        assert candidate["parameters"]
