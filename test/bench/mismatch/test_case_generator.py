# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Generated cases: the injected mismatch acts, and only where the label says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from adk_ros.bench.mismatch.calibration_cases import FIRST_SEED as FIRST_CALIBRATION_SEED
from adk_ros.bench.mismatch.case_files import recordings_of, write_case
from adk_ros.bench.mismatch.case_generator import InjectedMismatch, make_case
from adk_ros.bench.mismatch.case_matrix import (
    LISTS,
    NOISES,
    case_plans,
    select_plans,
    with_recordings,
)
from adk_ros.bench.mismatch.sensor_dropouts import DROPOUTS
from adk_ros.errors import UsageError
from adk_ros.mismatch.recording.simulated_sensors import simulate_faulty_sensors
from adk_ros.plant.injection.injected_changes import InjectedChanges
from adk_ros.plant.injection.injected_drive import PLANTS, simulate_injected_drive
from adk_ros.plant.injection.injectors import FULL, UNLISTED, plant_changes
from adk_ros.plant.scenario.scenario_file import load_scenario
from adk_ros.plant.vehicle.vehicle_parameters import load_vehicle

BIAS = {"imu_bias": {"ax": 0.2, "ay": -0.1, "gyro": 0.01}}


def test_a_bias_begins_at_its_onset() -> None:
    truth, commands = np.zeros((4001, 11)), np.zeros((161, 2))
    log = simulate_faulty_sensors("standstill", truth, commands, BIAS, None, onset_s=1.5)
    late = log.imu_s >= 1.5
    assert 0 < late.sum() < late.size
    np.testing.assert_array_equal(log.imu[~late], 0.0)
    np.testing.assert_allclose(log.imu[late], np.tile([0.2, -0.1, 0.01], (late.sum(), 1)))
    always = simulate_faulty_sensors("standstill", truth, commands, BIAS, None)
    np.testing.assert_allclose(always.imu[0], [0.2, -0.1, 0.01])


def test_every_planned_change_can_be_injected() -> None:
    for plan in case_plans():
        changes = plant_changes(plan.injected.effects, plan.injected.unlisted, 1.0)
        assert isinstance(changes, InjectedChanges)
        for name, value in plan.injected.unlisted.items():
            assert name in DROPOUTS or getattr(changes.unlisted, name) == value


def test_further_recordings_are_of_the_same_car(tmp_path: Path) -> None:
    drag = InjectedMismatch({"aero_drag": {"cda": 1.0}})
    one, three = (
        make_case("drag", drag, 5, seconds=(20.0, 20.0, 10.0), further=n) for n in (0, 2)
    )
    np.testing.assert_array_equal(one.recording.imu, three.recording.imu)
    np.testing.assert_array_equal(one.held_out.imu, three.held_out.imu)
    assert one.further == ()
    write_case(three, tmp_path / "case")
    names = ["recording", "recording_2", "recording_3"]
    assert [path.name for path in recordings_of(tmp_path / "case")] == names
    first, *others = (three.recording, *three.further)
    for log in others:
        assert log.duration_s == pytest.approx(first.duration_s, abs=0.1)
        # Other places and other noise.
        assert not np.allclose(log.pose[0, :2], first.pose[0, :2], atol=10.0)


def test_several_recordings_are_of_effects_that_act_always() -> None:
    plans = select_plans(0, "*_0.1")
    joint = with_recordings(plans, 3)
    assert {plan.recordings for plan in joint} == {3}
    assert 0 < len(joint) < len(plans)
    assert not any(plan.injected.kinds for plan in joint)
    with pytest.raises(UsageError, match="--recordings needs cases whose effects act always"):
        with_recordings(select_plans(0, "payload_from_a_time_on"), 2)


@pytest.mark.parametrize("plant", PLANTS)
def test_a_change_acts_from_its_onset_on(plant: str) -> None:
    vehicle, route = load_vehicle("imdv"), load_scenario("town").planned_route()

    def v_x(changes: InjectedChanges) -> np.ndarray:
        truth, _, _ = simulate_injected_drive(vehicle, vehicle, route, changes, 1, 4.0, plant)
        return truth[:, 3]

    plain = v_x(InjectedChanges())
    assert np.isfinite(plain).all()
    dragged = v_x(plant_changes({}, {"scrub_drag": UNLISTED["scrub_drag"]}, 2.0))
    braked = v_x(InjectedChanges(onset=2.0, one_side_brake_torque=400.0))
    np.testing.assert_array_equal(plain[:2000], dragged[:2000])
    np.testing.assert_array_equal(plain[:2000], braked[:2000])
    assert braked[-1] < plain[-1] - 0.05


def test_the_list_has_every_kind_of_case() -> None:
    plans = list(case_plans())
    clean = [plan for plan in plans if plan.name.startswith("clean")]
    assert len(clean) == 100
    assert {(p.plant, p.noise) for p in clean} >= {(x, y) for x in PLANTS for y in NOISES}
    assert sum(p.plant == "multi_body" for p in clean) >= 20
    unlisted = [plan for plan in plans if plan.injected.unlisted]
    assert len(unlisted) >= 60
    assert sum(p.plant == "multi_body" and bool(p.injected.effects) for p in plans) >= 20
    for strength in (1.0, 0.3, 0.1):
        singles = {p.name for p in plans if p.strength == strength and p.injected.effects}
        assert {f"{name}_{strength:g}" for name in FULL} <= singles


def test_lists_of_other_numbers_share_names_and_sizes_but_no_car() -> None:
    first, second = list(case_plans()), list(case_plans(1))
    assert [p.name for p in first] == [p.name for p in second]
    assert [p.injected for p in first] == [p.injected for p in second]
    assert not {p.seed for p in first} & {p.seed for p in second}
    assert sum(a.plant != b.plant for a, b in zip(first, second, strict=True)) > 200
    clean = [p for p in second if p.name.startswith("clean")]
    assert {(p.plant, p.noise) for p in clean} >= {(x, y) for x in PLANTS for y in NOISES}
    assert max(p.seed for p in case_plans(LISTS - 1)) < FIRST_CALIBRATION_SEED


def test_cases_are_selected_by_name_or_pattern() -> None:
    assert [plan.name for plan in select_plans(0, "payload_1")] == ["payload_1"]
    both = select_plans(0, "unlisted_torque_cut_*, clean_07")
    assert [plan.name for plan in both] == [
        "clean_07", "unlisted_torque_cut_1", "unlisted_torque_cut_0.3",
    ]  # fmt: skip
    assert len(select_plans(3, "clean_*")) == 3
    with pytest.raises(UsageError, match="no generated case is called 'paylod"):
        select_plans(0, "paylod*")
