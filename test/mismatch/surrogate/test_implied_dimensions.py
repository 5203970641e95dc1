# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Yaw inertia and wheelbase of a vehicle file, against the simulation."""

from __future__ import annotations

import pytest
from helpers.mismatch import case

from adk_ros.errors import DataError
from adk_ros.mismatch.recording.nominal_vehicle import NominalVehicle
from adk_ros.mismatch.simulator import surrogate_of
from adk_ros.mismatch.surrogate.implied_dimensions import ImpliedDimension, ImpliedDimensions

slow = pytest.mark.slow(seconds=25)


def identify(nominal: NominalVehicle, of_torque: str = "") -> str:
    """Return the note on what the simulation implies."""
    c = case()
    _, notes = surrogate_of(c.simulation, c.recording, nominal, lambda done, text: None, of_torque)
    return next((note for note in notes if "implies a yaw inertia of" in note), "")


def changed(**factors: float) -> NominalVehicle:
    nominal = case().nominal
    update = {name: factor * getattr(nominal, name) for name, factor in factors.items()}
    return nominal.model_copy(update=update)


@slow
@pytest.mark.parametrize("factor", [0.4, 2.5])
def test_another_yaw_inertia_is_refused(factor: float) -> None:
    with pytest.raises(DataError, match="implies a yaw inertia of") as error:
        identify(changed(yaw_inertia=factor))
    implied = float(str(error.value).split("a yaw inertia of ")[1].split(" kg")[0])
    assert implied == pytest.approx(case().nominal.yaw_inertia, rel=0.05)
    assert "correct yaw_inertia (a factor of" in str(error.value)
    assert "\n" not in str(error.value)


@slow
@pytest.mark.parametrize("factor", [0.7, 1.3])
def test_another_wheelbase_or_steering_ratio_is_refused(factor: float) -> None:
    with pytest.raises(DataError, match=r"a wheelbase of .* ratio of the steering") as error:
        identify(changed(cg_to_front_axle=factor, cg_to_rear_axle=factor))
    implied = float(str(error.value).split("a wheelbase of ")[1].split(" m ")[0])
    nominal = case().nominal
    wheelbase = nominal.cg_to_front_axle + nominal.cg_to_rear_axle
    assert implied == pytest.approx(wheelbase, rel=0.03)


@slow
@pytest.mark.parametrize("factor", [0.61, 1.7])
def test_a_doubtful_yaw_inertia_is_said(factor: float) -> None:
    """A right file may imply it: the simulator of another project does."""
    assert "yaw_inertia is wrong" in identify(changed(yaw_inertia=factor))


@slow
def test_what_other_simulators_differ_by_is_accepted() -> None:
    for nominal in (changed(yaw_inertia=1.3), changed(cg_to_front_axle=1.1, cg_to_rear_axle=1.1)):
        note = identify(nominal)
        assert note
        assert "wrong" not in note


@slow
def test_one_note_states_all_that_the_simulation_implies() -> None:
    note = identify(case().nominal, "its torque response implies a mass")
    assert note.startswith(
        "the vehicle file against the simulation, 90 % intervals: its torque response implies a "
        "mass; the simulation's response to steering implies a yaw inertia of"
    )


@slow
def test_what_is_assumed_cannot_contradict() -> None:
    """It is identified from the simulation instead."""
    nominal = changed(yaw_inertia=1.7)
    nominal._assumed = frozenset({"yaw_inertia"})
    assert "yaw_inertia is wrong" not in identify(nominal)


def test_a_contradiction_is_outside_the_interval_and_large() -> None:
    assert ImpliedDimension(2.0, 1.9, 2.1, 2.5).contradicts(1.08)
    assert not ImpliedDimension(2.0, 1.5, 2.6, 2.5).contradicts(1.08)
    assert not ImpliedDimension(2.0, 1.99, 2.01, 2.1).contradicts(1.08)


def test_a_wheelbase_is_also_a_factor_on_the_steering_command() -> None:
    inertia = ImpliedDimension(3100.0, 3000.0, 3200.0, 3000.0)
    implied = ImpliedDimensions(inertia, ImpliedDimension(2.75, 2.7, 2.8, 2.5))
    ratio = implied.steering_ratio
    assert (ratio.low, ratio.value, ratio.high) == pytest.approx((1.08, 1.1, 1.12))
    assert ratio.given == 1.0
    assert implied.text == (
        "the simulation's response to steering implies a yaw inertia of 3100 kg·m² (3000 to 3200; "
        "vehicle file 3000) and a wheelbase of 2.75 m (2.7 to 2.8; vehicle file 2.5), or, with "
        "the file's wheelbase, a steering command of 1.1 (1.08 to 1.12) times the angle of the "
        "road wheels"
    )
