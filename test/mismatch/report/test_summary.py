# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The answer of the mismatch tool in words: read aloud, with values, intervals and units."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.mismatch_report import bank, drag, findings, found, late, odd

from adk_ros.mismatch.inference.result import Interval, MissingChannel
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.effect import PLACE
from adk_ros.mismatch.report.report_tables import error_rows
from adk_ros.mismatch.report.residual_trends import EXPLAINS
from adk_ros.mismatch.report.result_files import as_dict, where_text
from adk_ros.mismatch.report.summary import (
    activation_text,
    interval_text,
    number,
    pair_text,
    sentence,
)
from adk_ros.mismatch.report.vocabulary import EFFECT_VOCABULARY, Quantity, listed, quantity, title


def test_every_effect_of_the_catalogue_has_words() -> None:
    assert set(EFFECT_VOCABULARY) == set(EFFECTS)
    for name, effect in EFFECTS.items():
        assert set(EFFECT_VOCABULARY[name].quantities) == {p.name for p in effect.parameters}
        assert "_" not in title(name)


def test_an_effect_without_words_is_said_all_the_same() -> None:
    assert title("magnus_force") == "magnus force"
    assert quantity("magnus_force", "spin_ratio", "m^2") == Quantity("spin ratio", "m2")


def test_drag_is_said_as_one_would_say_it() -> None:
    assert sentence(drag()).startswith(
        "The recording has air drag that the simulation lacks: CdA 0.92 m2 (0.88 to 0.97); "
        "the 1 s speed error falls from 0.145 to 0.012 m/s."
    )


def test_what_the_drive_cannot_tell_is_said() -> None:
    assert sentence(drag()).endswith("This drive cannot tell air drag from wind along the road.")


def test_nothing_is_said_plainly() -> None:
    said = sentence(findings())
    assert said.startswith("Nothing material is missing from the simulation")
    assert "0.14 m/s" in said


def test_nothing_is_not_said_plainly_where_the_simulation_was_not_met() -> None:
    plain = findings()
    off = replace(plain, surrogate_error=plain.surrogate_error | {"v_x": 0.1})
    said = sentence(off)
    assert "Nothing material" not in said
    assert "misses the simulation's own recording in v_x, odometry (0.1 m/s)," in said


def test_a_place_and_an_onset_are_said() -> None:
    assert "left side up by 0.102 rad (0.100 to 0.104), at 100 to 200 m of every lap;" in sentence(
        bank()
    )
    assert "delay 0.062 s (0.058 to 0.066), from 60.0 s on;" in sentence(late())


def test_a_stretch_over_the_laps_end_stays_within_the_lap() -> None:
    one = replace(bank().effects[0], segments=((550.0, 640.0), (100.0, 200.0)), lap_m=600.0)
    said = "100 to 200 m and 550 m over the start to 40 m"
    assert activation_text(one) == f"at {said} of every lap"
    assert where_text(one).startswith("at a place: 100 to 200 m, 550 m over the start to 40 m")
    before = replace(one, segments=((-50.0, 40.0),))
    assert activation_text(before) == "at 550 m over the start to 40 m of every lap"


def test_what_lacks_is_said_and_what_is_not_judged_is_no_number() -> None:
    lacks = [MissingChannel("an IMU", "no IMU"), MissingChannel("a torque command", "a pedal")]
    plain = findings()
    narrow = replace(plain, missing_channels=lacks, before=plain.before | {"v_x": np.nan})
    assert sentence(narrow).endswith(
        "(1 s yaw rate error 0.005 rad/s). The recording is judged without an IMU and a torque "
        "command."
    )
    told = odd()
    nothing = {"v_x": np.nan}
    told = replace(
        told, before=told.before | nothing, after=told.after | nothing, missing_channels=lacks
    )
    assert "the 1 s yaw rate error falls from 0.0050 to 0.0010 rad/s." in sentence(told)
    assert error_rows(told)[0] == ["speed (m/s)", "not judged", "", ""]
    assert as_dict(told)["fit"]["before"]["v_x"] is None
    assert as_dict(told)["scope"]["lacking"] == ["no IMU", "a pedal"]


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (0.8, "softer front tyres than the simulation: slip stiffness 0.80 of the simulation's "),
        (1.2, "stiffer front tyres than the simulation: slip stiffness 1.20 of the simulation's "),
    ],
)
def test_more_or_less_than_the_simulation(value: float, said: str) -> None:
    one = found("front_tyre_stiffness", value, value - 0.04, value + 0.04)
    assert said in sentence(findings("", (one,)))


def test_two_things_are_counted() -> None:
    slow = found("steering_lag", 0.1, 0.09, 0.11)
    soft = found("rear_tyre_stiffness", 0.8, 0.76, 0.84)
    assert (
        "two things that the simulation lacks: (1) a steering that lags (first order), time "
        "constant 0.10 s (0.09 to 0.11); (2) softer rear tyres, slip stiffness 0.80"
    ) in sentence(findings("", (slow, soft)))


def test_a_sensors_fault_is_no_physics_of_the_car() -> None:
    plain = findings("", (found("imu_tilt", 0.02, 0.018, 0.022),))
    said = sentence(replace(plain, after=plain.before))
    assert "an IMU mounted askew: roll 0.020 rad" in said
    assert "a sensor's fault is not corrected into the car" in said


def test_the_unknown_is_said_with_its_formula_and_what_is_known_beside_it() -> None:
    said = sentence(odd(found()))
    assert "no known effect explains: a yaw acceleration that goes with" in said
    assert "as d(yaw_rate)/dt += -6.1 r / v_x [rad/s^2];" in said
    assert "the 1 s yaw rate error falls from 0.0050 to 0.0010 rad/s." in said
    assert said.endswith(
        "It also has air drag that the simulation lacks: CdA 0.92 m2 (0.88 to 0.97)."
    )
    bare = odd()
    assert bare.unexplained is not None
    nothing = replace(bare, unexplained=replace(bare.unexplained, terms=(), expression=""))
    assert "explains: yaw acceleration against relative wheel-speed" in sentence(nothing)


def test_digits_follow_the_interval() -> None:
    assert number(160.4, 16.0) == "160"
    assert number(45012.0, 2000.0) == "45000"
    assert number(1.136, 0.011) == "1.136"
    assert number(0.5, 0.0) == "0.5"
    assert number(0.5, np.inf) == "0.5"
    assert interval_text(Interval(45e3, 44e3, 46e3, "W"), Quantity("power", "kW", 1e-3)) == (
        "45 kW (44 to 46)"
    )
    assert interval_text(Interval(45e3, 40e3, 1e12, "W"), Quantity("power", "kW", 1e-3)) == (
        "45 kW (at least 40)"
    )
    assert pair_text(0.145, 0.012) == ("0.145", "0.012")
    assert pair_text(2.0, 1e-5) == ("2.000", "1e-05")
    assert pair_text(0.5, 0.0) == ("0.5", "0")
    assert listed(["a"]) == "a"
    assert listed(["a", "b", "c"], "or") == "a, b or c"


def test_the_table_of_what_explains_knows_every_effect_that_is_not_only_at_a_place() -> None:
    assert set(EXPLAINS) <= set(EFFECTS)
    for name in set(EFFECTS) - set(EXPLAINS):
        assert EFFECTS[name].activations == (PLACE,)
