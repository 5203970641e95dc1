# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Closed loops of a few seconds, and the command."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.train import small

from adk_ros.bench.control import linear_mpc
from adk_ros.bench.control.cars import CARS, NOMINAL, make_car
from adk_ros.bench.control.control_bench import ControlPlan, RunChoice, run_control, run_one
from adk_ros.bench.control.controllers import MPC_NAME, MPPI_NAME
from adk_ros.bench.control.reference_path import LANE_CHANGE
from adk_ros.bench.control.scores import ADAPTED, DYNAMIC, FROZEN, PLANT
from adk_ros.cli.main import main


@pytest.mark.parametrize("controller", [MPPI_NAME, MPC_NAME])
def test_the_nominal_car_keeps_its_lane(controller: str) -> None:
    plan = ControlPlan(model=Path(), length_m=60.0)
    run = run_one(plan, RunChoice(LANE_CHANGE, NOMINAL, controller, DYNAMIC, 1))
    assert run.score.completed
    assert run.score.lateral_rms < 0.06
    assert run.score.violations == 0.0
    again = run_one(plan, RunChoice(LANE_CHANGE, NOMINAL, controller, DYNAMIC, 1))
    np.testing.assert_array_equal(run.lateral, again.lateral)


@pytest.mark.slow(seconds=20)
def test_the_plant_as_a_model_keeps_a_changed_car_in_its_lane() -> None:
    plan = ControlPlan(model=Path(), length_m=60.0)
    run = run_one(plan, RunChoice(LANE_CHANGE, "100 ms steering lag", MPPI_NAME, PLANT, 1))
    assert run.score.lateral_rms < 0.06


def test_cars_differ_in_one_thing_each() -> None:
    nominal = make_car(NOMINAL)
    for name in CARS[1:]:
        car = make_car(name)
        before, after = nominal.vehicle.model_dump(), car.vehicle.model_dump()
        changed = [key for key in before if before[key] != after[key]]
        assert len(changed) + (car.mu != nominal.mu) == 1, name
    assert make_car("low friction").grip() < 0.9 * nominal.grip()


def test_plan_without_osqp_has_no_linear_mpc(monkeypatch: pytest.MonkeyPatch) -> None:
    from adk_ros.bench.control import control_bench

    monkeypatch.setattr(control_bench, "has_osqp", lambda: False)
    assert {choice.controller for choice in ControlPlan(Path()).runs()} == {MPPI_NAME}
    monkeypatch.setattr(linear_mpc, "has_osqp", lambda: False)
    with pytest.raises(Exception, match="pip install osqp"):
        linear_mpc.solve_bounded(np.eye(1), np.ones(1), np.eye(1), -np.ones(1), np.ones(1))


@pytest.mark.slow(seconds=30)
def test_processes_give_the_same_runs() -> None:
    plan = ControlPlan(
        small().path, cars=(NOMINAL,), controllers=(MPPI_NAME,), models=(FROZEN, ADAPTED),
        manoeuvres=(LANE_CHANGE,), length_m=20.0,
    )  # fmt: skip
    alone, together = run_control(plan), run_control(replace(plan), jobs=2)
    for one, other in zip(alone, together, strict=True):
        np.testing.assert_array_equal(one.lateral, other.lateral)


@pytest.mark.slow(seconds=40)
def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    arguments = [
        "bench", "control", "--quick", "--model", str(small().path), "--car", NOMINAL, "--car",
        "+160 kg", "--manoeuvre", LANE_CHANGE, "--out", str(out),
    ]  # fmt: skip
    assert main(arguments) == 0
    printed = capsys.readouterr().out
    assert "MPPI, nominal: adaptation changes the error by" in printed
    assert "MPPI: a cycle takes" in printed
    assert {path.name for path in out.iterdir()} == {
        "control.json", "control.csv", "double_lane_change.png",
    }  # fmt: skip
    content = json.loads((out / "control.json").read_text())
    with (out / "control.csv").open() as file:
        assert len(list(csv.DictReader(file))) == len(content["runs"])
    assert len(content["runs"]) == 2 * 4 * 2


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--jobs", "0"], "choose 1 to 64"),
        (["--car", "tram"], "--car 'tram' is unknown: choose one of nominal"),
        (["--manoeuvre", "drift"], "'drift' is unknown"),
        (["--seed", "98"], "development set"),
        (["--seed", "1", "--seed", "1"], "different seeds"),
        (["--out", "no/where"], "give a new folder"),
        (["--tune", "--json"], "leave out --json"),
    ],
)
def test_wrong_options(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["bench", "control", *arguments]) == 2
    assert message in capsys.readouterr().err
