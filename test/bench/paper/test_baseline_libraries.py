# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Baseline libraries: requests to the other environment and its replies, with a fake library."""

from __future__ import annotations

import dataclasses
import re
import runpy
import sys
import textwrap
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from adk_ros.bench.paper import baseline_libraries
from adk_ros.bench.paper.baseline_libraries import Peers, find_python, stretches
from adk_ros.bench.paper.last_readings import last_new, predict_from_new_readings
from adk_ros.errors import DataError, UsageError
from adk_ros.signals.channels import TICK_NS, Flag, Record

ROOT = Path(__file__).resolve().parents[3]

# Predicts that x stays, after what a fit has told it to add; says what it was given.
FAKE_WORKER = """
import sys
import numpy as np

shift = 0.0
for line in sys.stdin:
    source, target = line.rstrip("\\n").split("\\t")
    with np.load(source) as job:
        if "peers" in job:
            shift = float(job["x"].shape[0])
            answer = {}
            for name in job["peers"].tolist():
                answer[name + "_settings"] = f"{len(set(job['episode'].tolist()))} episodes"
                answer[name + "_check"] = CHECK
        else:
            x = job["x"][job["rows"]][:, None, :]
            answer = {"predicted": np.repeat(x, int(job["ahead"]), axis=1) + shift}
    np.savez(target, **answer)
    print("done", flush=True)
"""


def script(folder: Path, text: str = FAKE_WORKER, check: float = 1e-9) -> Path:
    path = folder / "fake_worker.py"
    path.write_text(textwrap.dedent(text).replace("= CHECK", f"= {check!r}"))
    return path


def record(n: int = 300, seed: int = 0) -> Record:
    random = np.random.default_rng(seed)
    x = 15.0 + random.normal(size=(n, 3)).cumsum(axis=0) * 0.01
    zeros = np.zeros(n, dtype=np.int64)
    stamps = np.arange(n, dtype=np.int64) * TICK_NS
    u = random.normal(size=(n, 2))
    return Record(stamps, x, u, np.zeros((n, 2)), zeros, x.copy(), zeros.copy())


def fitted(folder: Path, text: str = FAKE_WORKER, check: float = 1e-9, **options: Any) -> Peers:
    return Peers([record()], sys.executable, worker=script(folder, text, check), **options)


def test_job_and_answer(tmp_path: Path) -> None:
    with fitted(tmp_path) as both:
        assert [p.name for p in both.predictors] == ["pykoop", "pykoopman"]
        assert {p.settings for p in both.predictors} == {"1 episodes"}
        test = record(seed=1)
        rows = np.array([10, 50, 51])
        for peer in both.predictors:
            predicted = peer.predict(test, rows, 4)
            assert predicted.shape == (3, 4, 3)
            expected = np.repeat(test.x[rows][:, None], 4, axis=1) + 300.0
            np.testing.assert_array_equal(predicted, expected)
            assert peer.predict(test, rows[:0], 4).shape == (0, 4, 3)
    with pytest.raises(UsageError, match="closed"):
        both.predictors[0].predict(test, rows, 4)


def test_a_repeated_reading_is_no_start(tmp_path: Path) -> None:
    test = record(seed=1)
    flags = test.flags.copy()
    flags[[50, 51, 60, 200]] |= int(Flag.ODOMETRY_STALE)
    # There the readings before lack two past ones.
    later = (np.arange(300) >= 198).astype(np.int64)
    test = dataclasses.replace(test, flags=flags, episode=later)
    with fitted(tmp_path) as both:
        predicted = both.predictors[0].predict(test, np.array([49, 50, 51, 52, 60, 200]), 4)
    from_rows = np.array([49, 49, 49, 52, 59, 200])
    assert predicted.shape == (6, 4, 3)
    np.testing.assert_array_equal(predicted[:, 0], test.x[from_rows] + 300.0)


@pytest.mark.parametrize("past", [0, 2])
def test_what_is_predicted_up_to_a_row_is_left_out(past: int) -> None:
    test = record()
    flags = test.flags.copy()
    flags[[1, 30, 31]] |= int(Flag.ODOMETRY_STALE)
    flags[40:60] |= int(Flag.ODOMETRY_STALE)
    rows = np.array([1, 29, 31, 45, 55])
    found = predict_from_new_readings(
        dataclasses.replace(test, flags=flags), rows, 3,
        lambda _, starts, steps: np.repeat(starts[:, None] + np.arange(1, steps + 1), 3).reshape(
            starts.size, steps, 3
        ),
        past,
    )  # fmt: skip
    # State j after a row is that of the row plus j, from wherever it is predicted.
    np.testing.assert_array_equal(found[:, :, 0], rows[:, None] + np.arange(1, 4))
    # None is older than eight rows, with those before it.
    starts = [1 if past else 0, 29, 29, 39, 55]
    np.testing.assert_array_equal(
        last_new(dataclasses.replace(test, flags=flags), rows, past), starts
    )


def test_only_contiguous_good_samples_are_learned_from() -> None:
    drive = record(200)
    flags, episode, x, u = (v.copy() for v in (drive.flags, drive.episode, drive.x, drive.u))
    flags[40:45] = int(Flag.FROZEN)
    x[70] = np.nan
    u[80] = np.inf
    episode[150:] = 1
    damaged = dataclasses.replace(drive, flags=flags, episode=episode, x=x, u=u)
    found_x, found_u, number = stretches([damaged, drive])
    # 71 to 79 is too short.
    lengths = [40, 25, 69, 50, 200]
    assert np.unique(number, return_counts=True)[1].tolist() == lengths
    assert np.isfinite(found_x).all()
    assert np.isfinite(found_u).all()
    np.testing.assert_array_equal(found_x[-200:], drive.x)
    np.testing.assert_array_equal(found_x[40:65], drive.x[45:70])
    with pytest.raises(DataError, match="no training data"):
        stretches([drive.rows(slice(0, 10))])


def test_a_missing_environment_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(baseline_libraries.VARIABLE, raising=False)
    monkeypatch.setattr(baseline_libraries, "_SOURCE_FOLDER", tmp_path)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UsageError, match=r"no \.venv-peers: run `make peers`") as caught:
        Peers([record()])
    assert "\n" not in str(caught.value)
    monkeypatch.setenv(baseline_libraries.VARIABLE, str(tmp_path / "none"))
    with pytest.raises(UsageError, match="none is not an executable"):
        find_python()
    with pytest.raises(UsageError, match="is not an executable"):
        find_python(tmp_path)
    monkeypatch.setenv(baseline_libraries.VARIABLE, sys.executable)
    assert find_python() == Path(sys.executable)
    monkeypatch.delenv(baseline_libraries.VARIABLE)
    made = tmp_path / ".venv-peers" / "bin" / "python"
    made.parent.mkdir(parents=True)
    made.symlink_to(sys.executable)
    assert find_python() == made


def test_an_environment_without_the_libraries_is_refused(tmp_path: Path) -> None:
    """The real worker in a Python without the libraries."""
    pattern = r"is broken \(ModuleNotFoundError: No module named 'no_such_peer'\): run `make"
    text = baseline_libraries.WORKER.read_text().replace('"pykoop"', '"no_such_peer"')
    with pytest.raises(UsageError, match=pattern):
        Peers([record()], sys.executable, worker=script(tmp_path, text), names=["no_such_peer"])


@pytest.mark.parametrize(
    ("text", "error", "said"),
    [
        ("raise SystemExit('broken for a reason')", UsageError, "broken for a reason.*make peers"),
        ("input(); print('failed ValueError: bad data', flush=True)", DataError, "bad data"),
        ("input(); print('done', flush=True); input()", DataError, "baseline libraries failed"),
    ],
)
def test_a_failing_worker_is_reported(
    tmp_path: Path, text: str, error: type[Exception], said: str
) -> None:
    with pytest.raises(error, match=said):
        fitted(tmp_path, text)


def test_a_hanging_worker_is_stopped(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"more than 0.5 s"):
        fitted(tmp_path, "import time; time.sleep(60)", timeout_s=0.5)


@pytest.mark.parametrize("check", [1e-3, float("nan")])
def test_batches_that_differ_from_the_library_are_refused(tmp_path: Path, check: float) -> None:
    text = FAKE_WORKER.replace("CHECK", f"float('{check}')")
    with pytest.raises(DataError, match="batch predictions differ"):
        fitted(tmp_path, text)


def test_an_answer_of_another_shape_is_refused(tmp_path: Path) -> None:
    text = FAKE_WORKER.replace('int(job["ahead"])', "2")
    with fitted(tmp_path, text) as both, pytest.raises(DataError, match=r"shape \(1, 2, 3\)"):
        both.predictors[0].predict(record(), np.array([5]), 4)


class Linear:
    """A fake library with one relevant setting, for the code of the worker."""

    labels = ("ridge",)
    tried: list[float]

    def __init__(self) -> None:
        self.tried = []

    @staticmethod
    def candidates() -> Iterator[tuple[float]]:
        return iter([(1e3,), (0.0,), (1.0,)])

    def fit(self, episodes: list[tuple[Any, Any]], setting: tuple[float]) -> None:
        self.tried.append(setting[0])
        self.lengths = [len(x) for x, _ in episodes]
        phi = np.concatenate([np.hstack([x[:-1], u[:-1]]) for x, u in episodes])
        y = np.concatenate([x[1:] for x, _ in episodes])
        self.matrix = np.linalg.solve(phi.T @ phi + setting[0] * np.eye(5), phi.T @ y)

    def predict(self, x: Any, u: Any) -> Any:
        state, out = x[:, -1], []
        for step in range(2, u.shape[1]):
            state = np.hstack([state, u[:, step]]) @ self.matrix
            out.append(state)
        return np.stack(out, axis=1)

    def library_prediction(self, x: Any, u: Any) -> Any:
        return self.predict(x[None], u[None])[0]


def linear_drive(n: int, seed: int) -> Record:
    drive = record(n, seed)
    a = np.diag([0.99, 0.9, 0.8])
    b = np.random.default_rng(9).normal(size=(3, 2))
    x = np.zeros((n, 3))
    for k in range(n - 1):
        x[k + 1] = a @ x[k] + b @ drive.u[k]
    return dataclasses.replace(drive, x=x, x_ref=x)


def test_the_worker_validates_on_the_last_part(tmp_path: Path) -> None:
    worker = runpy.run_path(str(baseline_libraries.WORKER), run_name="worker")
    worker["PEERS"]["linear"] = Linear
    x, u, episode = stretches([linear_drive(600, 1), linear_drive(500, 2)])
    known: dict[str, Any] = {}
    job = {"peers": np.array(["linear"]), "x": x, "u": u, "episode": episode}
    answer = worker["fit"](job, known)
    assert answer["linear_settings"] == "ridge 0.0"
    assert answer["linear_check"] < 1e-12
    assert known["linear"].tried == [1e3, 0.0, 1.0, 0.0]
    assert known["linear"].lengths == [600, 500]
    test = linear_drive(300, 3)
    later = (np.arange(300) >= 100).astype(np.int64)
    rows = np.array([0, 1, 2, 50, 99, 100, 101, 102, 200])
    asked = {
        "peer": np.array("linear"),
        "x": test.x,
        "u": test.u,
        "episode": later,
        "rows": rows,
        "ahead": np.array(40),
    }
    predicted = worker["predict"](asked, known)["predicted"]
    lacks_past = np.isin(rows, [0, 1, 100, 101])
    assert np.isnan(predicted[lacks_past]).all()
    truth = test.x[rows[:, None] + np.arange(1, 41)]
    np.testing.assert_allclose(predicted[~lacks_past], truth[~lacks_past], atol=1e-8)


def test_a_drive_cut_into_short_stretches_is_validated_on_whole_ones() -> None:
    """A fifth of 60 rows is shorter than two seconds, which no start would have ahead."""
    worker = runpy.run_path(str(baseline_libraries.WORKER), run_name="worker")
    rng = np.random.default_rng(0)
    episodes = [(rng.normal(size=(n, 3)), rng.normal(size=(n, 2))) for n in [60, 130] * 6]
    fitted, validation = worker["split"](episodes)
    assert [len(x) for x, _ in fitted] == [60, 130, 60, 130, 130, 60, 130, 60, 60, 130]
    assert [len(x) for x, _ in validation] == [60, 130]
    # Of long ones, the last fifth of each.
    longer = [*episodes, (np.zeros((900, 3)), np.zeros((900, 2)))]
    assert len(worker["split"](longer)[1]) == len(longer)
    past, commands, truth = worker["starts"](validation)
    assert len(past) == len(commands) == len(truth) == 57 + 127
    assert truth.shape[1] == 80
    known = np.isfinite(truth).all(axis=2).sum(axis=1)
    assert known.min() == 1
    assert (known == 80).sum() == 48
    # The last command is held where a horizon leaves its stretch.
    np.testing.assert_array_equal(commands[56, -1], validation[0][1][-1])


def test_one_long_stretch_does_not_decide_how_short_ones_are_validated() -> None:
    """A sample in a hundred is lost: of 303 stretches the longest has 809 rows."""
    worker = runpy.run_path(str(baseline_libraries.WORKER), run_name="worker")
    drawn = np.random.default_rng(0).geometric(0.01, 360)
    ends = np.cumsum(drawn[drawn >= baseline_libraries.MIN_STRETCH])
    rows = np.arange(ends[-1])
    # Numbered, to compare what is fitted with what is validated.
    episodes = [(x[:, None], x[:, None]) for x in np.split(rows, ends[:-1])]
    assert (len(episodes), max(len(x) for x, _ in episodes)) == (303, 809)
    fitted, validation = worker["split"](episodes)
    numbers = [np.concatenate([x[:, 0] for x, _ in part]) for part in (fitted, validation)]
    assert not np.intersect1d(numbers[0], numbers[1]).size
    assert 0.15 < len(numbers[1]) / len(rows) < 0.25
    # The last fifths have 194.
    assert worker["known_starts"](validation)[0] == 3850


def test_the_worker_needs_only_numpy_and_the_libraries() -> None:
    text = baseline_libraries.WORKER.read_text()
    names = {
        line.split()[1].split(".")[0]
        for line in re.findall(r"^(?:import|from) .*$", text, re.MULTILINE)
    }
    assert names - set(sys.stdlib_module_names) == {"numpy"}


def test_make_peers_installs_wheels_of_pinned_versions() -> None:
    lines = (ROOT / "requirements" / "peers.txt").read_text().splitlines()
    pins = [line for line in lines if line and not line.startswith("#")]
    assert all(re.fullmatch(r"[a-z0-9-]+==[0-9.]+", line) for line in pins), pins
    names = {line.split("==")[0] for line in pins}
    assert {"pykoop", "pykoopman", "numpy", "scikit-learn"} <= names
    assert not names & {"torch", "lightning"}
    makefile = (ROOT / "Makefile").read_text()
    assert re.search(r"^peers:.*## \S", makefile, re.MULTILINE)
    assert "--no-deps --only-binary :all: -r requirements/peers.txt" in makefile


def test_a_thread_that_waits_ends_when_another_closes_the_worker(tmp_path: Path) -> None:
    waits = script(tmp_path, "import time\ntime.sleep(600)\n")
    worker = baseline_libraries.Worker(Path(sys.executable), waits, timeout_s=600.0)
    with ThreadPoolExecutor(1) as pool:
        asked = pool.submit(worker.ask, x=np.zeros(3))
        time.sleep(0.5)
        worker.close()
        with pytest.raises((UsageError, ValueError)):
            asked.result(timeout=10.0)
