# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk bench range: what a model predicts beyond its training, compared with naive predictors."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.model import make_model
from PIL import Image

from adk_ros.bench.runtime import range_bench
from adk_ros.bench.runtime.range_bench import (
    MAX_RATIO,
    REVERSING,
    PeakMotion,
    RangeCase,
    kinematic,
    measure,
    peak_motion,
    slalom,
    spins,
)
from adk_ros.bench.runtime.range_figure import range_figure, write_range_figure
from adk_ros.cli.main import main
from adk_ros.errors import DataError
from adk_ros.model.training_range import TrainingRange

PEAK = PeakMotion(0.0052, 0.1, 4.0)


def test_kinematic_drives_obey_the_equations_of_motion() -> None:
    for speed, stops in ((-2.5, False), (4.0, True)):
        record = kinematic(speed, 1, stops)
        v_x, v_y, rate = record.x.T
        a_x, a_y = record.a.T
        np.testing.assert_allclose(
            a_x[1:-1], np.gradient(v_x, 0.025)[1:-1] - v_y[1:-1] * rate[1:-1]
        )
        np.testing.assert_allclose(
            a_y[1:-1], np.gradient(v_y, 0.025)[1:-1] + v_x[1:-1] * rate[1:-1]
        )
        # The rear axle does not slip.
        np.testing.assert_allclose(v_y, 1.355 * rate)
        assert (np.sign(v_x[np.abs(v_x) > 0.1]) == np.sign(speed)).all()
        assert np.mean(v_x == 0.0) > 0.3 or not stops


@pytest.mark.slow
def test_a_slalom_stays_on_the_road() -> None:
    record = slalom(160.0, 31, {"mu": 0.3})
    assert 3.6 * record.x[:, 0].max() > 150.0
    assert not spins(record.x, 0.3)


def test_a_spin_is_the_same_angle_at_all_speeds() -> None:
    for v_x in (10.0, 30.0, 45.0, -30.0):
        angle = np.deg2rad([[6.6], [6.8]])
        below, above = (np.column_stack([[v_x], [v_x * np.tan(a)], [0.0]]) for a in angle)
        assert not spins(below, 0.6)
        assert spins(above, 0.6)
        assert spins(below, 0.3)
    assert spins(np.full((2, 3), np.nan), 1.0)


def test_how_hard_a_drive_is() -> None:
    record = kinematic(-2.5, 1, stops=False)
    noisy = range_bench._with_noise(record, 1)
    peak = peak_motion(noisy)
    assert peak.steering == np.abs(record.u[:, 1]).max() == pytest.approx(0.15, abs=1e-3)
    # The rear axle does not slip: tan(beta) = l_r / l tan(delta).
    assert np.tan(peak.sideslip) == pytest.approx(1.355 / 2.67 * np.tan(peak.steering))
    assert peak.lateral_accel == pytest.approx(np.abs(record.a[:, 1]).max())


def test_a_slalom_that_always_spins_is_no_drive(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(range_bench, "spins", lambda x, friction: True)
    driven = SimpleNamespace(x=np.zeros((2, 3)))
    monkeypatch.setattr(range_bench, "simulate", lambda scenario, seed: driven)
    with pytest.raises(DataError, match="spins in a slalom at 160 km/h"):
        slalom(160.0, 31, {})


def test_a_drive_is_measured_against_naive_predictors() -> None:
    record = range_bench._with_noise(kinematic(8.0, 3, stops=False), 3)
    near = TrainingRange(np.full(7, -0.01), np.array([0.1, 9.0, 9.0, 1e5, 1.0, 90.0, 1.6]))
    case = measure(make_model(), near, record, "x", 28.8)
    assert case.known.shape == case.held.shape == (5, 3)
    assert np.isfinite(case.known).all()
    assert case.beyond == 1.0
    assert measure(make_model(), None, record, "x", 28.8).beyond == 0.0
    assert case.above == int((case.known > MAX_RATIO).sum() + (case.held > MAX_RATIO).sum())
    assert json.loads(json.dumps(case.as_dict()))["above"] == case.above
    # Of the rows that count.
    assert case.peak == peak_motion(record.rows(slice(600, None)))
    assert case.as_dict()["peak"]["steering"] == case.peak.steering


def test_the_command_prints_a_verdict_and_draws_the_ratio(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    good = np.full((5, 3), 0.5)
    cases = [
        RangeCase("slalom, friction 1", 100.0, good, good, 0.0, PeakMotion(0.013, 0.05, 4.4)),
        RangeCase("slalom, friction 1", 137.0, good, good, 1.0, PEAK),
        RangeCase(REVERSING, -9.0, good, good, 1.0, PEAK),
    ]
    monkeypatch.setattr(range_bench, "bench_range", lambda *arguments: cases)
    figure = tmp_path / "range.png"
    assert main(["bench", "range", "--model", "m", "--figure", str(figure)]) == 0
    printed = capsys.readouterr().out
    assert "PASS  0 of 90 ratios above 1.02" in printed
    assert {"0.0130", "0.0052", "2.9", "5.7", "4.4"} <= set(printed.split())
    drawn = range_figure(cases).axes[0].get_xlabel()
    assert "steering 0.005 to 0.013 rad" in drawn
    assert "sideslip 2.9 to 5.7°, a_y 4.0 to 4.4 m/s²" in drawn
    assert Image.open(figure).size[0] > 300
    bad = good.copy()
    bad[3, 1] = 1.5
    cases[1] = RangeCase("slalom, friction 1", 137.0, good, bad, 1.0, PEAK)
    assert main(["bench", "range", "--model", "m"]) == 0
    assert "FAIL  1 of 90 ratios above 1.02" in capsys.readouterr().out
    write_range_figure(cases[:1], tmp_path / "one.svg")
    assert "<svg" in (tmp_path / "one.svg").read_text()


def test_useless_options_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = str(tmp_path)
    for option, text in (
        (["--speed", "20"], "--speed 20 is out of range: choose 60 to 200 km/h"),
        (["--figure", "x.gif"], "--figure x.gif: the name must end with .png, .svg, .pdf"),
        (["--figure", "/no/such/x.png"], "--figure /no/such/x.png: the folder does not exist"),
    ):
        assert main(["bench", "range", "--model", model, *option]) == 2
        assert text in capsys.readouterr().err
