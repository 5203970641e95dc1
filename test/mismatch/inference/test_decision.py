# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The choice between catalogue effects and an expression of features."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from adk_ros.mismatch.inference import decision, formula_choice, identified_effects
from adk_ros.mismatch.inference.effect_intervals import confidence_interval
from adk_ros.mismatch.inference.feature_effect import (
    FeatureEffect,
    catalogue_effects,
    feature_as_effect,
    feature_terms,
)
from adk_ros.mismatch.inference.formula_choice import prefers_feature_model
from adk_ros.mismatch.inference.hypothesis import ActiveEffect, Hypothesis, inactive_effect
from adk_ros.mismatch.inference.identifiability import (
    CompetingEffect,
    Identifiability,
    LeftOutScores,
)
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.result import EXPLAINED, NONE, UNKNOWN
from adk_ros.mismatch.inference.selection_path import (
    SelectionPath,
    is_improvement,
    min_required_gain,
    selection_steps,
)
from adk_ros.mismatch.inference.term_meaning import Body
from adk_ros.mismatch.inference.unmodelled import (
    UnmodelledDynamics,
    first_unless_far_behind,
    leading_groups,
    most_parsimonious,
)
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.surrogate.feature_terms import FeatureTerm


def fitted(feature: str, loss: float) -> Hypothesis:
    effect = feature_as_effect("yaw_rate", feature)
    return Hypothesis((ActiveEffect(effect, (0.1,)),), np.zeros(0), loss)


def effects(loss: float, *names: str) -> Hypothesis:
    return Hypothesis(tuple(inactive_effect(EFFECTS[n]) for n in names), np.zeros(0), loss)


def expression(loss: float, *features: str) -> UnmodelledDynamics:
    terms = tuple(FeatureTerm("yaw_rate", f, 1.0, 100.0) for f in features)
    last = fitted(features[-1] if features else "speed", loss)
    return UnmodelledDynamics(1.0, terms, last, Body(1800.0, 3000.0, 0.3))


def test_an_interval_is_wider_where_the_surrogate_is_wrong_about_the_simulator() -> None:
    """A share of its error of 0.4 makes an equation inexact by 0.4 x 15 %, next to 0.8 %."""
    drag = EFFECTS["aero_drag"].parameters[0]
    own, foreign = (confidence_interval(drag, 1.0, 0.0, share) for share in (0.0, 0.4))
    floor = 0.1 * drag.materiality_threshold
    half = [(x.high - x.low) / (2.0 * 1.645) for x in (own, foreign)]
    assert half == pytest.approx([np.hypot(0.008, floor), np.hypot(0.0605, floor)], rel=1e-3)
    nothing = confidence_interval(drag, 0.0, 0.0, 0.4)
    assert (nothing.high - nothing.low) / (2.0 * 1.645) == pytest.approx(floor, rel=1e-3)


def test_shortest_of_tied_features_is_selected() -> None:
    power, torque, cubic = (
        fitted(*x) for x in (("torque_speed", 100.0), ("torque", 104.0), ("delta_cubed", 90.0))
    )
    assert most_parsimonious([power, torque], 20.0) == 1
    assert most_parsimonious([power, torque], 2.0) == 0
    assert most_parsimonious([power, torque, cubic], 5.0) == 2


def test_a_searched_feature_is_tried_next_to_a_plain_one() -> None:
    """A cube gains more than a threshold whose place is not refined yet."""
    cube, beyond = fitted("yaw_rate_cubed", 100.0), fitted("excess:yaw_rate:0.25", 200.0)
    finer, linear = fitted("excess:yaw_rate:0.3", 220.0), fitted("yaw_rate", 300.0)
    assert leading_groups([cube, beyond, finer, linear]) == [[cube, linear], [beyond]]
    assert leading_groups([beyond, cube]) == [[cube], [beyond]]
    assert leading_groups([beyond, finer]) == [[beyond, finer]]
    assert leading_groups([cube, linear]) == [[cube, linear]]


def test_searched_feature_needs_the_lead_of_a_further_feature() -> None:
    plain = fitted("yaw_rate_speed", 2000.0)
    # Its frequency and damping cost 8 each.
    near, far = fitted("resonance:a_y:0.5:0.05", 1400.0), fitted("resonance:a_y:0.5:0.05", 1300.0)
    assert first_unless_far_behind([plain, near], 600.0) is plain
    assert first_unless_far_behind([plain, far], 600.0) is far
    assert first_unless_far_behind([plain], 600.0) is plain


def test_feature_effects_are_a_type_of_their_own() -> None:
    drag = ActiveEffect(EFFECTS["aero_drag"], (0.5,))
    feature = ActiveEffect(feature_as_effect("v_x", "speed_squared", 400.0), (2.0,))
    assert isinstance(feature.effect, FeatureEffect)
    assert feature.effect.name == "v_x:speed_squared"
    assert feature.effect.name not in EFFECTS
    assert catalogue_effects([drag, feature]) == (drag,)
    assert feature_terms([drag, feature]) == (FeatureTerm("v_x", "speed_squared", 0.005, 0.0),)


def test_a_formula_is_sought_where_the_loss_of_all_channels_is_that_of_noise(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """300 of 20,000 is within what noise leaves, and five times what a feature must gain."""
    null = Hypothesis((), np.zeros(0), 20_000.0)
    path = SelectionPath([[null]], expected_loss=20_000.0)
    found = [expression(19_700.0, "yaw_rate"), expression(20_000.0)]
    asked: list[tuple[Any, ...]] = []

    def supported(*arguments: Any) -> UnmodelledDynamics:
        asked.append(arguments)
        return found.pop(0)

    monkeypatch.setattr(formula_choice, "supported_formula", supported)
    likelihood: Any = None
    assert formula_choice.excess_is_small(null, path)
    first, second = found
    assert formula_choice.unmodelled_dynamics(likelihood, path, null, True) == (first, first)
    assert formula_choice.unmodelled_dynamics(likelihood, path, null, True) == (None, None)
    assert asked == [(likelihood, null, path, True)] * 2
    # Not where an effect below its materiality threshold fits as well.
    found.append(first)
    path.immaterial.append(effects(19_700.0, "steering_delay"))
    assert formula_choice.unmodelled_dynamics(likelihood, path, null, True) == (None, None)
    assert not second.terms


def test_a_formula_is_sought_again_beside_the_effects_that_stay(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """An effect that was dropped seemed to leave nothing for a formula."""
    null, both = effects(20_000.0), effects(19_000.0, "payload", "aero_drag")
    path = SelectionPath([[null], [both]], expected_loss=20_000.0)
    stays, nothing = effects(19_100.0, "payload"), effects(20_000.0)
    answers = [
        (decision.Decision(EXPLAINED, [], None, stays, None), True),
        (decision.Decision(NONE, [], None, nothing, None), True),
        (decision.Decision(UNKNOWN, [], None, nothing, None), False),
    ]
    asked: list[tuple[str, ...]] = []

    def decided(likelihood: Any, path: SelectionPath, best: Hypothesis) -> Any:
        asked.append(best.names)
        return answers[len(asked) - 1]

    monkeypatch.setattr(decision, "best_within_bounds", lambda _: both)
    monkeypatch.setattr(decision, "_decided", decided)
    monkeypatch.setattr(decision, "_fit_final", lambda _, left, __: effects(19_100.0, "payload"))
    likelihood: Any = None
    assert decision.decide(likelihood, path).verdict == UNKNOWN
    assert asked == [("payload", "aero_drag"), ("payload",), ()]


def test_the_formula_is_the_answer_where_no_effect_stays(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Held-out data refute one of two effects, and nothing supports the other alone."""
    formula = expression(19_500.0, "speed")
    both, one = (effects(19_000.0, *names) for names in (("payload", "aero_drag"), ("payload",)))
    found = decision.Decision(EXPLAINED, [], None, both, None, formula=formula)
    judged = decision.Decision(EXPLAINED, [], None, one, None)
    monkeypatch.setattr(decision, "_fit_final", lambda *_: one)
    asked: list[Any] = []

    def judge(*arguments: Any) -> Any:
        asked.append(arguments[-1])
        return judged

    monkeypatch.setattr(decision, "_judged", judge)
    likelihood: Any = None
    path = SelectionPath()
    left = decision.reassessed(found, likelihood, path, one.effects, ("aero_drag",))
    assert (left.verdict, left.hypothesis, left.refuted) == (EXPLAINED, one, ("aero_drag",))
    judged = decision.Decision(NONE, [], None, effects(20_000.0), None)
    left = decision.reassessed(found, likelihood, path, one.effects)
    assert (left.verdict, left.unmodelled, left.effects) == (UNKNOWN, formula, [])
    # What held-out data refuted before takes no place later.
    decision.reassessed(replace(left, formula=None), likelihood, path, (), ("payload",))
    decision.reassessed(replace(left, refuted=("aero_drag",)), likelihood, path, ())
    assert asked == [("aero_drag",), (), ("payload",), ("aero_drag",)]


@pytest.mark.parametrize(("excess", "verdict"), [(4_000.0, "none"), (6_000.0, "unknown")])
def test_what_neither_effects_nor_features_reduce_is_said(
    monkeypatch: pytest.MonkeyPatch, excess: float, verdict: str
) -> None:
    """Above a quarter of what noise leaves, no error of the surrogate on another route."""
    null = effects(20_000.0 + excess)
    path = SelectionPath([[null]], expected_loss=20_000.0, null_excess_loss=excess)
    alone = replace(expression(20_000.0 + excess), terms=(), hypothesis=null)
    monkeypatch.setattr(formula_choice, "supported_formula", lambda *_: alone)
    monkeypatch.setattr(decision, "_fit_final", lambda *_: null)
    monkeypatch.setattr(decision, "_canonicalised", lambda _, h: h)
    monkeypatch.setattr(decision, "significant_effects", lambda *_: [])
    found = decision.decide(Unobservable(), path)
    assert (found.verdict, found.effects) == (verdict, [])
    assert (found.unexplained is None) is (verdict == "none")


class Unobservable(Likelihood):
    """A likelihood that is asked for nothing."""

    def __init__(self) -> None:
        pass


@pytest.mark.parametrize(("left", "is_searched"), [(700.0, False), (7000.0, True)])
def test_an_effect_that_leaves_more_than_noise_is_compared_with_searched_features(
    monkeypatch: pytest.MonkeyPatch, left: float, is_searched: bool
) -> None:
    """5 % of what softer tyres explain of a swaying trailer is 30 standard deviations."""
    null = Hypothesis((), np.zeros(0), 160_000.0)
    path = SelectionPath([[null]], expected_loss=20_000.0, null_excess_loss=140_000.0)
    tyres = effects(20_000.0 + left, "rear_tyre_stiffness")
    asked: list[bool] = []

    def supported(*arguments: Any) -> UnmodelledDynamics:
        asked.append(arguments[3])
        return expression(20_100.0, "resonance:yaw_rate_speed:0.7:0.15")

    monkeypatch.setattr(formula_choice, "supported_formula", supported)
    likelihood: Any = None
    assert formula_choice.excess_is_small(tyres, path)
    found, alone = formula_choice.unmodelled_dynamics(likelihood, path, tyres, True)
    assert asked == [is_searched]
    assert alone is not None
    assert (found is alone) is is_searched


def test_one_feature_beats_several_effects() -> None:
    path = SelectionPath(expected_loss=1000.0, null_excess_loss=5000.0)
    pair = effects(1300.0, "rear_wheel_steer", "steering_ratio")
    assert prefers_feature_model(expression(1050.0, "yaw_rate_per_speed"), pair, path)
    # Also where both fit as well: two effects that one term does without only mimic it.
    assert prefers_feature_model(expression(1300.0, "yaw_rate_per_speed"), pair, path)
    # Not where each effect gains what it must, nor with more terms than there are effects.
    assert not prefers_feature_model(expression(1350.0, "yaw_rate_per_speed"), pair, path)
    two = expression(1290.0, "yaw_rate_per_speed", "delta")
    assert not prefers_feature_model(two, pair, path)
    longer = expression(1050.0, "yaw_rate", "delta", "speed")
    assert not prefers_feature_model(longer, pair, path)
    assert not prefers_feature_model(expression(1050.0), pair, path)


def test_a_formula_must_be_better_by_more_than_an_inexact_equation_leaves(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """An arm of a moment that is 0.8 % off leaves 45 of a gain of 700,000."""
    blocks = 16
    losses = {"effect": np.full(blocks, 100.0), "formula": np.full(blocks, 97.0)}

    def of(likelihood: Likelihood, h: Hypothesis) -> LeftOutScores:
        return LeftOutScores(losses["formula"], 0.0)

    monkeypatch.setattr(LeftOutScores, "of", of)

    class NoSurrogateError:
        def surrogate_error_dof(self) -> float:
            return 0.0

    found = Identifiability(7e5, (), LeftOutScores(losses["effect"], 0.0), ())
    two, one = expression(21_882.0, "constant", "speed"), expression(21_882.0, "constant")

    def margin(formula: UnmodelledDynamics, h: Hypothesis, gain: float) -> float:
        likelihood: Any = NoSurrogateError()
        evidence = identified_effects._evidence(likelihood, formula, h, gain)(found)
        return evidence.margins()["unlisted"]

    drag = effects(21_930.0, "brake_drag_one_side")
    assert margin(two, drag, 0.0) == pytest.approx(-48.0)
    assert margin(two, drag, 7e5) == pytest.approx(-48.0 + 140.0)
    # One term contains neither an effect nor two that mimic it.
    assert margin(one, drag, 7e5) == pytest.approx(-48.0)
    both = effects(21_930.0, "brake_drag_one_side", "steering_offset")
    assert margin(two, both, 7e5) == pytest.approx(-48.0)
    with_term = Hypothesis((*drag.effects, *fitted("speed", 0.0).effects), np.zeros(0), 0.0)
    assert margin(two, with_term, 7e5) == pytest.approx(-48.0)


def test_surrogate_error_raises_the_gain_required_of_an_expression() -> None:
    pair = effects(1300.0, "rear_wheel_steer", "steering_ratio")
    feature = expression(1050.0, "yaw_rate_per_speed")
    accurate = SelectionPath(expected_loss=1000.0, null_excess_loss=5000.0)
    inaccurate = SelectionPath(
        expected_loss=1000.0, null_excess_loss=5000.0, surrogate_error_dof=3000.0
    )
    assert prefers_feature_model(feature, pair, accurate)
    assert not prefers_feature_model(feature, pair, inaccurate)


def test_what_an_inexact_equation_leaves_is_no_further_effect() -> None:
    """One with an error of 8 % leaves 0.7 % of what it explains; less is not claimed."""
    path = SelectionPath(expected_loss=20_000.0, null_excess_loss=400_000.0)
    payload = effects(21_500.0, "payload")
    assert min_required_gain(payload, path) == pytest.approx(2800.0, rel=0.1)
    assert not is_improvement(effects(20_000.0, "payload", "low_friction"), payload, path)
    more = effects(25_000.0, "payload")
    assert is_improvement(effects(20_000.0, "payload", "aero_drag"), more, path)


def test_an_inexact_longitudinal_equation_hides_no_lateral_effect() -> None:
    """0.7 % of what a torque lag explains is no measure for a crosswind."""
    path = SelectionPath(expected_loss=20_000.0, null_excess_loss=1_000_000.0)
    path.expected_by_direction = np.array([9000.0, 11_000.0])
    path.null_excess_by_direction = np.array([990_000.0, 10_000.0])

    def split(h: Hypothesis, longitudinal: float) -> Hypothesis:
        return replace(h, losses_by_direction=np.array([longitudinal, h.loss - longitudinal]))

    lag = split(effects(22_000.0, "drive_torque_lag"), 9000.0)
    lateral = split(effects(20_000.0, "drive_torque_lag", "crosswind"), 9000.0)
    assert is_improvement(lateral, lag, path)
    # Nor is a quarter of what its inexact equation leaves.
    inexact = split(effects(42_000.0, "drive_torque_lag"), 29_000.0)
    beside = split(effects(40_000.0, "drive_torque_lag", "crosswind"), 29_000.0)
    assert is_improvement(beside, inexact, path)
    # Where nothing is left to explain to the side, what the torque leaves asks for no less.
    path.surrogate_error_dof = 1000.0
    explained, inexact = split(lag, 11_000.0), split(effects(32_000.0, lag.names[0]), 21_000.0)
    little = [
        split(effects(h.loss - 400.0, *h.names, "crosswind"), x)
        for h, x in ((explained, 11_000.0), (inexact, 21_000.0))
    ]
    assert not is_improvement(little[0], explained, path)
    assert not is_improvement(little[1], inexact, path)
    path.surrogate_error_dof = 0.0
    longitudinal = split(effects(20_000.0, "drive_torque_lag", "aero_drag"), 7000.0)
    assert not is_improvement(longitudinal, lag, path)
    # So the pair with the least loss is not the one that is claimed.
    better = split(effects(19_500.0, "drive_torque_lag", "aero_drag"), 6500.0)
    path.levels = [[split(effects(1_020_000.0), 999_000.0)], [lag], [better, lateral]]
    assert path.best() is lateral
    assert [step.names for step in selection_steps(path)] == [(), lag.names, lateral.names]
    path.levels[2] = [better, longitudinal]
    assert path.best() is lag
    assert selection_steps(path)[2].names == better.names
    # Nor a lateral gain that is within the errors of the lateral equations.
    path.null_excess_by_direction = np.array([500_000.0, 500_000.0])
    assert not is_improvement(lateral, lag, path)
    # Nor next to an effect that acts to the side as well, whose lateral equation is inexact too.
    path.null_excess_by_direction = np.array([990_000.0, 10_000.0])
    payload = split(effects(22_000.0, "payload"), 9000.0)
    friction = split(effects(20_000.0, "payload", "low_friction"), 9000.0)
    assert not is_improvement(friction, payload, path)
    # Nor one that the longitudinal channels pay for.
    path.null_excess_by_direction = np.array([990_000.0, 10_000.0])
    paid = split(effects(21_900.0, "drive_torque_lag", "crosswind"), 10_900.0)
    assert not is_improvement(paid, lag, path)


@pytest.mark.parametrize("exchanges", [0, 1, 3, 4])
def test_competing_effects_are_those_of_the_effect_that_is_named(
    monkeypatch: pytest.MonkeyPatch, exchanges: int
) -> None:
    """Also after the last exchange: an effect is no alternative to itself."""
    chain = ["aero_drag", "headwind", "rolling_resistance", "torque_offset", "drive_torque_gain"]

    class Fitted(Likelihood):
        def __init__(self) -> None:
            """Without any data: fits return what they start from."""

        def fit(self, effects, nuisances, **_):  # type: ignore[override]
            return Hypothesis(tuple(effects), nuisances, 0.0)

    def assessed(likelihood: Likelihood, h: Hypothesis, which: int) -> Identifiability:
        name = h.effects[which].effect.name
        at = chain.index(name)
        better = at < exchanges
        other = chain[at + 1] if better else "payload"
        theta = tuple(p.theta_neutral + 0.5 * (p.bounds()[1] - p.theta_neutral)
                      for p in EFFECTS[other].parameters)  # fmt: skip
        competitor = CompetingEffect(
            name, other, -100.0 if better else 5.0, ActiveEffect(EFFECTS[other], theta), True
        )
        return Identifiability(500.0, (competitor,), LeftOutScores(np.zeros(3), 0.0), ())

    monkeypatch.setattr(decision, "assess_identifiability", assessed)
    monkeypatch.setattr(decision, "significant_effects", lambda _, h, examined: list(h.effects))
    h, found = decision._resolve_competitors(Fitted(), effects(100.0, chain[0]), 1000)
    named = h.effects[0].effect.name
    # Three exchanges at most.
    assert named == chain[min(exchanges, 3)]
    assert found[0].competitors[0].of == named
    assert named not in found[0].alternatives
    # What held-out data refuted takes no place, and is no alternative.
    refuted = chain[1:2] if exchanges else ["payload"]
    h, found = decision._resolve_competitors(Fitted(), effects(100.0, chain[0]), 1000, refuted)
    assert h.effects[0].effect.name == chain[0]
    assert refuted[0] not in [competitor.name for competitor in found[0].competitors]
    # What chance may have made takes no place.
    monkeypatch.setattr(decision, "significant_effects", lambda _, h, examined: [])
    h, found = decision._resolve_competitors(Fitted(), effects(100.0, chain[0]), 1000)
    assert h.effects[0].effect.name == chain[0]
    assert found[0].competitors[0].of == chain[0]
