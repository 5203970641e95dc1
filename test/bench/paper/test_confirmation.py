# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk bench confirm: the drives come from the seed alone, and the criteria say what they must."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.paper import board_of, case_score
from helpers.train import made_record

from adk_ros.bench.paper import cases, confirmation_drives, paper_bench
from adk_ros.bench.paper.cases import CLEAN, NOISY
from adk_ros.bench.paper.confirmation_criteria import FAMILIES, confirmation_criteria
from adk_ros.bench.paper.confirmation_drives import CHANGES, write_confirmation_drives
from adk_ros.bench.paper.confirmation_report import drives_table
from adk_ros.bench.paper.interval_criteria import coverage_by_test_criterion
from adk_ros.bench.paper.other_simulators import DESCRIPTIONS, SPRUNG_CAR, OtherDrive
from adk_ros.bench.paper.predictors import (
    ADK_ROS,
    ALDK,
    DK,
    MF,
    MF_CHOSEN,
    NAIVE,
    PYKOOP,
    RLS,
    SWLS,
)
from adk_ros.bench.paper.scores import Combination
from adk_ros.bench.paper.seven_dof_predictor import SevenDof
from adk_ros.bench.paper.training_jobs import (
    BenchPlan,
    Outcome,
    TrainingJob,
    floor_job,
    simulate_job,
)
from adk_ros.bench.vehicles.multibody import MULTI_BODY
from adk_ros.cli.main import main
from adk_ros.errors import DataError
from adk_ros.numerics.constants import QUANTILE_90
from adk_ros.plant.scenario.scenario_file import Scenario, load_scenario
from adk_ros.plant.scenario.simulate import simulate
from adk_ros.plant.vehicle.vehicle_parameters import load_vehicle
from adk_ros.signals.interval_scores import IntervalScore, score_intervals, with_own_error


@pytest.fixture(autouse=True)
def nothing_spins(monkeypatch: pytest.MonkeyPatch) -> None:
    """Save the simulation of each drive."""
    monkeypatch.setattr(confirmation_drives, "drive_spins", lambda scenario: False)


@pytest.mark.slow(seconds=10)
def test_the_drives_come_from_the_seed_alone(tmp_path: Path) -> None:
    first = write_confirmation_drives(tmp_path / "a", "seed", 3)
    again = write_confirmation_drives(tmp_path / "b", "seed", 3)
    other = write_confirmation_drives(tmp_path / "c", "another", 3)
    assert first.tests == again.tests
    assert len(first.tests) == 4 + len(DESCRIPTIONS)
    assert first.others == again.others
    assert {x.seed for x in first.others.values()}.isdisjoint(
        x.seed for x in other.others.values()
    )
    for test in first.tests[:4]:
        mine, same = (Path(d.files.get(test, d.training)) for d in (first, again))
        assert mine.read_text() == same.read_text()
    assert (first.noise_scale, first.noise_seed) == (again.noise_scale, again.noise_seed)
    assert first.noise_seed != other.noise_seed
    assert load_scenario(first.training).route != load_scenario(other.training).route
    # More tests leave the earlier ones as they are.
    more = write_confirmation_drives(tmp_path / "d", "seed", 4)
    assert more.tests[:4] == first.tests[:4]
    assert more.others == first.others


@pytest.mark.slow
def test_each_test_has_a_change_that_training_lacks(tmp_path: Path) -> None:
    drives = write_confirmation_drives(tmp_path / "a", "changes", 30, others=())
    training = drives.scenario(cases.NOMINAL)
    nominal = load_vehicle(training.vehicle)
    assert training.car() == nominal
    seen = set()
    for test in drives.tests[1:]:
        scenario = drives.scenario(test)
        changed = {name for name in CHANGES if name in test}
        seen |= changed
        assert changed or "slalom" in test
        is_other_car = scenario.car() != nominal
        assert is_other_car == bool(changed - {"friction", "wind"})
        assert scenario.route != training.route
        # Driven hard, but on the road.
        limit = 9.81 * scenario.mu * min(scenario.car().front_tyre.mu, scenario.car().rear_tyre.mu)
        assert scenario.speed.lateral_accel < 0.7 * limit or "slalom" in test
    assert seen == set(CHANGES)


def test_a_car_that_spins_drives_more_slowly(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = write_confirmation_drives(tmp_path / "a", "spin", 3)
    limit = drawn.scenario(drawn.tests[3]).speed.top * 0.85

    def too_fast(scenario: Scenario) -> bool:
        return "slalom" not in scenario.name and scenario.speed.top > limit

    monkeypatch.setattr(confirmation_drives, "drive_spins", too_fast)
    slower = write_confirmation_drives(tmp_path / "b", "spin", 3)
    before, after = (d.scenario(drawn.tests[3]).speed for d in (drawn, slower))
    assert after.top == pytest.approx(0.81 * before.top)
    assert after.lateral_accel == pytest.approx(0.81**2 * before.lateral_accel)
    assert drawn.scenario(drawn.tests[1]) == slower.scenario(drawn.tests[1])


def test_a_car_that_spins_at_any_speed_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(confirmation_drives, "drive_spins", lambda scenario: True)
    with pytest.raises(DataError, match=r"the car spins with 0\.19 of its lateral"):
        write_confirmation_drives(tmp_path / "a", "spin", 3)


def test_a_slalom_that_spins_is_steered_less_at_its_speed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = write_confirmation_drives(tmp_path / "a", "spin", 3, others=())
    before = drawn.scenario(drawn.tests[2])
    assert before.steering is not None
    limit = before.steering.amplitude * 0.9

    def spins(scenario: Scenario) -> bool:
        steering = scenario.steering
        return steering is not None and steering.amplitude > limit

    monkeypatch.setattr(confirmation_drives, "drive_spins", spins)
    steered_less = write_confirmation_drives(tmp_path / "b", "spin", 3, others=())
    after = steered_less.scenario(drawn.tests[2])
    assert after.steering is not None
    assert after.steering.amplitude == pytest.approx(0.81 * before.steering.amplitude)
    assert after.speed == before.speed
    plan = BenchPlan(drives=steered_less, tests=steered_less.tests)
    listed = {row[0]: row[-1] for row in drives_table(plan).rows}
    assert listed[drawn.tests[2]] == f"steering {after.steering.amplitude:.4f} rad"


def test_no_draw_lacks_a_fast_slalom_low_friction_or_a_change(tmp_path: Path) -> None:
    for seed in ("a", "b", "c"):
        drives = write_confirmation_drives(tmp_path / seed, seed, 12, others=())
        slow, fast, slippery = (drives.scenario(test) for test in drives.tests[1:4])
        assert 25.0 <= slow.speed.top <= 35.0 <= fast.speed.top <= 44.0
        assert 0.3 <= slippery.mu <= 0.5
        assert {x for x in CHANGES if any(x in name for name in drives.tests)} == set(CHANGES)


@pytest.mark.slow
def test_no_car_spins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()
    drives = write_confirmation_drives(tmp_path / "a", "spin", 7)
    # Rear tyres of less stiffness than the front ones: it spins at the speed that is drawn.
    driven = simulate(drives.scenario(drives.tests[7]))
    assert np.abs(driven.x[:, 1]).max() < 3.0


def test_noise_belongs_to_the_set(tmp_path: Path) -> None:
    drives = write_confirmation_drives(tmp_path / "a", "noise", 3)
    record = made_record(np.zeros((4000, 3)))
    heard = cases.noisy(record, 2, drives)
    assert heard.x[:, 0].std() == pytest.approx(drives.noise_scale * cases.NOISE[0], rel=0.1)
    assert (heard.x != cases.noisy(record, 2, replace(drives, noise_seed=1)).x).any()


@pytest.mark.parametrize(
    "plant", [SPRUNG_CAR, pytest.param(MULTI_BODY, marks=pytest.mark.slow(seconds=20))]
)
def test_another_simulator_drives_a_car_that_moves_as_it_says(plant: str) -> None:
    """Forces, velocities and commands of the record belong together, and to the seed."""
    drive = OtherDrive(plant, "track", 3, 30.0)
    record = drive.truth("other")
    assert record.duration_s == pytest.approx(30.0, abs=0.03)
    v_x, v_y, rate = record.x.T
    assert v_x.min() > 5.0
    assert np.abs(v_y).max() < 3.0
    change = np.gradient(v_x, 0.025) - rate * v_y
    assert np.corrcoef(change, record.a[:, 0])[0, 1] > 0.98
    sideways = np.gradient(v_y, 0.025) + rate * v_x
    assert np.corrcoef(sideways, record.a[:, 1])[0, 1] > 0.98
    assert np.corrcoef(record.u[:, 1] * v_x, rate)[0, 1] > 0.9
    short = drive.truth("other", 5.0)
    np.testing.assert_array_equal(short.x, drive.truth("other", 5.0).x)
    assert not np.array_equal(short.x, replace(drive, seed=4).truth("other", 5.0).x)


def test_a_test_in_another_simulator_has_no_oracle(tmp_path: Path) -> None:
    """Its truth is written, it is listed with its simulator, and the plant is not asked."""
    drives = write_confirmation_drives(tmp_path / "a", "seed", 3, others=(SPRUNG_CAR,))
    (name,) = drives.others
    plan = BenchPlan(drives=drives, tests=(name,), durations=cases.Durations(test=20.0))
    simulate_job(TrainingJob("simulate", about=name), plan, tmp_path, lambda share: None)
    record = cases.record_of_test(tmp_path, name, NOISY, drives)
    assert record.duration_s == pytest.approx(20.0, abs=0.03)
    assert not floor_job(TrainingJob("floor", NOISY), plan, tmp_path, lambda share: None).scores
    (row,) = drives_table(plan).rows
    assert row[-1] == "another simulator: sprung car with brush tyres, about 2.1 t"


def test_intervals_of_the_right_width_score_best() -> None:
    rng = np.random.default_rng(0)
    measured = rng.normal(0.0, 2.0, (20_000, 5, 3))
    predicted = np.zeros_like(measured)
    scores = {
        factor: score_intervals(predicted, np.full_like(measured, (factor * 2.0) ** 2), measured)
        for factor in (0.5, 0.8, 1.0, 1.25, 2.0)
    }
    assert min(scores, key=lambda factor: float(scores[factor].score[2, 1])) == 1.0
    right = scores[1.0]
    np.testing.assert_allclose(right.covered / right.claimed, 0.9, atol=0.01)
    np.testing.assert_allclose(right.width, 4.0 * QUANTILE_90)
    # E = 2 z + 20 E[(|x| - z)+] = 4.13 standard deviations for a normal error.
    np.testing.assert_allclose(right.score, 2.0 * 4.126, rtol=0.02)
    own = with_own_error(predicted, measured)
    np.testing.assert_allclose(own.score, right.score, rtol=0.01)


def test_what_is_not_measured_or_diverged_is_counted_rightly() -> None:
    predicted = np.zeros((4, 5, 3))
    predicted[1, 0, 0] = np.inf
    measured = np.zeros((4, 5, 3))
    measured[2, 0, 0] = np.nan
    variance = np.ones((4, 5, 3))
    variance[3, 0, 0] = np.nan
    score = score_intervals(predicted, variance, measured)
    # One is exact, one diverged; one is not measured, one has no interval.
    assert (score.claimed[0, 0], score.covered[0, 0]) == (2, 1)
    assert score.score[0, 0] == pytest.approx(2.0 * QUANTILE_90)
    nothing = score_intervals(predicted, np.full_like(variance, np.nan), measured)
    assert not nothing.claimed.any()
    assert np.isnan(nothing.score).all()


def intervals(score: float, covered: int = 900, width: float = 0.9) -> IntervalScore:
    return IntervalScore(
        np.full((5, 3), covered), np.full((5, 3), 1000), np.full((5, 3), width),
        np.full((5, 3), score),
    )  # fmt: skip


def verdicts(change: Callable[[str, str, str], dict[str, object]]) -> dict[str, str]:
    """Return the verdicts on a good board whose scores are replaced by `change`."""
    tests = ["nominal", "01_slalom"]
    baselines = {MF: 0.5, MF_CHOSEN: 0.3, ALDK: 0.7, RLS: 0.5, SWLS: 0.4}
    board = board_of(dict.fromkeys(NAIVE, 1.0) | baselines, tests)
    for variant in (CLEAN, NOISY):
        for test in tests:
            for seed in range(3):
                item = case_score(0.03 + 0.001 * seed)
                item = replace(item, intervals=intervals(0.2), held=intervals(0.5))
                board.add(variant, test, ADK_ROS, item)
            board.add(variant, test, PYKOOP, case_score(0.6))
    for (variant, test, name), items in board.scores.items():
        for i, item in enumerate(items):
            filled = item if item.intervals else replace(item, intervals=intervals(1.0, width=1.0))
            items[i] = replace(filled, **change(variant, test, name))  # type: ignore[arg-type]
    return {c.name: c.verdict for c in confirmation_criteria(board, 20)}


def changed(name: str, **to: object) -> Callable[[str, str, str], dict[str, object]]:
    """Return what `verdicts` needs to change the scores of a predictor."""
    return lambda variant, test, n: to if n == name else {}


def test_criteria() -> None:
    good = verdicts(lambda variant, test, name: {})
    assert set(good.values()) == {"PASS"}
    assert len(good) == 15

    def failed(change: Callable[[str, str, str], dict[str, object]]) -> set[str]:
        return {name for name, verdict in verdicts(change).items() if verdict == "FAIL"}

    table = np.full((5, 3), 0.03)
    table[4, 0] = 1.1
    above = failed(
        lambda v, t, n: {"rmse": table} if (v, t, n) == (CLEAN, "nominal", ADK_ROS) else {}
    )
    assert "none-above-naive" in above
    assert "geometric-mean" not in above
    # The best member of a family counts.
    assert failed(lambda v, t, n: {"rmse": np.full((5, 3), 0.02)} if n == MF_CHOSEN else {}) == {
        "ahead-of-7dof"
    }
    for member in (ALDK, RLS, SWLS):
        better = changed(member, rmse=np.full((5, 3), 0.02))
        assert failed(better) == {"ahead-of-papers-method"}
    assert failed(lambda v, t, n: {"rmse": np.full((5, 3), 0.045)} if n == ADK_ROS else {}) == {
        "two-seconds-noisy"
    }
    assert failed(lambda v, t, n: {"held": intervals(0.5, 700)} if n == ADK_ROS else {}) == {
        "coverage-held-commands", "coverage-by-test-held-commands"
    }  # fmt: skip
    # One test that misses is not lost among the others.
    assert failed(
        lambda v, t, n: {"held": intervals(0.5, 820)} if (t, n) == ("nominal", ADK_ROS) else {}
    ) == {"coverage-by-test-held-commands"}
    assert failed(lambda v, t, n: {"intervals": intervals(1.5)} if n == ADK_ROS else {}) == {
        "interval-score-known-commands"
    }
    wide = intervals(0.5, width=1.1)
    assert failed(lambda v, t, n: {"held": wide} if n == ADK_ROS else {}) == {
        "interval-width-held-commands"
    }


def test_the_coverage_of_a_test_may_differ_by_chance() -> None:
    """By 1.96 standard deviations in one comparison, by more in many, by five points anyhow."""
    first, *others = [Combination(NOISY, f"test {i}", 4, 1) for i in range(450)]

    def verdict(share: float, count: float, more: int = 0) -> str:
        tests = {first: (share, count)} | dict.fromkeys(others[:more], (0.9, 100.0))
        return coverage_by_test_criterion("name", tests).verdict

    assert [verdict(share, 100.0) for share in (0.842, 0.84, 0.958, 0.96)] == [
        "PASS", "FAIL", "PASS", "FAIL",
    ]  # fmt: skip
    assert [verdict(share, 1e5) for share in (0.85, 0.845)] == ["PASS", "FAIL"]
    assert [verdict(share, 100.0, 449) for share in (0.79, 0.78)] == ["PASS", "FAIL"]
    text = coverage_by_test_criterion(
        "name", {first: (0.7, 100.0), others[0]: (0.9, 100.0)}
    ).figure
    assert "1 of 2" in text
    assert "the worst noisy test 0 (v_y 2 s 70.0 %, allowed 83.3 to 96.7)" in text


def test_the_better_parameters_are_chosen_on_data_they_do_not_know() -> None:
    vehicle = load_vehicle("imdv")
    record = simulate(load_scenario("town"), duration_s=30.0).truth()
    given = SevenDof(vehicle, 0.85)
    worse = SevenDof(vehicle.model_copy(update={"mass": 2.0 * vehicle.mass}), 0.85)
    assert worse.better_of(given, record, 20) is given
    assert given.better_of(worse, record, 20) is given
    plain = given.without_resistances()
    assert (plain.vehicle.cda, plain.vehicle.crr) == (0.0, 0.0)
    assert given.vehicle.crr > 0.0


CODE = "0123456789abcdef" * 4


def test_the_command_writes_the_drives_and_names_the_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    plans: list[BenchPlan] = []

    def short(plan: BenchPlan, folder: Path, *arguments: object) -> paper_bench.Result:
        plans.append(plan)
        board = board_of(dict.fromkeys((*NAIVE, MF, ALDK), 1.0) | {ADK_ROS: 0.03}, plan.tests)
        return paper_bench.Result(board, None, [Outcome(TrainingJob("naive"))], "not now")

    monkeypatch.setattr(paper_bench, "run_paper", short)
    # Else each change of the code is another draw.
    monkeypatch.setattr("adk_ros.files.code_digest.code_digest", lambda: CODE)
    out = tmp_path / "out"
    assert main(["bench", "confirm", "--tests", "3", "--out", str(out), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["code"] == told["seed"] == CODE
    assert plans[0].seeds == 3
    # What the command leaves out is no member of a family of baselines.
    assert "dk" in plans[0].left_out
    assert all(DK not in members for _, members in FAMILIES.values())
    assert len(plans[0].tests) == 6
    page = (out / "confirmation.md").read_text()
    assert CODE[:16] in page
    assert "| PASS | geometric-mean |" in page
    assert (
        "The paper's method is trained for 90 epochs in batches of 20 (in the paper 2000)" in page
    )
    files = sorted(path.name for path in (out / "scenarios").iterdir())
    assert len(files) == 6
    assert load_scenario(out / "scenarios" / files[0]).plant == "fourteen_dof"
    assert (out / "scores.csv").read_text().count("adk_ros") == 2 * 6 * 15
    assert main(["bench", "confirm", "--out", str(out)]) == 2
    assert "--force" in capsys.readouterr().err
    assert main(["bench", "confirm", "--tests", "2"]) == 2
    assert "--tests is 2: choose 3 to 200" in capsys.readouterr().err
