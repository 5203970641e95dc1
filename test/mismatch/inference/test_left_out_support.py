# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What blocks that a fit leaves out do not support is not claimed."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2

from adk_ros.mismatch.inference import formula_choice, left_out_support
from adk_ros.mismatch.inference.confidence import ABSENT
from adk_ros.mismatch.inference.feature_effect import feature_as_effect, feature_terms
from adk_ros.mismatch.inference.hypothesis import ActiveEffect, Hypothesis
from adk_ros.mismatch.inference.identifiability import Identifiability, LeftOutScores
from adk_ros.mismatch.inference.left_out_support import is_formula_supported, least_supported
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.parametric_grid import ParametricGrid
from adk_ros.mismatch.inference.selection_path import SelectionPath
from adk_ros.mismatch.inference.term_meaning import Body
from adk_ros.mismatch.inference.unmodelled import UnmodelledDynamics
from adk_ros.mismatch.library.criteria import (
    FAMILYWISE_ERROR_RATE,
    FEATURE_MIN_GAIN,
    SIGNIFICANT_ODDS,
)
from adk_ros.mismatch.library.features import FEATURES
from adk_ros.mismatch.surrogate.feature_terms import EQUATION_PARAMETERS, FeatureTerm
from adk_ros.numerics.arrays import FloatArray

BLOCKS = 20
LEAST = 2.0 * np.log(SIGNIFICANT_ODDS)


class Known(Likelihood):
    """A likelihood of which only the surrogate's error is known."""

    def __init__(self, surrogate_error: float = 0.0) -> None:
        self._error = surrogate_error

    def surrogate_error_dof(self) -> float:
        return self._error


def gained(per_block: FloatArray) -> Identifiability:
    """Return an effect without which each block (b,) loses so much."""
    absent = LeftOutScores(per_block, 0.0)
    return Identifiability(1e3, (), LeftOutScores(np.zeros(BLOCKS), 0.0), ((ABSENT, absent),))


def even(total: float) -> Identifiability:
    return gained(np.full(BLOCKS, total / BLOCKS))


@pytest.mark.parametrize(
    ("total", "surrogate_error", "supported"),
    [
        (1.01 * LEAST, 0.0, True),
        (0.99 * LEAST, 0.0, False),
        # The surrogate's error repeats on every lap: an error of 1000 halves the evidence.
        (1.9 * LEAST, 1000.0, False),
        (2.1 * LEAST, 1000.0, True),
        (-5.0, 0.0, False),
    ],
)
def test_absence_must_be_twenty_times_less_probable_on_blocks_left_out(
    total: float, surrogate_error: float, supported: bool
) -> None:
    found = least_supported(Known(surrogate_error), {2: even(total), 5: even(1e4)})
    assert found == (None if supported else 2)


def test_a_gain_in_one_block_that_the_others_contradict_is_no_support() -> None:
    """The fit to all data gains 1000 by it; left out, no other block predicts it."""
    per_block = np.full(BLOCKS, -1.0)
    per_block[7] = 10.0
    assert least_supported(Known(), {0: gained(per_block)}) == 0


def test_unusual_tolerances_that_absence_needs_count() -> None:
    """As in the posterior: what the prior charges for them is part of the evidence."""
    for cost, least in ((0.0, 0), (LEAST, None)):
        absent = LeftOutScores(np.full(BLOCKS, 0.01), 1.0 + cost)
        scores = LeftOutScores(np.zeros(BLOCKS), 1.0)
        effect = Identifiability(1e3, (), scores, ((ABSENT, absent),))
        assert least_supported(Known(), {0: effect}) == least


def test_nothing_to_support() -> None:
    assert least_supported(Known(), {}) is None


def fitted(loss: float) -> Hypothesis:
    effect = feature_as_effect("yaw_rate", "speed")
    return Hypothesis((ActiveEffect(effect, (0.1,)),), np.zeros(0), loss)


def left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let each hypothesis have its loss on blocks left out."""

    def of(likelihood: Likelihood, h: Hypothesis) -> LeftOutScores:
        return LeftOutScores(np.full(BLOCKS, h.loss / BLOCKS), 0.0)

    for module in (left_out_support, formula_choice):
        monkeypatch.setattr(module, "LeftOutScores", SimpleNamespace(of=of))


def test_a_formula_must_also_outweigh_the_number_of_formulas(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    left_out(monkeypatch)
    chosen_of = 2.0 * np.log(len(EQUATION_PARAMETERS) * len(FEATURES))
    for terms in (1, 3):
        least = LEAST + terms * chosen_of
        for gain, supported in ((least + 0.1, True), (least - 0.1, False)):
            formula = fitted(1000.0 - gain)
            assert is_formula_supported(Known(), fitted(1000.0), formula, terms) is supported
        # One that was chosen among five by these blocks needs the odds of five.
        formula = fitted(1000.0 - least - 0.1)
        assert not is_formula_supported(Known(), fitted(1000.0), formula, terms, 5)


@pytest.mark.parametrize(("gain", "terms"), [(500.0, 1), (5.0, 0)])
def test_a_formula_without_support_has_no_terms(
    monkeypatch: pytest.MonkeyPatch, gain: float, terms: int
) -> None:
    left_out(monkeypatch)
    start, formula = fitted(1000.0), fitted(1000.0 - gain)
    body = Body(1800.0, 3000.0, 0.3)
    found = UnmodelledDynamics(1.0, (FeatureTerm("yaw_rate", "speed", 0.1, gain),), formula, body)
    monkeypatch.setattr(formula_choice, "fit_feature_expansion", lambda *args: found)
    path = SelectionPath(expected_loss=500.0, null_excess_loss=500.0)
    kept = formula_choice.supported_formula(Known(), start, path, True)
    assert len(kept.terms) == terms
    assert kept.hypothesis is (formula if terms else start)


def test_a_term_without_support_does_not_take_the_others_with_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It gained most in the fit, in one bend, and nothing on blocks left out."""
    left_out(monkeypatch)
    start = replace(fitted(1000.0), effects=())
    effects = [
        ActiveEffect(feature_as_effect("yaw_rate", name), (0.1,)) for name in ("constant", "speed")
    ]
    terms = tuple(
        replace(one, gain=gain)
        for one, gain in zip(feature_terms(effects), (500.0, 70.0), strict=True)
    )
    both = replace(start, effects=tuple(effects), loss=981.0)
    found = UnmodelledDynamics(1.0, terms, both, Body(1800.0, 3000.0, 0.3))
    monkeypatch.setattr(formula_choice, "fit_feature_expansion", lambda *args: found)

    class Refitted(Known):
        def fit(self, effects, nuisances, **_):  # type: ignore[override]
            (active,) = effects
            return Hypothesis(
                (active,), nuisances, 980.0 if "speed" in active.effect.name else 999.0
            )

    path = SelectionPath(expected_loss=500.0, null_excess_loss=500.0)
    kept = formula_choice.supported_formula(Refitted(), start, path, True)
    assert [(one.feature, one.gain) for one in kept.terms] == [("speed", 70.0)]
    assert kept.hypothesis.effects == (effects[1],)


def test_the_least_gain_of_a_feature_keeps_the_familywise_rate() -> None:
    """Of all formulas for four minutes at 15 m/s, with a wave of two degrees of freedom."""
    time = np.arange(0.0, 240.0, 0.025)
    wave = np.sin(0.3 * time)
    signals = {
        "time": time, "v_x": 15.0 + 5.0 * wave, "v_y": 0.2 * wave, "yaw_rate": 0.3 * wave,
        "a_x": 2.0 * wave, "a_y": 4.0 * wave, "torque": 800.0 * wave, "delta": 0.05 * wave,
    }  # fmt: skip
    modified = len(ParametricGrid(signals, list(FEATURES)).names)
    # Frequencies up to 8 Hz of 8 amplitudes, and wavelengths from 1 m of 3, at their resolutions.
    oscillations = 8 * 8 * 240 + 3 * 15 * 240
    count = len(EQUATION_PARAMETERS) * (len(FEATURES) + modified + oscillations)
    assert 4e4 < count < 3e5
    # Doubled, by choice, for what whitening leaves correlated.
    chance = 2.0 * chi2.isf(FAMILYWISE_ERROR_RATE / count, 2)
    assert pytest.approx(chance, rel=0.05) == FEATURE_MIN_GAIN
