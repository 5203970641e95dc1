# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Several recordings in sentence, table, page and JSON file."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.mismatch_report import bank, drag, identified
from helpers.pages import Page, assert_contents

from adk_ros.mismatch.inference.agreement import compared
from adk_ros.mismatch.inference.result import (
    Agreement,
    IdentifiedEffect,
    Interval,
    LeftOutErrors,
    MismatchResult,
    ParameterAgreement,
    RecordingSpan,
)
from adk_ros.mismatch.report.agreement_table import agreement_rows, agreement_text
from adk_ros.mismatch.report.effect_text import activation_text
from adk_ros.mismatch.report.report_page import write_page
from adk_ros.mismatch.report.result_files import as_dict, where_text
from adk_ros.mismatch.surrogate.activation import ROUTE_SPACING_M

pytestmark = pytest.mark.usefixtures("unrendered")

SPANS = (
    RecordingSpan("monday", 0.0, 60.0, 0, 600.0),
    RecordingSpan("tuesday", 60.0, 120.0, 1, 900.0),
    RecordingSpan("friday", 120.0, 180.0, 0, 600.0),
)
ERRORS = LeftOutErrors(
    {"v_x": 0.145, "v_y": 0.018, "yaw_rate": 0.005}, {"v_x": 0.02, "v_y": 0.018, "yaw_rate": 0.005}
)


def size(value: float, half: float = 0.04) -> Interval:
    return Interval(value, value - half, value + half, "m^2")


def row(*values: float | None) -> ParameterAgreement:
    each = tuple(None if x is None else size(x) for x in values)
    return compared("aero_drag", "cda", size(0.8), each, 1)


def agreement(*values: float | None) -> Agreement:
    count = len(values)
    return Agreement(SPANS[:count], (row(*values),), (ERRORS,) * count)


def test_agreeing_recordings() -> None:
    text = agreement_text(agreement(0.91, 0.89))
    assert text.startswith("monday and tuesday agree on the size of air drag")
    assert "p = 0." in text


def test_two_disagreeing_recordings() -> None:
    text = agreement_text(agreement(0.9, 0.4))
    assert "The recordings disagree on drag area" in text
    assert "0.90 m² (0.86 to 0.94) in monday and 0.40 m² (0.36 to 0.44) in tuesday" in text
    assert "p < 0.001" in text


def test_the_recording_that_differs_from_the_others_is_named() -> None:
    text = agreement_text(agreement(0.9, 0.4, 0.92))
    assert text.startswith("tuesday differs in drag area")
    assert "0.40 m² against 0.91 m² in monday and friday" in text


def test_an_effect_in_one_recording_is_not_compared() -> None:
    only = agreement(0.9, None)
    assert "cannot be compared" in agreement_text(only)
    header, rows = agreement_rows(only)
    assert header[2:5] == ["monday", "tuesday", "all recordings"]
    assert rows[0][3] == "does not act"
    assert np.isnan(only.parameters[0].q)


def test_one_recording_or_no_effect_says_nothing() -> None:
    assert agreement_text(None) == ""
    assert agreement_text(Agreement(SPANS, (), ())) == ""


@pytest.mark.parametrize("values", [(0.9, 0.4), (0.9, 0.4, 0.92), (0.9, None)])
def test_page_and_file(values: tuple[float | None, ...], tmp_path: Path) -> None:
    result = replace(drag(), agreement=agreement(*values))
    write_page(result, tmp_path)
    page = Page((tmp_path / "report.html").read_text(encoding="utf-8"))
    assert_contents(page)
    assert "Agreement of the recordings" in page.headings.values()
    assert agreement_text(result.agreement) in page.text
    written = json.loads(json.dumps(as_dict(result)))["agreement"]
    assert [one["name"] for one in written["recordings"]] == [s.name for s in SPANS][: len(values)]
    (parameter,) = written["parameters"]
    assert [x and x["value"] for x in parameter["each"]] == list(values)
    assert parameter["agree"] is (None if None in values else False)
    assert len(written["left_out"]) == len(values)


def test_a_single_recording_has_no_agreement(tmp_path: Path) -> None:
    assert "agreement" not in as_dict(drag())
    write_page(drag(), tmp_path)
    assert "Agreement of the recordings" not in (tmp_path / "report.html").read_text()


def local(*segments: tuple[float, float]) -> IdentifiedEffect:
    one = bank().effects[0]
    return replace(one, segments=segments, recordings=SPANS, lap_m=None)


def test_places_name_their_route() -> None:
    one = local((100.0, 200.0), (ROUTE_SPACING_M + 850.0, ROUTE_SPACING_M + 950.0))
    assert activation_text(one) == (
        "at 100 to 200 m of the route of monday and friday and 850 m over the start to 50 m of "
        "the route of tuesday of every lap"
    )
    assert "route of tuesday" in where_text(one)


@pytest.mark.parametrize(
    ("onset_s", "text"),
    [
        (30.0, "from 30.0 s of monday on"),
        (61.0, "from the start of tuesday on"),
        (59.0, "from the start of tuesday on"),
        (150.0, "from 30.0 s of friday on"),
    ],
)
def test_onsets_name_their_recording(onset_s: float, text: str) -> None:
    one = identified(kind="time", onset_s=onset_s, recordings=SPANS)
    assert activation_text(one) == text
    assert where_text(one) == text


def test_the_map_of_several_routes(tmp_path: Path) -> None:
    base: MismatchResult = bank()
    series = replace(base.series, distance=None)
    result = replace(base, effects=[local((100.0, 200.0))], series=series, lap_m=None, profiles=[])
    write_page(result, tmp_path)
    assert (tmp_path / "map.png").is_file()
