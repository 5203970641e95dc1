# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Residual trends: channel and variable of each figure; and the rows of the page's tables."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.mismatch_report import (
    LAP,
    NOISE,
    bank,
    drag,
    identified,
    late,
    odd,
    result_of,
    series,
)

from adk_ros.mismatch.inference.experiment_design import Discriminability
from adk_ros.mismatch.inference.hypothesis import ActiveEffect, inactive_effect
from adk_ros.mismatch.inference.identifiability import CompetingEffect
from adk_ros.mismatch.inference.result import Interval, RejectedCandidate, SelectionStep
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.report import report_tables
from adk_ros.mismatch.report.effect_vocabulary import DIRECT_MEASUREMENTS
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


def test_drag_shows_in_the_accelerometer_over_speed_squared() -> None:
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


def test_with_several_effects_each_trend_removes_one_of_them() -> None:
    plain = drag().series
    alone = replace(plain, without={"aero_drag": 2.0 * plain.before})
    item, both = (effect_residual_trend(s, drag().effects[0]) for s in (plain, alone))
    np.testing.assert_allclose(both.before, 2.0 * item.before)
    np.testing.assert_allclose(both.after, item.after)
    unexplained = odd().unexplained
    assert unexplained is not None
    term = unexplained.terms[0]
    named = replace(odd().series, without={"yaw_rate:yaw_rate_per_speed": plain.after})
    assert np.abs(feature_residual_trend(named, term).before).max() < 0.1


def test_a_local_effect_is_drawn_along_the_lap() -> None:
    item = effect_residual_trend(bank().series, bank().effects[0])
    assert item.channel == "v_y"
    assert item.at.size == PLACE_BINS
    there = (item.at > 110.0) & (item.at < 190.0)
    assert np.allclose(item.before[there], 0.3, atol=0.02)
    assert np.all(np.abs(item.before[(item.at < 80.0) | (item.at > 220.0)]) < 0.02)


def test_the_trend_starts_at_the_onset() -> None:
    f = late()
    item = effect_residual_trend(f.series, f.effects[0])
    assert item.channel == "imu_yaw_rate"
    assert item.label.startswith("rate of the commanded road-wheel angle")
    assert np.count_nonzero(active_bins(f.series, [[60.0, 120.0]])) == 1500


def test_without_an_entry_the_best_of_all_variables_is_drawn(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delitem(EXPLAINS, "aero_drag")
    item = effect_residual_trend(drag().series, identified())
    assert item.label in {VARIABLES["speed_squared"].label, VARIABLES["speed"].label}


def test_an_unexplained_residual_is_drawn_over_its_feature() -> None:
    unexplained = odd().unexplained
    assert unexplained is not None
    item = feature_residual_trend(odd().series, unexplained.terms[0])
    assert item.channel == "imu_yaw_rate"
    assert "r / v_x (1/m)" in item.label
    constant = replace(unexplained.terms[0], feature="constant")
    assert feature_residual_trend(odd().series, constant).label == "time (s)"


def test_variables_are_finite() -> None:
    s = series("drag")
    for variable in VARIABLES.values():
        assert variable.of(s).shape == s.time_s.shape
        assert np.isfinite(variable.of(s)).all()


def test_residuals_scale_to_noise_and_laps_are_averaged() -> None:
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


def test_alternatives_tie_or_have_a_reason_for_rejection() -> None:
    tied, lost = report_tables.competitor_rows(drag().effects[0])
    assert tied[0] == "longitudinal wind"
    assert "-4 m/s" in tied[1]
    assert tied[2] == "100 %"
    assert tied[4] == "not distinguishable in this recording"
    assert lost[0] == "payload"
    assert lost[2:] == ["43.8 %", "20,000", "rejected: only a part of the loss reduction"]


def test_table_rows() -> None:
    header, (row, tie) = report_tables.effect_rows(drag().effects)
    assert tie[0] == "or longitudinal wind"
    assert tie[2:] == ["-4 m/s", "not distinguishable", ""]
    assert row == [
        "air drag",
        "drag area C_dA",
        "0.92 m² (0.88 to 0.97)",
        EFFECTS["aero_drag"].where.replace("^2", "²"),
        "0.97",
    ]
    assert len(header) == 5
    header, (row,) = report_tables.effect_rows(bank().effects)
    assert header[3] == "ratio or angle"
    assert row[2:4] == ["10.2 % (10.0 to 10.4)", "5.8°"]
    losses = report_tables.loss_rows(drag())
    assert losses[0] == ["no effect, build tolerance only", "3.250", "", ""]
    assert losses[1] == ["air drag", "1.025", "35,600", "selected"]
    assert report_tables.error_rows(drag())[0] == ["speed (m/s)", "0.145", "0.012", "92 %"]
    (group,) = report_tables.group_rows(drag())
    assert group[0] == "air drag or longitudinal wind"
    assert "the same straight in both directions" in group[2]
    rows = report_tables.unexplained_rows(2.0 * NOISE, NOISE, NOISE)
    assert rows[0] == ["IMU longitudinal acceleration (m/s²)", "0.04", "0.02", "0.02", "1.00"]
    assert len(report_tables.surrogate_rows(drag())) == 6


def test_direct_measurements_are_suggested_where_no_manoeuvre_distinguishes() -> None:
    pair = Discriminability("aero_drag", "headwind", "steps of torque", 18.0, 9)
    undecided = replace(
        drag(),
        groups=[["drive_torque_gain", "wheel_radius"]],
        discriminability=[
            replace(pair, of="drive_torque_gain", other="wheel_radius"),
        ],
    )
    (group,) = report_tables.group_rows(undecided)
    assert "none of 9 simulated manoeuvres" in group[1]
    assert "dynamometer" in group[2]
    assert "wheel revolutions" in group[2]
    assert "step steers" not in group[2]
    decided = replace(drag(), discriminability=[replace(pair, loss=500.0)])
    assert "the same straight in both directions" in report_tables.group_rows(decided)[0][2]
    assert set(DIRECT_MEASUREMENTS) <= set(EFFECTS)


def test_a_negligible_alternative_shows_no_size() -> None:
    idle = CompetingEffect(
        "aero_drag", "power_limit", 2e4, inactive_effect(EFFECTS["power_limit"]), False
    )
    shown = report_tables.competitor_rows(replace(identified(), competitors=(idle,)))
    assert shown[0][:2] == ["power limit", "negligible"]


def test_a_size_at_the_bound_of_its_search_is_marked() -> None:
    fitted = ActiveEffect(EFFECTS["payload"], (1500.0,))
    bound = CompetingEffect("aero_drag", "payload", 2e4, fitted, False)
    (row,) = report_tables.competitor_rows(replace(identified(), competitors=(bound,)))
    assert row[1] == "mass 1500 kg, at the bound of the search"
    low, free = (
        RejectedCandidate(
            "front_tyre_stiffness",
            {"scale": Interval(scale, scale, scale + 0.1, "-")},
            0.4,
            "always",
            "rear_tyre_stiffness fits better",
        )
        for scale in (0.2, 0.7)
    )
    rows = report_tables.candidate_rows(replace(drag(), candidates=[low, free]))
    assert rows[0][1] == "cornering stiffness -80 % (-80 to -70), at the bound of the search"
    assert rows[1][1] == "cornering stiffness -30 % (-30 to -20)"
    assert rows[1][3] == "rear tyre stiffness fits better"
    tau = EFFECTS["steering_lag"].parameters[0]
    assert not report_tables.is_at_bound(tau, 0.0)
    assert report_tables.is_at_bound(tau, tau.high)


def test_sensor_faults_alone_have_no_reduction() -> None:
    tilt = result_of("", (identified("imu_tilt", 0.02, 0.018, 0.022),))
    assert [row[3] for row in report_tables.error_rows(tilt)] == ["not applicable"] * 3


def test_a_rejected_hypothesis_has_a_reason() -> None:
    more = replace(
        result_of(), steps=[SelectionStep((), 16100.0), SelectionStep(("payload",), 16090.0)]
    )
    assert report_tables.loss_rows(more)[1][2:] == ["10", "rejected: gain too small"]
