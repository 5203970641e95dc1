# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sections that open the page: signals, understeer and resistance, questions; and no "nan"."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.mismatch_report import drag, identified, odd, result_of
from helpers.pages import Page, assert_contents, assert_self_contained

from adk_ros.mismatch.inference.asked_effect import AskedEffect, AskedFit
from adk_ros.mismatch.inference.experiment_design import Discriminability
from adk_ros.mismatch.inference.result import HeldOutResult, Interval, MismatchResult
from adk_ros.mismatch.inference.signal_fit import PredictedSignals
from adk_ros.mismatch.inference.steady_state import BLOCKS, Characteristic, CrossPlot, SteadyState
from adk_ros.mismatch.report.asked_text import answer_of, asked_text
from adk_ros.mismatch.report.opening_json import opening_as_dict
from adk_ros.mismatch.report.result_files import as_dict, write_report
from adk_ros.mismatch.report.summary import sentence, verdict_text
from adk_ros.mismatch.report.tolerance_bands import (
    inside,
    resistance_half_width,
    understeer_half_width,
)

pytestmark = pytest.mark.usefixtures("unrendered")

NAN = float("nan")


def signals(hidden: tuple[int, ...] = ()) -> PredictedSignals:
    time_s = np.arange(0.0, 60.0, 0.1)
    measured = np.array([(1.0 + i) * np.sin(0.3 * time_s + i) for i in range(5)])
    measured[list(hidden)] = NAN
    return PredictedSignals(
        "the last 60 s", time_s, measured, measured + 0.2, measured + 0.01, np.full(5, 0.01)
    )


def curve(offset: float) -> CrossPlot:
    x = np.linspace(5.0, 30.0, 8)
    line = np.array([0.01, offset])
    jitter = 1e-4 * np.random.default_rng(1).standard_normal((BLOCKS, 2))
    return CrossPlot(x, 0.01 * x + offset, line, line + jitter)


def characteristic() -> Characteristic:
    measured, simulation = curve(0.2), curve(0.1)
    errors = np.full((2, measured.x.size), 1e-3)
    return Characteristic(measured, simulation, curve(0.2), errors, np.full(8, 0.05), 42.0)


def fit(value: float, **changes: Any) -> AskedFit:
    effect = AskedFit(
        {"tau": Interval(value, value - 0.01, value + 0.01, "s")},
        "always",
        (),
        None,
        30.0,
        40.0,
        0.12,
        True,
        True,
        True,
        {"tau": 0.06},
        1.4,
    )
    return replace(effect, **changes)


def asked(**changes: Any) -> AskedEffect:
    distinguishing = Discriminability("steering_lag", "steering_lag", "a slalom", 100.0, 9)
    one = AskedEffect(
        "steering_lag",
        False,
        "its gain in loss is below the required one",
        ("aero_drag",),
        fit(0.05, gain=400.0),
        fit(0.04),
        "",
        distinguishing,
    )
    return replace(one, **changes)


def shown(*questions: AskedEffect) -> MismatchResult:
    return replace(
        drag(),
        signals=signals(),
        steady_state=SteadyState(characteristic(), characteristic(), 1500.0),
        asked=list(questions),
    )


def test_the_page_opens_with_signals_and_answers(tmp_path: Path) -> None:
    write_report(shown(asked()), tmp_path / "report")
    page = Page((tmp_path / "report" / "report.html").read_text(encoding="utf-8"))
    assert_self_contained(page)
    assert_contents(page)
    assert list(page.headings.values())[:4] == [
        "Summary", "Measured and simulated signals", "Understeer and resistance", "Questions",
    ]  # fmt: skip
    # The verdict in a sentence comes before the signals.
    assert page.source.index('class="lead"') < page.source.index('id="signals"')
    assert "the figure shows the first 40 s (0 to 40 s); the fit is over all of them" in page.text
    assert "Why is steering lag not claimed?" in page.text
    assert "with 1.4 times as much driving of the same kind" in page.text.lower()
    for figure in ("signals.png", "understeer.png", "resistance.png"):
        assert (tmp_path / "report" / figure).is_file()
    written = json.loads((tmp_path / "report" / "mismatch.json").read_text())
    assert written["asked"][0]["added"]["required"] == 40.0
    assert written["signals"]["fit_percent"]["v_x"]["after"] > 98.0
    drag_area = written["steady_state"]["drag_area"]
    assert drag_area["difference"]["value"] == pytest.approx(0.0, abs=1e-6)
    # A new report without them removes the figures.
    write_report(drag(), tmp_path / "report")
    assert not (tmp_path / "report" / "signals.png").exists()


def test_a_figure_of_all_data_says_so(tmp_path: Path) -> None:
    whole = signals()
    short = replace(
        whole,
        time_s=whole.time_s[:251],
        measured=whole.measured[:, :251],
        simulation=whole.simulation[:, :251],
        corrected=whole.corrected[:, :251],
    )
    write_report(replace(drag(), signals=short), tmp_path / "short")
    text = Page((tmp_path / "short" / "report.html").read_text(encoding="utf-8")).text
    assert "the figure shows all (0 to 25 s)" in text


def test_signals_that_are_not_predicted_are_left_out(tmp_path: Path) -> None:
    half = replace(drag(), signals=signals(hidden=(0, 3)))
    write_report(half, tmp_path / "half")
    text = Page((tmp_path / "half" / "report.html").read_text(encoding="utf-8")).text
    assert text.count("not evaluated") == 2
    assert opening_as_dict(half)["signals"]["fit_percent"]["v_x"]["before"] is None
    none = replace(drag(), signals=signals(hidden=(0, 1, 2, 3, 4)))
    write_report(none, tmp_path / "none")
    assert not (tmp_path / "none" / "signals.png").exists()


def test_an_answer_says_size_gain_and_what_would_decide() -> None:
    said = asked_text(asked())
    assert said.startswith("Steering lag is not claimed: its gain in loss is below the required")
    assert "Fitted next to air drag: time constant 0.04 s (0.03 to 0.05)" in said
    assert "fitted value, is 30; a claim requires 40." in said
    assert "claimed from about a steering lag (first-order time constant) that is 0.06 s" in said
    assert "separates it from no effect: a slalom" in said
    heading, verdict, _, rows, needs = answer_of(asked(claimed=True, next_to=(), added=None))
    assert (heading, verdict) == ("steering lag", "claimed")
    assert [row[0] for row in rows] == ["alone"]
    assert len(needs) == 1


def test_an_answer_without_a_fit_gives_the_reason() -> None:
    hidden = AskedEffect("imu_delay", False, "the channels of this recording do not show it")
    assert asked_text(hidden) == (
        "IMU delay is not claimed: the channels of this recording do not show it."
    )
    assert answer_of(hidden).rows == []
    assert opening_as_dict(replace(drag(), asked=[hidden]))["asked"][0]["alone"] is None


def test_a_limit_that_is_never_reached_is_no_number() -> None:
    unlimited = fit(
        0.0, parameters={"power": Interval(1e30, 1e12, 1e12, "W")}, detectable={"power": None}
    )
    one = asked(name="power_limit", next_to=(), alone=unlimited, added=None)
    assert "no limit" in asked_text(one)
    written = opening_as_dict(replace(drag(), asked=[one]))["asked"][0]
    assert written["alone"]["parameters"]["power"]["value"] is None


def test_a_tie_is_named_as_one() -> None:
    assert verdict_text(drag()) == "1 effect identified: air drag or longitudinal wind"
    bank = identified("road_grade", 0.057, 0.055, 0.058)
    assert "5.7 % (3.3°)" in sentence(result_of("", (bank,)))


def test_the_band_widens_with_acceleration_and_steering() -> None:
    plot = characteristic()
    narrow = understeer_half_width(plot, plot.simulation)
    wide = understeer_half_width(
        replace(plot, command_size=plot.command_size * 10.0), plot.simulation
    )
    assert np.all(wide > narrow)
    assert np.all(np.diff(narrow) > 0.0)
    # 5 degrees at the steering wheel are the least.
    assert narrow.min() > np.radians(5.0) / 16.0
    assert resistance_half_width(plot, plot.simulation).min() >= 0.018
    half = np.full(8, 0.05)
    assert not inside(plot.measured, plot.simulation, half, plot.errors[0]).any()
    assert inside(plot.measured, plot.corrected, half, plot.errors[1]).all()


def test_nan_and_none_never_reach_a_person(tmp_path: Path) -> None:
    base = odd(identified(confidence=NAN))
    nothing = {name: [NAN] * 3 for name in ("v_x", "v_y", "yaw_rate")}
    some = {name: [0.1, NAN, 0.3] for name in nothing}
    held_out = HeldOutResult(
        "the end", (0.25, 1.0, 2.0), some, nothing, nothing, nothing, nothing, 9, False, "none"
    )
    unknown = replace(
        base,
        before=dict.fromkeys(base.before, NAN),
        after=dict.fromkeys(base.before, NAN),
        held_out=held_out,
        signals=signals(hidden=(0,)),
        asked=[asked(), asked(alone=None, added=None)],
    )
    for i, result in enumerate((unknown, shown(asked(distinguishing=None)))):
        write_report(result, tmp_path / str(i))
        text = Page((tmp_path / str(i) / "report.html").read_text(encoding="utf-8")).text
        for said in (text, sentence(result), *map(asked_text, result.asked)):
            assert not re.search(r"\b(nan|None|inf|1e\+\d+)\b", said)
        assert "NaN" not in json.dumps(as_dict(result))
