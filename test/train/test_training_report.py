# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The training report: a page that needs nothing but itself, and says what was measured."""

from __future__ import annotations

import base64
import io
import json
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from helpers.train import SMALL, record, small

from adk_ros.signals.channels import STATE_NAMES, Flag
from adk_ros.signals.score import REPORT_SCALE
from adk_ros.train.dataset import TEST, split_records
from adk_ros.train.held_out import TIE
from adk_ros.train.training_report import FILES, remove_report, write_report
from adk_ros.train.training_run import run_training

VOID = {"meta", "img", "br", "hr", "link", "input"}


class Page(HTMLParser):
    """What a browser would meet: tags that match, addresses, images, table, text."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: set[str] = set()
        self.addresses: list[str] = []
        self.rows: list[list[str]] = []
        self.classes: list[str] = []
        self.words: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        given = dict(attrs)
        self.addresses += [given[key] or "" for key in ("src", "href", "srcset") if key in given]
        if tag not in VOID:
            self.open.append(tag)
        if tag == "tr":
            self.rows.append([])
            self.classes.append(given.get("class") or "")
        if tag in {"td", "th"}:
            self.rows[-1].append("")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] in {"td", "th"}:
            self.rows[-1][-1] += data
        if self.open and self.open[-1] != "style":
            self.words.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())


@pytest.fixture(scope="module")
def page() -> Page:
    return Page((small().path / "report.html").read_text())


def pictures(of: Page) -> list[bytes]:
    head = "data:image/png;base64,"
    assert all(address.startswith(head) for address in of.addresses)
    return [base64.b64decode(a.removeprefix(head), validate=True) for a in of.addresses]


def assert_drawn(content: bytes) -> None:
    image = matplotlib.image.imread(io.BytesIO(content))
    assert min(image.shape[:2]) > 200
    assert np.var(image[..., :3]) > 1e-3
    # More than an empty frame: ink all over the picture.
    dark = image[..., :3].min(axis=2) < 0.7
    assert (dark.mean(axis=0) > 0.0).mean() > 0.6
    assert (dark.mean(axis=1) > 0.0).mean() > 0.6


def test_the_page_is_whole_and_stands_by_itself(page: Page) -> None:
    assert page.open == []
    assert {"html", "head", "title", "body", "table", "img"} <= page.tags
    assert not page.tags & {"script", "link", "iframe", "object", "embed", "base"}
    text = (small().path / "report.html").read_text()
    assert "url(" not in text
    assert "http" not in text
    assert "@import" not in text


def test_the_figures_are_drawn_and_embedded(page: Page) -> None:
    names = ("training.png", "horizon.png", "prediction.png")
    files = [(small().path / name).read_bytes() for name in names]
    for content in files:
        assert_drawn(content)
    assert pictures(page) == files


def test_the_table_is_held_out_json(page: Page) -> None:
    told = json.loads((small().path / "held_out.json").read_text())
    test = small().run.test
    assert test is not None
    assert told == test.as_json()
    head, *rows = page.rows
    assert head == [
        "channel",
        "horizon",
        *told["predictors"],
        "known / best naive",
        "held / best naive",
    ]
    cells = iter(rows)
    for c, channel in enumerate(STATE_NAMES):
        for i, horizon in enumerate(told["horizons_s"]):
            name, when, *values, ratio, held = next(cells)
            assert name == (f"{channel} ({'deg/s' if c == 2 else 'km/h'})" if i == 0 else "")
            assert when == f"{horizon:g} s"
            for value, of in zip(values, told["predictors"].values(), strict=True):
                assert value == f"{of[channel]['rmse'][i] * REPORT_SCALE[c]:.4g}"
            assert ratio == f"{told['ratio_to_best_naive'][channel][i]:.2f}"
            assert held == f"{told['ratio_to_best_naive_commands_held'][channel][i]:.2f}"
    assert next(cells, None) is None
    lost = [bool("lost" in name) for name in page.classes[1:]]
    assert lost == [
        bool(v >= TIE) for channel in STATE_NAMES for v in told["ratio_to_best_naive"][channel]
    ]


def test_the_words_fit_the_numbers(page: Page) -> None:
    test = small().run.test
    assert test is not None
    better = int((test.ratio < TIE).sum())
    said = f"Given the commands, better than the best naive predictor in {better} of 15 cells"
    assert said in page.text
    held = int((test.ratio_held < TIE).sum())
    assert f"as the node publishes its horizon, better in {held}." in page.text
    v_x, v_y, yaw = test.ratio[3]
    assert f"its RMSE is {v_x:.2f}, {v_y:.2f} and {yaw:.2f} of the best naive" in page.text
    for cell, why in test.lost.items():
        assert f"{cell}: {why}" in page.text
    facts = small().run.facts
    assert f"state kept step {facts['best_step']} of {SMALL.steps}" in page.text
    assert f"{facts['split']['train']:.0f} s to train" in page.text
    assert f"hidden {SMALL.hidden}" in page.text
    assert "handling (120 s)" in page.text


def test_a_name_is_text_and_not_markup(tmp_path: Path) -> None:
    name = '<b>bold</b> & "quoted"'
    run = small().run
    data = [dict(item, name=name) for item in run.facts["data"]]
    out = tmp_path / "model <i>"
    out.mkdir()
    page = Page(write_report(replace(run, facts=run.facts | {"data": data}), out).read_text())
    assert name in page.text
    assert "model <i>" in page.text
    assert not page.tags & {"b", "i"}


def test_a_report_without_a_test_says_so(tmp_path: Path) -> None:
    """What was to be the test has no stretch without a fault."""
    of = record("handling", 90.0)
    (parts,) = split_records([of]).parts
    faulty = replace(of, flags=np.where(parts == TEST, int(Flag.FROZEN), of.flags))
    settings = replace(SMALL, steps=20, validate_every=10)
    run = run_training([faulty], tmp_path / "m", settings)
    assert run.test is None
    assert run.facts["held_out"] is None
    page = Page(write_report(run, tmp_path / "m").read_text())
    assert "Nothing was held out that is long enough to score." in page.text
    assert page.rows == []
    assert len(pictures(page)) == 1
    assert not (tmp_path / "m" / "held_out.json").exists()


def test_a_report_of_an_earlier_training_does_not_stay(tmp_path: Path) -> None:
    for name in FILES:
        (tmp_path / name).write_text("of another model")
    (tmp_path / "manifest.json").write_text("{}")
    remove_report(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["manifest.json"]
