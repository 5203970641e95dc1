# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Readings of the paper's effect: errors before and after an update, chosen window and cut."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from helpers.model import paper_model
from helpers.train import record

from adk_ros.bench.paper import online_effect
from adk_ros.bench.paper.effect_text import OF_PAPER_EPOCHS, effect_tables, effect_text
from adk_ros.bench.paper.online_effect import (
    A_POSTERIORI,
    INNOVATION,
    LiftedPairs,
    Reading,
    chosen_settings,
    epochs_of,
    printed_reduction,
    rmse,
    study,
)
from adk_ros.bench.paper.paper_results import PAPER_EPOCHS
from adk_ros.bench.paper.predictors import KoopmanPredictor
from adk_ros.model.adaptation.online_methods import RCOND, OnlineSettings
from adk_ros.model.koopman import KoopmanModel

WINDOW = 60


def test_innovations_are_the_errors_of_the_predictor() -> None:
    driven, model = record().rows(slice(0, 200)), paper_model()
    rows = np.arange(8, 190)
    online = OnlineSettings("swls", window=WINDOW)
    predicted = KoopmanPredictor("", model, online).run(driven, rows, rows[:0]).one
    errors = LiftedPairs.of(model, driven).errors(WINDOW, RCOND)
    both = np.isfinite(errors.innovation[rows]).all(axis=1) & np.isfinite(predicted).all(axis=1)
    assert both.sum() > 150
    expected = driven.x[rows + 1] - predicted
    np.testing.assert_allclose(errors.innovation[rows][both], expected[both], rtol=1e-4, atol=1e-5)


def test_an_update_lowers_the_error_of_the_pair_that_it_learns() -> None:
    pairs = LiftedPairs.of(paper_model(), record().rows(slice(0, 200)))
    errors = pairs.errors(WINDOW, RCOND)
    assert errors.resets == 0
    assert (rmse(errors.a_posteriori) < rmse(errors.innovation)).all()
    # phi' P phi <= 1 within the window: the sign of no error changes.
    known = pairs.known
    assert (np.abs(errors.a_posteriori[known]) <= np.abs(errors.innovation[known]) + 1e-9).all()


def test_unlearnable_pairs_are_left_out() -> None:
    driven = record().rows(slice(0, 100))
    x = driven.x.copy()
    x[40] = np.nan
    errors = LiftedPairs.of(paper_model(), replace(driven, x=x)).errors(WINDOW, RCOND)
    for each in (errors.constant, errors.innovation, errors.a_posteriori):
        assert np.isnan(each[39:41]).all()
        assert np.isfinite(each[41:]).any()


def test_the_smallest_innovations_choose(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(online_effect, "WINDOWS", (10, WINDOW))
    monkeypatch.setattr(online_effect, "CUTS", (1e-10, 1e-2))
    pairs = LiftedPairs.of(paper_model(), record().rows(slice(0, 200)))
    best = chosen_settings(pairs)

    def mean(setting: tuple[int, float]) -> float:
        return float(np.log(rmse(pairs.errors(*setting).innovation)).mean())

    every = [(window, cut) for window in (10, WINDOW) for cut in (1e-10, 1e-2)]
    assert best == min(every, key=mean)


def test_a_study_has_every_reading(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(online_effect, "WINDOWS", (WINDOW,))
    monkeypatch.setattr(online_effect, "CUTS", (1e-8,))
    driven = record().rows(slice(0, 400))
    fitted: list[int] = []
    shares: list[float] = []

    def fit(epochs: int, tell: Callable[[float], None]) -> KoopmanModel:
        fitted.append(epochs)
        tell(0.5)
        return paper_model()

    train, test = driven.rows(slice(0, 250)), driven.rows(slice(250, 400))
    readings = study(fit, (6, 90), train, test, (50, RCOND), shares.append)
    assert fitted == [6, 90]
    assert shares == [3 / 96, 51 / 96]
    found = {(x.epochs, x.window, x.cut, x.chosen, x.kind) for x in readings}
    assert found == {
        (epochs, window, cut, chosen, kind)
        for epochs in (6, 90)
        for window, cut, chosen in ((50, RCOND, False), (WINDOW, 1e-8, True))
        for kind in (INNOVATION, A_POSTERIORI)
    }
    table = effect_tables(readings)[0]
    assert len(table.rows) == len(readings)
    assert {len(row) for row in table.rows} == {len(table.header)}


def test_the_run_decides_on_the_epochs() -> None:
    assert list(epochs_of(200)) == [6, 90, 200]
    assert list(epochs_of(80)) == [6, 80]
    assert list(epochs_of(1)) == [1]


def test_the_text_says_which_reading_reproduces_the_paper() -> None:
    def reading(kind: str, share: float, epochs: int = 6) -> Reading:
        left = np.full(3, 1.0 - share / 100.0)
        return Reading(epochs, 50, 1e-10, False, kind, np.ones(3), left, np.ones(3))

    assert printed_reduction().tolist() == pytest.approx([95.0, 91.0, 91.0])
    text = effect_text([reading(INNOVATION, 40.0), reading(A_POSTERIORI, 96.0)])
    assert text[1].startswith("As innovations, no reading reproduces it; nearest: 6 epochs")
    assert "As a-posteriori errors, 1 of 1 readings reproduce it: 6 epochs" in text[2]
    assert effect_text([]) == []
    # The 2000 epochs of the paper: of this run if it has them, else of an earlier one.
    assert text[3:] == [OF_PAPER_EPOCHS]
    long = [reading(INNOVATION, 40.0, PAPER_EPOCHS), reading(A_POSTERIORI, 96.0, PAPER_EPOCHS)]
    assert len(effect_text(long)) == 3
