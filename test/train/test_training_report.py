# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The model report: self-contained, its texts and tables equal to the scores."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from helpers.pages import (
    PROVENANCE,
    Page,
    assert_contents,
    assert_provenance,
    assert_self_contained,
)
from helpers.train import SMALL, record, small

from adk_ros.model.uncertainty.fallback import Fallback
from adk_ros.signals.channels import STATE_NAMES, Flag
from adk_ros.train.dataset import TEST, split_records
from adk_ros.train.held_out import TIE
from adk_ros.train.report_figures import REPORT_UNITS, predictor_label
from adk_ros.train.training_report import FILES, remove_report, write_report
from adk_ros.train.training_run import run_training


@pytest.fixture(scope="module")
def page() -> Page:
    return Page((small().path / "report.html").read_text())


def assert_drawn(content: bytes) -> None:
    image = matplotlib.image.imread(io.BytesIO(content))
    assert min(image.shape[:2]) > 200
    assert np.var(image[..., :3]) > 1e-3
    # Dark pixels all over the picture, more than an empty frame has.
    dark = image[..., :3].min(axis=2) < 0.7
    assert (dark.mean(axis=0) > 0.0).mean() > 0.6
    assert (dark.mean(axis=1) > 0.0).mean() > 0.6


def test_the_page_is_self_contained(page: Page) -> None:
    assert_self_contained(page)
    assert_contents(page)
    assert {"table", "img"} <= page.tags
    assert "Provenance Not recorded." in page.text


def test_the_page_states_its_provenance(tmp_path: Path) -> None:
    page = Page(write_report(small().run, tmp_path, provenance=PROVENANCE).read_text())
    assert_self_contained(page)
    assert_contents(page)
    assert_provenance(page)


def test_the_figures_are_drawn_and_embedded(page: Page) -> None:
    names = ("horizon.png", "prediction.png", "training.png")
    files = [(small().path / name).read_bytes() for name in names]
    for content in files:
        assert_drawn(content)
    assert [content for _, content in page.images] == files


def test_the_table_equals_held_out_json(page: Page) -> None:
    stored = json.loads((small().path / "held_out.json").read_text())
    test = small().run.test
    assert test is not None
    assert stored == test.as_json()
    head, *rows = page.rows
    assert head == [
        "channel",
        "horizon",
        *(predictor_label(name) for name in stored["predictors"]),
        "future commands known / best naive",
        "commands held constant / best naive",
    ]
    cells = iter(rows)
    for c, channel in enumerate(STATE_NAMES):
        for i, horizon in enumerate(stored["horizons_s"]):
            name, when, *values, ratio, held = next(cells)
            assert name == (REPORT_UNITS.labels[c] if i == 0 else "")
            assert when == f"{horizon:g} s"
            for value, of in zip(values, stored["predictors"].values(), strict=True):
                assert value == f"{of[channel]['rmse'][i] * REPORT_UNITS.scale[c]:.4g}"
            assert ratio == f"{stored['ratio_to_best_naive'][channel][i]:.2f}"
            assert held == f"{stored['ratio_to_best_naive_commands_held'][channel][i]:.2f}"
    assert next(cells, None) is None


def test_only_wins_are_bold_and_only_losses_shaded(page: Page) -> None:
    """Each ratio is marked by its own value, also with commands held constant."""
    test = small().run.test
    assert test is not None
    assert (test.ratio_held >= TIE).any()
    classes = iter(page.cell_classes[1:])
    for c in range(3):
        for i in range(test.ratio.shape[0]):
            *others, known, held = next(classes)
            assert set(others) == {""}
            assert known == ("better" if test.ratio[i, c] < TIE else "worse")
            assert held == ("better" if test.ratio_held[i, c] < TIE else "worse")
    assert "td.better, td.bold { font-weight: 700; } td.worse { background" in page.source


def test_the_page_lists_what_takes_over(tmp_path: Path) -> None:
    weights = np.zeros((2, 3, 80, 3))
    weights[1, 0, 79, 2] = 0.5
    for given in (weights, 0.0 * weights):
        run = replace(small().run, model=replace(small().run.model, fallback=Fallback(given)))
        page = Page(write_report(run, tmp_path).read_text())
        said = "yaw_rate, commands held: persistence, weight 0.50 at 2 s"
        assert (said in page.text) == ("Naive predictors take over" in page.text) == given.any()


def test_texts_state_the_scores(page: Page) -> None:
    test = small().run.test
    assert test is not None
    better = int((test.ratio < TIE).sum())
    said = f"better than every naive predictor in {better} of 15 (channel, horizon) combinations"
    assert said in page.text
    held = int((test.ratio_held < TIE).sum())
    assert f"published horizon of the live node, it is better in {held}." in page.text
    v_x, v_y, yaw = test.ratio[3]
    ratios = f"{v_x:.2f} for v_x, {v_y:.2f} for v_y and {yaw:.2f} for yaw rate"
    assert f"its RMSE over that of the best naive predictor is {ratios}." in page.text
    for combination, reason in test.lost.items():
        assert f"{combination}: {reason}" in page.text
    facts = small().run.facts
    assert f"selected checkpoint training step {facts['best_step']} of {SMALL.steps}" in page.text
    assert f"{facts['split']['train']:.0f} s training" in page.text
    assert f"hidden {SMALL.hidden} (width of the hidden layers)" in page.text
    for key, value in facts["settings"].items():
        assert f"{key} {value} (" in page.text
    assert "handling (120 s)" in page.text


def test_names_are_escaped(tmp_path: Path) -> None:
    name = '<b>bold</b> & "quoted"'
    run = small().run
    data = [dict(item, name=name) for item in run.facts["data"]]
    out = tmp_path / "model <i>"
    out.mkdir()
    page = Page(write_report(replace(run, facts=run.facts | {"data": data}), out).read_text())
    assert name in page.text
    assert "model <i>" in page.text
    assert not page.tags & {"b", "i"}


@pytest.mark.slow
@pytest.mark.usefixtures("one_candidate")
def test_a_report_without_scores_says_so(tmp_path: Path) -> None:
    """All held-out samples are flagged as faulty."""
    of = record("handling", 90.0)
    (parts,) = split_records([of]).parts
    faulty = replace(of, flags=np.where(parts == TEST, int(Flag.FROZEN), of.flags))
    settings = replace(SMALL, steps=20, validate_every=10)
    run = run_training([faulty], tmp_path / "m", settings)
    assert run.test is None
    assert run.facts["held_out"] is None
    page = Page(write_report(run, tmp_path / "m").read_text())
    assert "The held-out data are too short to score." in page.text
    assert page.rows == []
    assert len(page.images) == 1
    assert not (tmp_path / "m" / "held_out.json").exists()


def test_the_report_of_an_earlier_training_is_removed(tmp_path: Path) -> None:
    for name in FILES:
        (tmp_path / name).write_text("of another model")
    (tmp_path / "manifest.json").write_text("{}")
    remove_report(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["manifest.json"]
