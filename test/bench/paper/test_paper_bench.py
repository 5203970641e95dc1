# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk bench paper: predictors under one protocol, training jobs, and a run on short drives."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.model import make_model, paper_model
from helpers.train import bag, drive, lines, record, refused

from adk_ros.bench.paper import av21, cases, training_jobs
from adk_ros.bench.paper import paper_bench as runs
from adk_ros.bench.paper.cases import CLEAN, NOISY, Durations
from adk_ros.bench.paper.online_effect import A_POSTERIORI, INNOVATION
from adk_ros.bench.paper.paper_page import write_report
from adk_ros.bench.paper.predictors import (
    ADK_ROS,
    ALONE,
    MF_TUNED,
    NAIVE,
    NOT_ADAPTED,
    ORACLE,
    ORACLE_ESTIMATED,
    ORDER,
    PYKOOP,
    PYKOOPMAN,
    KoopmanPredictor,
    OraclePredictor,
    run,
)
from adk_ros.bench.paper.seven_dof_predictor import SevenDof
from adk_ros.bench.paper.training_jobs import BenchPlan, Outcome, TrainingJob
from adk_ros.cli.main import main
from adk_ros.errors import DataError, UsageError
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.predictor import Predictor
from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.signals.channels import Record
from adk_ros.train.train_settings import TrainSettings

pytestmark = pytest.mark.slow

TINY = BenchPlan(
    quick=True, seeds=2, tests=("nominal", "slalom"), paper_epochs=1, paper_batch=256, stride=40,
    durations=Durations(train=60.0, test=8.0), peers=False,
    train=TrainSettings(
        steps=20, batch=32, hidden=8, features=4, history=2, short_steps=4, long_steps=6,
        validate_every=10, device="cpu",
    ),
)  # fmt: skip


@pytest.mark.parametrize("make", [make_model, paper_model])
def test_one_pass_equals_the_predictor(make: Callable[[], KoopmanModel]) -> None:
    measured = cases.noisy(record().rows(slice(0, 400)), 1)
    rows, starts = cases.rows_of(measured, 50)
    koopman = KoopmanPredictor("any", make())
    passed = koopman.run(measured, rows, starts)
    predictor = Predictor(koopman.model, horizon_steps=0)
    from adk_ros.model.evaluation import sample_at

    for row in range(int(starts[2]) + 1):
        prediction = predictor.step(sample_at(measured, row))
        if row in rows:
            assert prediction is not None
            np.testing.assert_array_equal(passed.one[row - rows[0]], prediction.x)
    row = int(starts[2])
    ahead = predictor.rollout(measured.u[row : row + 80])
    np.testing.assert_array_equal(passed.ahead[2], ahead)
    np.testing.assert_array_equal(koopman.predict(measured, starts, 10), passed.ahead[:, :10])
    if len(koopman.model.horizon_covariance):
        assert passed.variance is not None
        table = predictor.horizon_covariance
        np.testing.assert_allclose(passed.variance[2, 4], np.diagonal(table[79]))
    else:
        assert passed.variance is None


def test_predictions_use_no_future_data_but_commands() -> None:
    measured = record().rows(slice(0, 400))
    rows, starts = cases.rows_of(measured, 50)
    k = int(starts[3])
    x = measured.x.copy()
    x[k + 1 :] += 5.0
    other = replace(measured, x=x, x_ref=x + 1.0)
    koopman = KoopmanPredictor("any", make_model())
    one, two = (koopman.run(item, rows, starts) for item in (measured, other))
    before = rows <= k
    np.testing.assert_array_equal(one.one[before], two.one[before])
    np.testing.assert_array_equal(one.ahead[:4], two.ahead[:4])
    assert (one.ahead[4] != two.ahead[4]).any()


def test_the_oracle_has_no_error_on_a_clean_test() -> None:
    driven = drive("town", 30.0)
    truth = driven.truth().rows(slice(400, None))
    rows, starts = cases.rows_of(truth, 100)
    passed = run(OraclePredictor(driven, 400), truth, rows, starts)
    np.testing.assert_allclose(passed.one, truth.x[rows + 1], atol=1e-12)
    assert np.abs(passed.ahead[:, 79] - truth.x[starts + 80]).max() < 1e-9


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> tuple[runs.Result, Path, Path]:
    """Run everything but the identification of the physics model, which has its own test."""
    folder = tmp_path_factory.mktemp("scratch")
    out = tmp_path_factory.mktemp("report")
    (out / "tables").mkdir()
    (out / "tables" / "table_9_clean.md").write_text("of an earlier report")

    def tuned(vehicle: object, records: object, mu: float, name: str = "") -> SevenDof:
        from adk_ros.plant.vehicle.vehicle_parameters import load_vehicle

        return SevenDof(load_vehicle("imdv"), mu, name)

    calls: list[tuple[float, float, str]] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(SevenDof, "tuned", staticmethod(tuned))
        result = runs.run_paper(TINY, folder, 0, lambda *item: calls.append(item))
    assert all(0.0 <= share <= total for share, total, _ in calls)
    for phase in ("simulating", "training and predicting"):
        completed = [(share, total) for share, total, text in calls if text.startswith(phase)]
        shares = [share for share, _ in completed]
        assert shares == sorted(shares)
        assert completed[-1][0] == completed[-1][1]
    return result, folder, out


def test_every_predictor_is_scored_on_every_test(done: tuple[runs.Result, Path, Path]) -> None:
    board = done[0].board
    left_out = (PYKOOP, PYKOOPMAN, ALONE, NOT_ADAPTED, ORACLE_ESTIMATED)
    expected = [name for name in ORDER if name not in left_out]
    assert board.names() == expected
    for variant in (CLEAN, NOISY):
        for test in TINY.tests:
            counts = {
                tuple(board.seeds(variant, test, name)[0].count.tolist()) for name in expected
            }
            assert len(counts) == 1
            assert len(board.seeds(variant, test, ADK_ROS)) == 2
            assert (board.rmse(variant, test, ORACLE)[4] < 0.2).all()
    assert (board.rmse(CLEAN, "slalom", ORACLE) < 1e-9).all()
    assert np.isfinite(board.coverage()).all()
    # So little training may leave the same model in one of the variants.
    assert any(
        (board.seeds(variant, "nominal", ADK_ROS)[0].rmse
         != board.seeds(variant, "nominal", ADK_ROS)[1].rmse).any()
        for variant in (CLEAN, NOISY)
    )  # fmt: skip
    noisy = board.rmse(NOISY, "nominal", NAIVE[0])[0]
    np.testing.assert_array_less(board.rmse(CLEAN, "nominal", NAIVE[0])[0], noisy)


def test_the_report_is_self_contained(done: tuple[runs.Result, Path, Path]) -> None:
    result, folder, out = done
    report = write_report(result, TINY, folder, out)
    page = report.page.read_text()
    assert page.count("<img") == page.count("data:image/png;base64,") == 4
    assert "http" not in page.split("<body>")[1]
    for word in ("Table 4, clean", "Table 8, noisy", "slalom, noisy: RMSE", "geometric-mean",
                 "holds", "switched off (--no-peers)", "trial run"):  # fmt: skip
        assert word in page, word
    for test in ("mountain", "winter"):
        assert f"horizon_{test}" not in page
    names = sorted(path.name for path in (out / "figures").iterdir())
    assert names == ["figure_4.png", "figure_5.png", "figure_9.png", "summary.png"]
    assert not (out / "tables" / "table_9_clean.md").exists()
    assert (out / "tables" / "table_8_noisy.csv").is_file()
    assert (out / "criteria.txt").read_text().splitlines() == [
        str(criterion) for criterion in report.criteria
    ]
    verdicts = {claim.verdict for claim in report.claims}
    assert "not measured" in verdicts
    assert {(x.epochs, x.kind, x.chosen) for x in result.readings} == {
        (1, kind, chosen) for kind in (INNOVATION, A_POSTERIORI) for chosen in (False, True)
    }
    claims = (out / "claims.md").read_text()
    assert "As innovations, " in claims
    assert "As innovations, " in page
    assert (out / "tables" / "online_effect.csv").is_file()
    assert verdicts <= {"holds", "holds in part", "does not hold", "not measured"}
    assert report.times.rows[-1][0] == "all, one after the other"


def test_the_effect_is_examined_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("adk_ros.cli.bench_paper._plan", lambda *given: TINY)
    out = tmp_path / "out"
    assert main(["bench", "paper", "--only-effect", "--jobs", "1", "--out", str(out)]) == 0
    printed = capsys.readouterr().out.splitlines()
    assert [line.split(",")[0] for line in printed[1:-1]] == [
        "As innovations", "As a-posteriori errors"
    ]  # fmt: skip
    assert printed[-1].startswith("The paper's 2000 epochs are not among these readings")
    assert sorted(path.name for path in out.iterdir()) == ["online_effect.csv", "online_effect.md"]


def test_a_failing_baseline_library_does_not_end_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(train: list[Record], scratch: Path) -> None:
        raise DataError("the peers failed: LinAlgError")

    def nothing(
        job: TrainingJob, plan: BenchPlan, folder: Path, tell: Callable[[float], None]
    ) -> Outcome:
        return Outcome(job)

    monkeypatch.setattr(training_jobs, "Peers", broken)
    monkeypatch.setattr(runs, "find_python", lambda: Path("python"))
    for kind in ("default", "effect", "aldk", "dk", "tuned", "floor"):
        monkeypatch.setitem(runs.KINDS, kind, nothing)
    notes: list[str] = []
    plan = replace(TINY, peers=True, tests=("nominal",))
    result = runs.run_paper(plan, tmp_path, 0, None, notes.append)
    assert result.without == "the peers failed: LinAlgError"
    assert notes == ["without pykoop and pykoopman: the peers failed: LinAlgError"]
    assert result.board.has(NAIVE[0])
    assert not result.board.has(PYKOOP)


def test_missing_baseline_libraries_are_left_out() -> None:
    plan = replace(TINY, peers=True)
    assert [job for job in runs.planned(plan, True) if job.kind == "peers"]
    assert not [job for job in runs.planned(plan, False) if job.kind == "peers"]
    assert sum(job.kind == "default" for job in runs.planned(plan, True)) == 4


def test_worker_processes_give_the_same_result(
    done: tuple[runs.Result, Path, Path], tmp_path: Path
) -> None:
    drives = [TrainingJob("simulate", about=test) for test in TINY.tests]
    calls: list[tuple[float, float, str]] = []
    with runs._Pool(TINY, tmp_path, 2, len(drives)) as pool:
        pool.run(drives, "simulating", lambda *item: calls.append(item), None)
        assert calls[-1][:2] == (2.0, 2)
        (outcome,) = pool.run([TrainingJob("naive", NOISY)], "predicting", None, None)
    for test, name, item in outcome.scores:
        expected = done[0].board.rmse(NOISY, test, name)
        np.testing.assert_array_equal(item.rmse, expected)


def test_progress_covers_more_than_a_thousand_jobs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The shared progress table has an entry for every job, however many seeds a plan has."""
    plan = replace(TINY, seeds=100, recordings=tuple(tmp_path / f"bag_{i}" for i in range(12)))
    plan = replace(plan, quick=False)
    jobs = runs.planned(plan, peers=True)
    assert len(jobs) > 1000

    class Immediate:
        """An executor that runs every job at once, in this process."""

        def __init__(
            self, workers: int, mp_context: object, initializer: object, initargs: tuple[Any]
        ):
            runs._progress = initargs[0]

        def submit(self, work: Callable[..., Outcome], *arguments: Any) -> Future[Outcome]:
            future: Future[Outcome] = Future()
            future.set_result(work(*arguments))
            return future

        def shutdown(self, **_: bool) -> None:
            """Nothing runs."""

    def reporting(
        job: TrainingJob, plan: BenchPlan, folder: Path, report: Callable[[float], None]
    ) -> Outcome:
        report(0.5)
        return Outcome(job)

    monkeypatch.setattr(runs, "ProcessPoolExecutor", Immediate)
    for kind in runs.KINDS:
        monkeypatch.setitem(runs.KINDS, kind, reporting)
    calls: list[tuple[float, float, str]] = []
    with runs._Pool(plan, tmp_path, 2, len(jobs)) as pool:
        outcomes = pool.run(jobs, "training", lambda *item: calls.append(item), None)
    assert len(outcomes) == len(jobs)
    assert calls[-1][:2] == (len(jobs), len(jobs))


def test_recordings_of_one_name_are_refused(tmp_path: Path) -> None:
    paths = (tmp_path / "a" / "bag", tmp_path / "b" / "bag")
    for path in paths:
        path.mkdir(parents=True)
    with pytest.raises(UsageError, match="have the same name"):
        runs.check(replace(TINY, recordings=paths))


def test_a_failure_in_a_worker_ends_the_run_at_once(tmp_path: Path) -> None:
    started = time.monotonic()
    with (
        pytest.raises(UsageError, match="no_such"),
        runs._Pool(TINY, tmp_path, 1, 1) as pool,
    ):
        pool.run([TrainingJob("simulate", about="no_such")], "simulating", None, None)
    assert time.monotonic() - started < 60.0


def test_recordings_are_found_and_scored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = bag("town", 30.0), bag("handling", 30.0, imu=False)
    folder = tmp_path / "recordings"
    folder.mkdir()
    for path in (first, second):
        (folder / path.name).symlink_to(path, target_is_directory=True)
    with pytest.raises(DataError, match="holds no recording"):
        av21.find_recordings(tmp_path / "nothing")
    found = tuple(folder / path.name for path in (first, second))

    def untrained(
        outcome: Outcome, records: list[Record], plan: BenchPlan, folder: Path,
        tell: Callable[[float], None],
    ) -> KoopmanPredictor:  # fmt: skip
        assert sum(item.duration_s for item in records) == pytest.approx(18.0, abs=0.5)
        return KoopmanPredictor(ADK_ROS, make_model())

    monkeypatch.setattr(av21, "train_default", untrained)
    plan = replace(TINY, recordings=found)
    outcomes = [
        av21.recording_job(
            TrainingJob("recording", "recorded", 0, path.name), plan, tmp_path, print
        )
        for path in found
    ]
    recorded = av21.RecordingScores.of(outcomes)
    assert len(recorded.pairs(same=True)) == len(recorded.pairs(same=False)) == 2
    for table in recorded.ratios.values():
        assert table.shape == (5, 3)
        assert np.isfinite(table).all()


def test_a_tenth_of_the_naive_error_scores_a_tenth() -> None:
    class Right:
        """Predicts the measurement plus a tenth of the error of persistence."""

        def predict(self, item: Record, rows: IntArray, ahead: int) -> FloatArray:
            future = item.x_ref[rows[:, None] + np.arange(1, ahead + 1)]
            return np.asarray(future + 0.1 * (item.x[rows][:, None] - future))

    found = av21.against_naive(Right(), record())  # type: ignore[arg-type]
    ratio = found[ADK_ROS].rmse / found["persistence"].rmse
    np.testing.assert_allclose(ratio, 0.1, rtol=1e-9)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--test", "monaco"], "test 'monaco' is unknown: choose from nominal"),
        (["--test", "slalom"], "the test 'nominal' is part of every run"),
        (["--seeds", "0"], "--seeds is 0: choose 1 to 100"),
        (["--jobs", "0"], "--jobs is 0: choose 1 to 64"),
        (["--epochs", "0"], "--epochs is 0: choose 1 to 1000000"),
        (["--steps", "0"], "steps is 0"),
        (["--recordings", "no/such"], "--recordings no/such is not a folder"),
        (["--out", "setup.py"], "setup.py is a file: name a folder for --out"),
        (["--out", "requirements"], "requirements is not empty and holds no earlier result"),
    ],
)
def test_wrong_requests_are_refused(
    capsys: pytest.CaptureFixture[str], arguments: list[str], said: str
) -> None:
    assert said in refused(capsys, ["bench", "paper", *arguments], 2)


@pytest.mark.parametrize("as_json", [False, True])
def test_the_command_prints_one_line_per_criterion(
    done: tuple[runs.Result, Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str], as_json: bool,
) -> None:  # fmt: skip
    result, folder, _ = done
    plans: list[BenchPlan] = []

    def ready(plan: BenchPlan, place: Path, *rest: object) -> runs.Result:
        plans.append(plan)
        for path in folder.glob("*.np[yz]"):
            (place / path.name).write_bytes(path.read_bytes())
        return result

    monkeypatch.setattr(runs, "run_paper", ready)
    given = ["bench", "paper", "--quick", "--no-peers", "--out", str(tmp_path / "out")]
    given += ["--test", "nominal", "--test", "slalom", "--seeds", "2"]
    assert main([*given, "--json"] if as_json else given) == 0
    said = capsys.readouterr()
    assert plans[0].quick
    assert plans[0].paper_epochs < BenchPlan().paper_epochs
    assert plans[0].train.steps < TrainSettings().steps
    assert (tmp_path / "out" / "report.html").is_file()
    assert main(given) == 2
    assert "holds an earlier result: add --force" in capsys.readouterr().err
    if as_json:
        answer = json.loads(said.out)
        assert answer["criteria"][0]["name"] == "geometric-mean"
        assert {claim["verdict"] for claim in answer["claims"]}
        return
    printed = lines(said.out)
    assert all(line.split()[0] in ("PASS", "FAIL", "INFO") for line in printed)
    assert "FAIL ahead-of-pykoop not measured: switched off (--no-peers)" in printed
    assert "FAIL av21 not measured: give --recordings DIR" in printed
    assert any("default clean seed 1" in line for line in lines(said.err))


def test_table_names_are_in_the_table_order() -> None:
    assert MF_TUNED in ORDER
    assert set(NAIVE) < set(ORDER)
