# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which residual is shown against what, and the rows of the page's tables."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.mismatch_report import LAP, NOISE, bank, drag, findings, found, late, odd, series

from adk_ros.mismatch.inference.experiment_design import Discriminability
from adk_ros.mismatch.inference.identifiability import CompetingEffect
from adk_ros.mismatch.inference.likelihood import inactive_effect
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.report import report_tables
from adk_ros.mismatch.report.location_figures import inside, line_of, residual_to_noise
from adk_ros.mismatch.report.residual_trends import (
    BINS,
    EXPLAINS,
    PLACE_BINS,
    VARIABLES,
    active_bins,
    effect_residual_trend,
    feature_residual_trend,
)
from adk_ros.mismatch.report.vocabulary import CHANNEL_TEXTS


def test_drag_is_shown_by_the_accelerometer_against_speed_squared() -> None:
    item = effect_residual_trend(drag().series, drag().effects[0])
    assert item.channel == "imu_a_x"
    assert item.label.startswith("speed squared")
    assert item.at.size == BINS
    assert np.all(np.diff(item.at) >= 0.0)
    slope = np.polyfit(item.at, item.before, 1)[0]
    assert slope == pytest.approx(-5e-4, rel=0.03)
    assert np.abs(item.after).max() < 4.0 * NOISE[0] / np.sqrt(3000 / BINS)
    assert np.all(item.before_sides[0] < item.before)
    assert np.all(item.before < item.before_sides[1])


def test_of_several_each_is_shown_less_itself_alone() -> None:
    plain = drag().series
    alone = replace(plain, without={"aero_drag": 2.0 * plain.before})
    item, both = (effect_residual_trend(s, drag().effects[0]) for s in (plain, alone))
    np.testing.assert_allclose(both.before, 2.0 * item.before)
    np.testing.assert_allclose(both.after, item.after)
    rest = odd().unexplained
    assert rest is not None
    piece = rest.terms[0]
    named = replace(odd().series, without={"yaw_rate:yaw_rate_per_speed": plain.after})
    assert np.abs(feature_residual_trend(named, piece).before).max() < 0.1


def test_a_place_is_shown_along_the_lap() -> None:
    item = effect_residual_trend(bank().series, bank().effects[0])
    assert item.channel == "v_y"
    assert item.at.size == PLACE_BINS
    there = (item.at > 110.0) & (item.at < 190.0)
    assert np.allclose(item.before[there], 0.3, atol=0.02)
    assert np.all(np.abs(item.before[(item.at < 80.0) | (item.at > 220.0)]) < 0.02)


def test_an_onset_leaves_out_what_was_before_it() -> None:
    f = late()
    item = effect_residual_trend(f.series, f.effects[0])
    assert item.channel == "imu_yaw_rate"
    assert item.label.startswith("change of the commanded wheel angle")
    assert np.count_nonzero(active_bins(f.series, [[60.0, 120.0]])) == 1500


def test_where_the_table_is_silent_the_best_variable_is_found(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delitem(EXPLAINS, "aero_drag")
    item = effect_residual_trend(drag().series, found())
    assert item.label in {VARIABLES["speed_squared"].label, VARIABLES["speed"].label}


def test_a_remainder_is_shown_against_its_feature() -> None:
    rest = odd().unexplained
    assert rest is not None
    item = feature_residual_trend(odd().series, rest.terms[0])
    assert item.channel == "imu_yaw_rate"
    assert "r / v_x (1/m)" in item.label
    constant = replace(rest.terms[0], feature="constant")
    assert feature_residual_trend(odd().series, constant).label == "time (s)"


def test_variables_are_finite() -> None:
    s = series("drag")
    for variable in VARIABLES.values():
        assert variable.of(s).shape == s.time_s.shape
        assert np.isfinite(variable.of(s)).all()


def test_noise_is_one_and_laps_lie_over_each_other() -> None:
    s = series()
    assert residual_to_noise(s.after, s.noise).mean() == pytest.approx(1.0, abs=0.03)
    x, y, value = line_of(s, s.time_s)
    assert x.size == y.size == value.size == 151
    assert x[0] == x[-1]
    alone = replace(s, distance=None)
    assert line_of(alone, s.time_s)[2] is s.time_s
    assert inside(np.array([10.0, 300.0, 590.0]), ((550.0, 650.0),), LAP).tolist() == [
        True,
        False,
        True,
    ]


def test_rivals_are_said_to_tie_or_why_they_lost() -> None:
    tied, lost = report_tables.competitor_rows(drag().effects[0])
    assert tied[0] == "wind along the road"
    assert "-4 m/s" in tied[1]
    assert tied[2] == "100 %"
    assert "cannot be told apart" in tied[4]
    assert lost[0] == "payload"
    assert lost[2:] == ["43.8 %", "20,000", "explains a part only"]


def test_tables_say_the_findings() -> None:
    (row,) = report_tables.effect_rows(drag())
    assert row == [
        "air drag",
        "CdA",
        "0.92 m2 (0.88 to 0.97)",
        "",
        "the whole drive, grows with V^2",
        "97 %",
    ]
    assert report_tables.effect_rows(bank())[0][3] == "10.2 %"
    losses = report_tables.loss_rows(drag())
    assert losses[0] == ["nothing but build tolerance", "3.250", "", ""]
    assert losses[1] == ["air drag", "1.025", "35,600", "taken"]
    assert report_tables.error_rows(drag())[0] == ["speed (m/s)", "0.145", "0.012", "92 %"]
    (group,) = report_tables.group_rows(drag())
    assert group[0] == "air drag or wind along the road"
    assert "the same straight in both directions" in group[2]
    rows = report_tables.unexplained_rows(2.0 * NOISE, NOISE, NOISE)
    assert rows[0] == ["a_x, IMU (m/s2)", "0.04", "0.02", "0.02", "1.00"]
    assert len(report_tables.surrogate_rows(drag())) == 6


def test_what_no_manoeuvre_tells_is_to_be_measured() -> None:
    pair = Discriminability("aero_drag", "headwind", "steps of torque", 18.0, 9)
    untold = replace(
        drag(),
        groups=[["drive_torque_gain", "wheel_radius"]],
        discriminability=[
            replace(pair, of="drive_torque_gain", other="wheel_radius"),
        ],
    )
    (group,) = report_tables.group_rows(untold)
    assert "none of 9 simulated manoeuvres" in group[1]
    assert "dynamometer" in group[2]
    assert "turns of the wheel" in group[2]
    assert "step steers" not in group[2]
    told = replace(drag(), discriminability=[replace(pair, loss=500.0)])
    assert "the same straight in both directions" in report_tables.group_rows(told)[0][2]
    assert set(CHANNEL_TEXTS) <= set(EFFECTS)


def test_a_rival_that_ends_at_nothing_shows_no_figure() -> None:
    idle = CompetingEffect(
        "aero_drag", "power_limit", 2e4, inactive_effect(EFFECTS["power_limit"]), False
    )
    shown = report_tables.competitor_rows(replace(found(), competitors=(idle,)))
    assert shown[0][:2] == ["power limit", "next to nothing of it"]


def test_what_was_not_taken_is_said() -> None:
    more = replace(findings(), losses=[("none", 16100.0), ("payload", 16090.0)])
    assert report_tables.loss_rows(more)[1][2:] == ["10", "not taken: gains too little"]
