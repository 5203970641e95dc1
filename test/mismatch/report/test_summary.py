# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Texts of a mismatch result: sizes relative to the simulation, intervals, units, verdict."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from helpers.mismatch_report import bank, drag, identified, late, odd, result_of

from adk_ros.mismatch.inference.confidence import UNLISTED
from adk_ros.mismatch.inference.hypothesis import ActiveEffect
from adk_ros.mismatch.inference.identifiability import CompetingEffect
from adk_ros.mismatch.inference.result import (
    FULL,
    NOT_CHECKED,
    NOT_EXPORTED,
    UNKNOWN,
    HeldOutResult,
    IdentifiedEffect,
    Interval,
    MismatchResult,
    MissingChannel,
    UnexplainedResidual,
)
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.effect import PLACE
from adk_ros.mismatch.report.comparison_labels import characteristic_labels, model_labels
from adk_ros.mismatch.report.effect_text import activation_text, interval_text, number
from adk_ros.mismatch.report.effect_vocabulary import EFFECT_VOCABULARY
from adk_ros.mismatch.report.quantities import Quantity
from adk_ros.mismatch.report.report_tables import error_rows, horizon_rows, judged_model
from adk_ros.mismatch.report.residual_trends import EXPLAINS
from adk_ros.mismatch.report.result_files import as_dict, where_text
from adk_ros.mismatch.report.summary import pair_text, sentence, unexplained_text, verdict_text
from adk_ros.mismatch.report.vocabulary import listed, quantity, title, unit_text

POWER = EFFECT_VOCABULARY["power_limit"].quantities["power"]


def test_every_effect_of_the_catalogue_has_a_vocabulary() -> None:
    assert set(EFFECT_VOCABULARY) == set(EFFECTS)
    for name, effect in EFFECTS.items():
        vocabulary = EFFECT_VOCABULARY[name]
        assert set(vocabulary.quantities) == {p.name for p in effect.parameters}
        assert "_" not in title(name)
        for text in (vocabulary.phrase, vocabulary.opposite):
            assert ("{size}" in text) == (len(effect.parameters) == 1), name


def test_every_effect_can_be_written() -> None:
    for name, effect in EFFECTS.items():
        for value in (0.5, 1.5):
            one = identified(name, value, value - 0.1, value + 0.1)
            said = sentence(result_of("", (one,)))
            assert "{" not in said
            assert "^" not in said
            assert "--" not in said
            assert not effect.sensor or "simulation" not in said.split(". ")[0] or "than" in said


def test_an_effect_without_vocabulary_has_its_name_as_title() -> None:
    assert title("magnus_force") == "magnus force"
    assert quantity("magnus_force", "spin_ratio", "m^2") == Quantity("spin ratio", "m²")


@pytest.mark.parametrize(
    ("unit", "text"),
    [
        ("m/s^2", "m/s²"), ("kg m^2", "kg·m²"), ("N m", "N·m"), ("rad s^2/m", "rad·s²/m"),
        ("m^3/s^6", "m³/s⁶"), ("-", ""), ("grows with V^2", "grows with V²"),
    ],
)  # fmt: skip
def test_units_are_typeset(unit: str, text: str) -> None:
    assert unit_text(unit) == text


def test_an_effect_states_its_size_relative_to_the_simulation_and_its_alternative() -> None:
    assert sentence(drag()) == (
        "The recording shows 0.92 m² more drag area (C_dA) than the simulation (90 % confidence "
        "interval 0.88 to 0.97 m²), or a headwind of 4 m/s: not distinguishable in this "
        "recording. With the corrected vehicle model, the RMS speed error, predicted 1 s ahead on "
        "held-out data, falls from 0.145 to 0.012 m/s."
    )


def test_an_effect_that_is_less_probable_than_not_is_doubted() -> None:
    doubtful = replace(identified(), confidence=0.34, posterior={UNLISTED: 0.6})
    said = sentence(result_of("", (doubtful,)))
    assert said.endswith(
        " The probability of air drag is 34 %: a formula without any known effect describes the "
        "recording better."
    )
    # Where something else is as probable, no formula is blamed.
    other = replace(doubtful, posterior={UNLISTED: 0.1, "headwind": 0.56})
    said = sentence(result_of("", (other,)))
    assert said.endswith(" The probability of air drag is 34 %.")
    assert "probability" not in sentence(result_of("", (identified(),)))


def test_in_a_list_the_alternative_stands_in_its_item() -> None:
    mass = ActiveEffect(EFFECTS["payload"], (170.0,))
    tie = CompetingEffect("brake_torque_gain", "payload", 1.0, mass, True)
    torque = identified(
        "brake_torque_gain", 0.86, 0.85, 0.87, alternatives=["payload"], competitors=(tie,)
    )
    assert (
        "two differences from the simulation: (1) 14 % less brake torque (90 % confidence "
        "interval 13 to 15 %), "
        "or 170 kg more mass: not distinguishable in this recording; (2) 0.92 m² more drag area "
        "(C_dA) (90 % confidence interval 0.88 to 0.97 m²). With the corrected vehicle model"
    ) in sentence(result_of("", (torque, identified())))


def test_no_mismatch_is_stated_with_the_error() -> None:
    said = sentence(result_of())
    assert said.startswith("No significant mismatch: ")
    assert "0.14 m/s" in said
    assert verdict_text(result_of()) == "No significant mismatch"


@pytest.mark.parametrize(
    ("effects", "shown", "titled"),
    [
        ((), "shows no significant difference.", "Not checked by any prediction"),
        (
            (identified(),),
            "shows 0.92 m² more drag area",
            "Not checked by any prediction; 1 effect identified: air drag",
        ),
    ],
)
def test_a_result_that_no_prediction_checks_is_no_all_clear(
    effects: tuple[IdentifiedEffect, ...], shown: str, titled: str
) -> None:
    nothing = dict.fromkeys(("v_x", "v_y", "yaw_rate"), math.nan)
    result = replace(
        result_of("", effects),
        verdict=UNKNOWN,
        unexplained=UnexplainedResidual([], 0.0, NOT_CHECKED, ""),
        before=nothing,
        after=nothing,
    )
    said = sentence(result)
    assert said.startswith("Not checked: no prediction error could be measured")
    assert "give another recording with --held-out" in said
    assert shown in said
    assert "nan" not in said
    assert verdict_text(result) == titled


def test_tolerances_that_explain_the_held_out_part_are_said() -> None:
    none: dict[str, list[float]] = {}
    held_out = HeldOutResult(
        "the last quarter", (1.0,), none, none, none, none, none, 50, True, NOT_EXPORTED,
        tolerances_fitted=True,
    )  # fmt: skip
    fitted = replace(result_of(), held_out=held_out)
    said = sentence(fitted)
    assert said.startswith(
        "No significant mismatch: build tolerances that the training part shows and sensor noise "
        "explain the held-out part (RMS speed error 0.1"
    )
    assert as_dict(fitted)["fit"]["tolerances_fitted"] is True


def refused(
    rejected: dict[str, list[float]] | None, raised: tuple[str, ...] = ("yaw_rate",)
) -> MismatchResult:
    """Return a result whose correction is not exported; `rejected`: the errors with it."""
    before = {"v_x": [0.1, 0.40], "v_y": [0.01, 0.02], "yaw_rate": [0.0017, 0.0019]}
    held_out = HeldOutResult(
        "the last quarter", (0.25, 1.0), before, before, before, before, before, 50, True,
        NOT_EXPORTED, raised, rejected=rejected,
    )  # fmt: skip
    return replace(drag(), held_out=held_out)


def test_what_a_refused_correction_lowers_and_raises_is_said() -> None:
    result = refused({"v_x": [0.02, 0.05], "v_y": [0.01, 0.02], "yaw_rate": [0.0027, 0.0020]})
    assert (
        "No corrected vehicle model is exported: on held-out data it would lower the RMS speed "
        "error 1 s ahead from 0.400 to 0.050 m/s, and raise the RMS yaw rate error 0.25 s ahead "
        "from 0.0017 to 0.0027 rad/s."
    ) in sentence(result)
    written = as_dict(result)["fit"]["horizons"]["0.25"]
    assert written["rejected"]["yaw_rate"] == 0.0027
    assert model_labels(result)[1] == "uncorrected simulation"
    assert characteristic_labels(result)[1] == "with identified effects"


def test_a_refused_correction_has_errors_next_to_its_judgement() -> None:
    rejected = {"v_x": [0.02, 0.05], "v_y": [0.01, 0.02], "yaw_rate": [0.0027, 0.0020]}
    held_out = refused(rejected).held_out
    assert held_out is not None
    first = horizon_rows(held_out)[0]
    assert first[2:6] == ["0.1", "0.1", "0.02", "0.1"]
    assert judged_model(held_out) == "refused correction"
    plain = replace(held_out, rejected=None)
    assert len(horizon_rows(plain)[0]) == len(first) - 1
    assert judged_model(plain) == "simulation"
    assert judged_model(replace(plain, export=FULL)) == "corrected vehicle model"
    assert "training part" in judged_model(replace(plain, tolerances_fitted=True))


def test_a_refused_correction_that_lowers_nothing_is_said() -> None:
    result = refused({"v_x": [0.1, 0.40], "v_y": [0.01, 0.02], "yaw_rate": [0.0017, 0.0022]})
    assert (
        "exported: on held-out data it would raise the RMS yaw rate error 1 s ahead from 0.0019 "
        "to 0.0022 rad/s."
    ) in sentence(result)
    # A part of it raised the error, not all of it.
    of_a_part = refused({"v_x": [0.1, 0.40], "v_y": [0.01, 0.02], "yaw_rate": [0.0017, 0.0019]})
    assert "it would raise the yaw rate error on held-out data." in sentence(of_a_part)
    assert "it would raise the yaw rate error on held-out data." in sentence(refused(None))
    nothing = {"v_x": [0.1, 0.40], "v_y": [0.01, 0.02], "yaw_rate": [0.0017, 0.0019]}
    assert "exported: no part of it lowers the errors on held-out data on the whole." in sentence(
        refused(nothing, ())
    )


def test_an_underfitting_surrogate_makes_the_result_inconclusive() -> None:
    base = result_of()
    off = replace(base, surrogate_error=base.surrogate_error | {"v_x": 0.1})
    said = sentence(off)
    assert "No significant mismatch" not in said
    assert said.startswith("Inconclusive: ")
    assert "does not fit the simulation in odometry speed (0.1 m/s);" in said
    assert verdict_text(off) == "Inconclusive"


def test_place_and_onset_are_stated() -> None:
    assert (
        "a road bank (cross slope) of 10.2 % (5.8°), left side higher, relative to the simulation "
        "(90 % confidence interval 10.0 to 10.4 %), at 100 to 200 m of every lap."
    ) in sentence(bank())
    assert (
        "0.062 s more steering delay than the simulation (90 % confidence interval "
        "0.058 to 0.066 s), from 60.0 s on."
    ) in sentence(late())


def test_a_negative_size_is_positive_in_the_opposite_direction() -> None:
    grade = identified("road_grade", -0.057, -0.058, -0.055)
    assert (
        "a downhill grade of 5.7 % (3.3°) relative to the simulation (90 % confidence interval "
        "5.5 to 5.8 %)"
    ) in sentence(result_of("", (grade,)))


def test_an_error_that_does_not_fall_is_stated() -> None:
    worse = result_of("", (identified(),))
    worse = replace(worse, after=dict(worse.before))
    assert sentence(worse).endswith(
        "The corrected vehicle model does not reduce the RMS speed error, predicted 1 s ahead on "
        "held-out data, from 0.14 m/s."
    )


def test_a_segment_across_the_start_stays_within_the_lap() -> None:
    one = replace(bank().effects[0], segments=((550.0, 640.0), (100.0, 200.0)), lap_m=600.0)
    said = "100 to 200 m and 550 m over the start to 40 m"
    assert activation_text(one) == f"at {said} of every lap"
    assert where_text(one).startswith("local: 100 to 200 m, 550 m over the start to 40 m")
    before = replace(one, segments=((-50.0, 40.0),))
    assert activation_text(before) == "at 550 m over the start to 40 m of every lap"


def test_missing_channels_are_stated_and_not_evaluated() -> None:
    missing = [MissingChannel("an IMU", "no IMU"), MissingChannel("a torque command", "a pedal")]
    base = result_of()
    narrow = replace(base, missing_channels=missing, before=base.before | {"v_x": np.nan})
    assert sentence(narrow).endswith(
        "(RMS yaw rate error 0.005 rad/s, predicted 1 s ahead). Analysed without an IMU "
        "and a torque command."
    )
    unknown = odd()
    nothing = {"v_x": np.nan}
    unknown = replace(
        unknown,
        before=unknown.before | nothing,
        after=unknown.after | nothing,
        missing_channels=missing,
    )
    assert "on held-out data, falls from 0.0050 to 0.0010 rad/s." in sentence(unknown)
    assert error_rows(unknown)[0] == ["speed (m/s)", "not evaluated", "", ""]
    assert as_dict(unknown)["fit"]["before"]["v_x"] is None
    assert as_dict(unknown)["scope"]["lacking"] == ["no IMU", "a pedal"]


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.8, "20 % softer front tyres (cornering stiffness) than the simulation"),
        (1.2, "20 % stiffer front tyres (cornering stiffness) than the simulation"),
    ],
)
def test_more_or_less_than_the_simulation(value: float, text: str) -> None:
    one = identified("front_tyre_stiffness", value, value - 0.04, value + 0.04)
    assert f"{text} (90 % confidence interval 16 to 24 %)" in sentence(result_of("", (one,)))


def test_two_effects_are_counted_and_numbered() -> None:
    slow = identified("steering_lag", 0.1, 0.09, 0.11)
    soft = identified("rear_tyre_stiffness", 0.8, 0.76, 0.84)
    result = result_of("", (slow, soft))
    assert (
        "two differences from the simulation: (1) a steering lag (first-order time constant) that "
        "is 0.10 s longer (90 % confidence interval 0.09 to 0.11 s); (2) 20 % softer rear tyres "
        "(cornering stiffness) (90 % confidence interval 16 to 24 %)"
    ) in sentence(result)
    assert verdict_text(result) == "2 effects identified: steering lag and rear tyre stiffness"


def test_a_sensor_fault_is_not_corrected_in_the_vehicle_model() -> None:
    base = result_of("", (identified("imu_tilt", 0.02, 0.018, 0.022),))
    said = sentence(replace(base, after=base.before))
    assert "a tilted IMU, roll 0.020 rad (0.018 to 0.022) and pitch 0.020 rad" in said
    assert "Sensor faults are not corrected in the vehicle model" in said


def test_a_correction_by_an_effect_that_is_not_claimed_says_so() -> None:
    none: dict[str, list[float]] = {}
    held_out = HeldOutResult(
        "the last quarter", (1.0,), none, none, none, none, none, 50, False, FULL
    )
    result = replace(odd(), held_out=held_out, set_aside=["steering_lag"])
    said = sentence(result)
    assert said.endswith(
        "falls from 0.0050 to 0.0010 rad/s. This correction is by steering lag, which is not "
        "claimed: physics that no known effect describes is more probable."
    )
    assert as_dict(result)["set_aside"] == ["steering_lag"]
    plain = replace(result, held_out=replace(held_out, export=NOT_EXPORTED))
    assert "This correction" not in sentence(plain)


def test_an_unknown_cause_is_stated_with_formula_and_identified_effects() -> None:
    said = sentence(odd(identified()))
    assert "no known effect explains: a yaw acceleration that depends on" in said
    assert ": d(yaw_rate)/dt += -6.1 r / v_x [rad/s²]." in said
    assert "With the corrected vehicle model, the RMS yaw rate error, predicted 1 s ahead" in said
    assert "on held-out data, falls from 0.0050 to 0.0010 rad/s." in said
    assert said.endswith(
        "It also shows 0.92 m² more drag area (C_dA) than the simulation (90 % confidence "
        "interval 0.88 to 0.97 m²)."
    )
    assert verdict_text(odd(identified())) == (
        "Difference of unknown cause; 1 effect identified: air drag"
    )
    assert verdict_text(odd()) == "Difference of unknown cause"
    bare = odd()
    assert bare.unexplained is not None
    meaning = "a mass of about 190 kg moves sideways at 0.52 Hz"
    meant = replace(bare, unexplained=replace(bare.unexplained, meaning=meaning))
    assert f"explains: {meaning}. As a formula: d(yaw_rate)/dt" in sentence(meant)
    both = (*bare.unexplained.terms, replace(bare.unexplained.terms[0], equation="v_y"))
    text = unexplained_text(replace(bare.unexplained, terms=both))
    assert text.startswith("a yaw acceleration and lateral acceleration that depend on")
    nothing = replace(bare, unexplained=replace(bare.unexplained, terms=(), expression=""))
    assert "explains: yaw acceleration against relative wheel-speed" in sentence(nothing)


def test_digits_follow_the_interval() -> None:
    assert number(160.4, 16.0) == "160"
    assert number(45012.0, 2000.0) == "45000"
    assert number(1.136, 0.011) == "1.136"
    assert number(0.5, 0.0) == "0.5"
    assert number(0.5, np.inf) == "0.5"
    assert interval_text(Interval(45e3, 44e3, 46e3, "W"), POWER) == ("45 kW (44 to 46)")
    assert interval_text(Interval(45e3, 40e3, 1e12, "W"), POWER) == ("45 kW (at least 40)")
    assert pair_text(0.145, 0.012) == ("0.145", "0.012")
    # Two errors that differ are not printed as one.
    assert pair_text(0.02321, 0.02268) == ("0.0232", "0.0227")
    assert pair_text(0.023, 0.023) == ("0.023", "0.023")
    assert pair_text(2.0, 1e-5) == ("2.000", "1e-05")
    assert pair_text(0.5, 0.0) == ("0.5", "0")
    assert listed(["a"]) == "a"
    assert listed(["a", "b", "c"], "or") == "a, b or c"


def test_every_effect_that_is_not_only_local_has_variables() -> None:
    assert set(EXPLAINS) <= set(EFFECTS)
    for name in set(EFFECTS) - set(EXPLAINS):
        assert EFFECTS[name].activations == (PLACE,)
