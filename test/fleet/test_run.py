# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Runs of a stage with a real scheduler and workers, undisturbed and disturbed.

Workers, scheduler and driver are processes of their own on the loopback interface.
"""

from __future__ import annotations

import os
import random
import re
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import psutil
import pytest
from helpers.fleet import compared, text_fleet, text_stage
from pyarrow.parquet import ParquetFile  # type: ignore[import-untyped, unused-ignore]

from adk_ros.api.fleet.fleet_run import FleetOptions, workers_of
from adk_ros.api.fleet.results import fleet_frame, fleet_summary
from adk_ros.bench.fleet.disturbed_runs import RunningCluster, environment
from adk_ros.errors import DataError, UsageError
from adk_ros.fleet.cluster import open_cluster
from adk_ros.fleet.dataset import UNREADABLE, FleetDataset
from adk_ros.fleet.engine import Task, run_tasks
from adk_ros.fleet.plan import current_rows
from adk_ros.fleet.recording_work import hash_of_recording
from adk_ros.fleet.recordings import content_hash, find_recordings
from adk_ros.fleet.run import Limits, run_stage
from adk_ros.fleet.stage import version_of
from adk_ros.fleet.stage_process import Failure, Reply, call

SEED = 18
WORK_S = 0.4
"""Time that a recording takes, s."""
KILLS = int(os.environ.get("ADK_ROS_KILLS", "3"))
"""Of workers, of the driver, and of the scheduler and its workers; doc/fleet.md names more."""
FLEET = {f"r{i:03d}": f"ok {i}" for i in range(8 * KILLS)} | {
    "copy": "ok 3",
    "damaged": "damaged",
    "raising": "raise",
    "wrong": "wrong",
}
LIMITS = Limits(timeout_s=20.0, memory_mib=2000.0)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """Return the rows of an undisturbed run."""
    folder = tmp_path_factory.mktemp("undisturbed")
    return rows_of(folder, run(folder, folder / "log"))


def run(folder, log, cluster=None, limits=LIMITS, nap_s=0.0, progress=None, fleet=None):
    recordings = text_fleet(folder / "drives", FLEET if fleet is None else fleet)
    stage = text_stage(log, nap_s=nap_s)
    cluster = cluster or partial(open_cluster, 2)
    return run_stage(stage, recordings, folder / "out", cluster, limits, progress)


def rows_of(folder, summary=None):
    return compared(FleetDataset(folder / "out").rows("text"))


@pytest.mark.slow(seconds=12)
def test_every_recording_is_a_row_and_nothing_is_computed_twice(tmp_path, undisturbed) -> None:
    texts = []
    summary = run(tmp_path, tmp_path / "log", progress=lambda *given: texts.append(given[2]))
    total = len(FLEET)
    assert (summary.total, summary.reused, summary.computed) == (total, 0, total)
    assert summary.failures == {"unusable": 1, "error": 2}
    assert rows_of(tmp_path) == undisturbed
    assert len(undisturbed) == (total - 3) * 2 + 3
    stage = text_stage(tmp_path / "log")
    # The copy has the content of another recording.
    assert sorted(stage.starts().values()) == [1] * (len(FLEET) - 1)
    assert any(f"text {total - 1}/{total - 1}" in text and "a minute" in text for text in texts)
    again = run(tmp_path, tmp_path / "log", cluster=no_cluster)
    assert (again.reused, again.computed) == (total, 0)
    # A recording that is moved is not computed again; rows of a copy are copied.
    (tmp_path / "drives" / "r001.mcap").rename(tmp_path / "drives" / "moved.mcap")
    (tmp_path / "drives" / "new.mcap").write_text("ok 99")
    names = {path.stem for path in (tmp_path / "drives").iterdir()}
    moved = run_stage(
        stage, find_recordings([str(tmp_path / "drives")]), tmp_path / "out",
        partial(open_cluster, 1), LIMITS,
    )  # fmt: skip
    assert len(names) == total + 1
    assert (moved.reused, moved.computed) == (total, 1)
    assert sorted(stage.starts().values()) == [1] * total
    assert len([row for row in rows_of(tmp_path) if row["recording"] == "moved.mcap"]) == 2


def no_cluster():
    raise AssertionError("there is nothing to compute")


@pytest.mark.slow(seconds=25)
def test_limits_become_rows(tmp_path) -> None:
    fleet = {"hang": "hang", "die": "die", "grow": "grow", "good": "ok 1"}
    limits = Limits(timeout_s=4.0, memory_mib=300.0)
    summary = run(tmp_path, tmp_path / "log", fleet=fleet, limits=limits)
    assert summary.failures == {"timeout": 1, "killed": 1, "memory": 1}
    reasons = {row["recording"]: row["reason"] for row in rows_of(tmp_path)}
    assert reasons == {
        "hang.mcap": "takes longer than 4 s (--timeout)",
        "die.mcap": "its process was ended by signal SIGKILL, 3 times",
        "grow.mcap": "needs more than 300 MiB of memory (--memory)",
        "good.mcap": None,
    }
    limits = Limits(timeout_s=20.0, memory_mib=2000.0, retry_failed=True, count=2)
    again = run(tmp_path, tmp_path / "log", fleet=fleet, limits=limits)
    assert again.left == 1
    assert again.computed == 2


@pytest.mark.slow(seconds=30)
def test_killed_workers_lose_nothing(tmp_path, undisturbed) -> None:
    chance = random.Random(SEED)
    stop = threading.Event()
    killed: list[int] = []

    def kill_workers():
        while not list((tmp_path / "log").glob("*")) and not stop.wait(0.1):
            pass
        while not stop.wait(chance.uniform(0.5, 1.5)):
            # A child may end between the list and the look at it.
            with suppress(psutil.NoSuchProcess):
                workers = [
                    child
                    for child in psutil.Process().children(recursive=True)
                    if "spawn_main" in " ".join(child.cmdline())
                ]
                if workers and len(killed) < 2 * KILLS:
                    victim = chance.choice(workers)
                    victim.kill()
                    killed.append(victim.pid)

    thread = threading.Thread(target=kill_workers)
    thread.start()
    try:
        run(tmp_path, tmp_path / "log", nap_s=0.4)
    finally:
        stop.set()
        thread.join()
    assert len(killed) >= KILLS
    assert rows_of(tmp_path) == undisturbed


@pytest.mark.slow(seconds=20)
def test_workers_that_dask_gives_up_are_replaced(tmp_path, monkeypatch) -> None:
    """It closes the nanny of a worker that is being started again 15 s after its end."""
    monkeypatch.setattr("adk_ros.fleet.cluster._REPLACED_S", 2.0)

    @contextmanager
    def opened():
        with open_cluster(2) as cluster:
            thread = threading.Thread(target=give_up, args=(cluster._local,))
            thread.start()
            yield cluster
            thread.join()

    def give_up(local):
        while not list((tmp_path / "log").glob("*")):
            time.sleep(0.05)
        for nanny in list(local.workers.values()):
            local.sync(nanny.close)
        local.workers.clear()

    fleet = {f"r{i:02d}": f"ok {i}" for i in range(8)}
    summary = run(tmp_path, tmp_path / "log", cluster=opened, nap_s=0.4, fleet=fleet)
    assert (summary.computed, summary.failures) == (8, {})


DRIVER = """
import sys
from functools import partial
from pathlib import Path
from helpers.fleet import TextStage
from adk_ros.fleet.cluster import open_cluster
from adk_ros.fleet.recordings import content_hash, find_recordings
from adk_ros.fleet.run import Limits, run_stage
from adk_ros.shutdown import graceful_shutdown
folder, nap_s = Path(sys.argv[1]), float(sys.argv[2])
if __name__ == "__main__":
    with graceful_shutdown():
        run_stage(
            TextStage(str(folder / "log"), nap_s), find_recordings([str(folder / "drives")]),
            folder / "out", partial(open_cluster, 2, *sys.argv[3:]), Limits(20.0, 2000.0),
            lambda done, total, text: print(done, flush=True),
        )
"""


def driver(folder, *arguments):
    """Start a driver in a separate process."""
    script = folder / "driver.py"
    script.write_text(DRIVER)
    return subprocess.Popen(
        [sys.executable, str(script), str(folder), *map(str, arguments)],
        env=environment(), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


@pytest.mark.slow(seconds=60)
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_a_driver_that_is_killed_continues(tmp_path, undisturbed, number) -> None:
    chance = random.Random(SEED + number)
    text_fleet(tmp_path / "drives", FLEET)
    stage = text_stage(tmp_path / "log")
    ending_s = 0.0
    for _ in range(KILLS):
        known = len(list((tmp_path / "log").glob("*")))
        process = driver(tmp_path, WORK_S)
        # In mid-work, however long the start takes.
        while process.poll() is None and len(list((tmp_path / "log").glob("*"))) <= known:
            time.sleep(0.05)
        time.sleep(chance.uniform(0.5, 1.5))
        process.send_signal(number)
        sent_s = time.monotonic()
        process.communicate(timeout=30)
        ending_s += time.monotonic() - sent_s
        for path in (tmp_path / "out" / "results").rglob("*.parquet"):
            assert path.stat().st_size > 0
    finished = driver(tmp_path, 0.0)
    assert finished.wait(timeout=60) == 0, finished.stderr.read()
    assert rows_of(tmp_path) == undisturbed
    # A killed driver loses what was running and what it had not written for a second.
    lost = sum(stage.starts().values()) - (len(FLEET) - 1)
    assert lost <= KILLS * (2 + 2 * 3), lost
    # An interrupted one loses what was running, and what two workers began until they had ended.
    assert number == signal.SIGKILL or lost <= KILLS * 2 + 2 * ending_s / WORK_S, lost


@pytest.mark.slow(seconds=15)
def test_a_second_driver_is_refused_in_a_line(tmp_path) -> None:
    text_fleet(tmp_path / "drives", FLEET)
    first = driver(tmp_path, 0.3)
    while not (tmp_path / "out" / ".lock").exists() and first.poll() is None:
        time.sleep(0.05)
    time.sleep(0.2)
    try:
        with pytest.raises(UsageError, match=f"in use by process {first.pid} on"):
            run(tmp_path, tmp_path / "log", cluster=no_cluster)
    finally:
        first.send_signal(signal.SIGINT)
        first.communicate(timeout=30)


@pytest.fixture
def running_cluster(tmp_path):
    cluster = RunningCluster(tmp_path)
    yield cluster
    cluster.stop()


@pytest.mark.slow(seconds=60)
def test_scheduler_and_workers_are_killed(tmp_path, undisturbed, running_cluster) -> None:
    chance = random.Random(SEED)
    done = threading.Event()
    killed: list[int] = []

    def kill():
        while not list((tmp_path / "log").glob("*")) and not done.wait(0.1):
            pass
        # The scheduler first, while work is left on any machine.
        which, wait_s = 0, chance.uniform(0.5, 1.5)
        while not done.wait(wait_s) and len(killed) < max(5, KILLS):
            running_cluster.processes[which].kill()
            killed.append(which)
            which, wait_s = chance.choice([0, 0, 1, 2]), chance.uniform(3.0, 6.0)

    thread = threading.Thread(target=kill)
    opened = partial(open_cluster, 1, running_cluster.address)
    thread.start()
    try:
        run(tmp_path, tmp_path / "log", cluster=opened, nap_s=0.5)
    finally:
        done.set()
        thread.join()
    assert 0 in killed
    assert rows_of(tmp_path) == undisturbed


@pytest.mark.slow(seconds=15)
def test_no_scheduler_is_a_line(tmp_path) -> None:
    with pytest.raises(UsageError, match=r"--cluster tcp://127.0.0.1:9: no Dask scheduler"):
        run(tmp_path, tmp_path / "log", cluster=partial(open_cluster, 1, "tcp://127.0.0.1:9"))
    with pytest.raises(UsageError, match="no Dask scheduler"):
        run(tmp_path, tmp_path / "log", cluster=partial(open_cluster, 1, "nonsense://x"))


@pytest.mark.slow(seconds=20)
def test_a_scheduler_that_is_lost_between_two_stages(tmp_path) -> None:
    """Dask closes a connection that it does not get back within 5 s, and refuses tasks then."""
    running = RunningCluster(tmp_path)
    try:
        with open_cluster(1, running.address) as cluster:
            assert [reply.value for _, reply in run_tasks(cluster, [Task("a", abs, (-1,))])] == [1]
            cluster.client.close()
            assert [reply.value for _, reply in run_tasks(cluster, [Task("b", abs, (-2,))])] == [2]
    finally:
        running.stop()


@pytest.mark.slow(seconds=20)
def test_a_scheduler_that_is_lost_while_tasks_are_submitted(tmp_path) -> None:
    running = RunningCluster(tmp_path)
    try:
        with open_cluster(1, running.address) as cluster:

            def tasks():
                yield Task("a", abs, (-1,))
                cluster.client.close()
                yield Task("b", abs, (-2,))

            assert sorted(reply.value for _, reply in run_tasks(cluster, tasks())) == [1, 2]
    finally:
        running.stop()


@pytest.mark.slow(seconds=20)
def test_the_dashboard_of_a_scheduler_that_has_gone(tmp_path) -> None:
    """Progress of a stage asks for it, also when the scheduler has ended since the last stage."""
    running = RunningCluster(tmp_path)
    with open_cluster(1, running.address) as cluster:
        running.stop()
        assert cluster.dashboard == ""


@contextmanager
def fake_cluster():
    """Yield the cluster of a run whose tasks never reach a worker."""
    yield SimpleNamespace(dashboard="", lacking="")


def test_a_store_that_does_not_answer_stops_the_run(tmp_path, monkeypatch) -> None:
    """Recordings on a store that has gone are not failed: the run stops and continues later."""
    recordings = text_fleet(tmp_path / "drives", {"a": "ok 1", "b": "ok 2"})
    stage = text_stage(tmp_path / "log")
    hashed = Reply("content")
    gone = Reply(failure=Failure.UNREACHABLE, reason="s3://x does not answer")
    monkeypatch.setattr(
        "adk_ros.fleet.run.run_tasks",
        lambda cluster, tasks, wake: (
            (task, hashed if task.function is hash_of_recording else gone) for task in tasks
        ),
    )
    with pytest.raises(UsageError, match="does not answer"):
        run_stage(stage, recordings, tmp_path / "out", fake_cluster)
    assert FleetDataset(tmp_path / "out").rows("text") == []
    full = Reply(failure=Failure.DISK_FULL, reason="OSError: No space left on device")
    monkeypatch.setattr(
        "adk_ros.fleet.run.run_tasks",
        lambda cluster, tasks, wake: ((task, full) for task in tasks),
    )
    with pytest.raises(UsageError, match="disk of a worker is full"):
        run_stage(stage, recordings, tmp_path / "out", fake_cluster)


def test_a_file_that_a_worker_does_not_see_stops_the_run(tmp_path, monkeypatch) -> None:
    """Recordings without a result because of it would count as done."""
    model, unknown = tmp_path / "model", tmp_path / "packaged_name"
    model.touch()
    recordings = text_fleet(tmp_path / "drives", {"a": "ok 1"})
    stage = text_stage(tmp_path / "log", shared_paths=(str(model), str(unknown)))

    def on_another_machine(cluster, tasks, wake):
        for task in tasks:
            model.unlink(missing_ok=task.function is hash_of_recording)
            yield task, call(task.function, task.arguments)
            model.touch()

    monkeypatch.setattr("adk_ros.fleet.run.run_tasks", on_another_machine)
    with pytest.raises(UsageError, match=rf"a worker on .* does not see {model}: put it into"):
        run_stage(stage, recordings, tmp_path / "out", fake_cluster)
    assert FleetDataset(tmp_path / "out").rows("text") == []
    assert stage.starts() == {}
    run_here(monkeypatch)
    assert run_stage(stage, recordings, tmp_path / "out", fake_cluster).computed == 1


class CountingStage:
    """Counts how often the hash of its inputs is computed."""

    name, shared_paths, hashed = "text", (), 0

    @property
    def inputs_hash(self):
        self.hashed += 1
        return "inputs"

    def run(self, path, recording):
        return [{"finding": "text", "text": path.read_text()}]


def run_here(monkeypatch):
    """Let the runs of a test do their work in this process."""
    monkeypatch.setattr(
        "adk_ros.fleet.run.run_tasks",
        lambda cluster, tasks, wake: ((x, call(x.function, x.arguments)) for x in tasks),
    )


def test_a_worker_that_does_not_see_the_recordings_stops_the_run(tmp_path, monkeypatch) -> None:
    """Half of a fleet would count as unreadable where one machine lacks the mount."""
    recordings = text_fleet(tmp_path / "drives", {"a": "ok 1"})
    stage, hidden = text_stage(tmp_path / "log"), tmp_path / "hidden"

    def on_another_machine(cluster, tasks, wake):
        for task in tasks:
            (tmp_path / "drives").rename(hidden)
            yield task, call(task.function, task.arguments)

    monkeypatch.setattr("adk_ros.fleet.run.run_tasks", on_another_machine)
    with pytest.raises(UsageError, match=r"a worker on .* does not see .*drives: put it into"):
        run_stage(stage, recordings, tmp_path / "out", fake_cluster)
    hidden.rename(tmp_path / "drives")
    run_here(monkeypatch)
    assert run_stage(stage, recordings, tmp_path / "out", fake_cluster).failures == {}


def test_a_limit_bounds_what_is_hashed(tmp_path, monkeypatch) -> None:
    run_here(monkeypatch)
    recordings = text_fleet(
        tmp_path / "drives", {name: f"ok {i}" for i, name in enumerate("abcd")}
    )
    out, stage = tmp_path / "out", text_stage(tmp_path / "log")
    summary = run_stage(stage, recordings, out, fake_cluster, Limits(count=1))
    assert (summary.computed, summary.left) == (1, 3)
    assert len(FleetDataset(out).content_hashes()) == 1
    assert run_stage(stage, recordings, out, fake_cluster).computed == 3


def test_a_frame_has_the_results_of_the_last_run(tmp_path, monkeypatch) -> None:
    run_here(monkeypatch)
    stage, out = text_stage(tmp_path / "log"), tmp_path / "out"

    def values(b, stage=stage, limits=LIMITS):
        recordings = text_fleet(tmp_path / "drives", {"a": "ok 1", "b": b})
        run_stage(stage, recordings, out, fake_cluster, limits)
        frame = fleet_frame(out, "text")
        return sorted(frame[frame["recording"] == "b.mcap"]["value"])

    assert values("ok 2") == [2.0, 4.0]
    assert values("ok 30") == [30.0, 60.0]
    assert values("ok 2") == [2.0, 4.0]
    # The rows of its content are older than those that it has had.
    assert values("ok 1") == [1.0, 2.0]
    other = text_stage(tmp_path / "log", inputs_hash="other")
    assert values("ok 30", other) == [30.0, 60.0]
    assert values("ok 2") == [2.0, 4.0]
    # A run that has not come to it yet: "ok 1000" is larger and comes first.
    text_fleet(tmp_path / "drives", {"c": "ok 1000"})
    assert values("ok 5", limits=Limits(count=1)) == []


def test_a_summary_reads_no_details(tmp_path, monkeypatch) -> None:
    """They are most of the data: the evidence of a recording has hundreds of kilobytes."""
    run_here(monkeypatch)
    recordings = text_fleet(tmp_path / "drives", {"a": "ok 1", "b": "damaged"})
    run_stage(text_stage(tmp_path / "log"), recordings, tmp_path / "out", fake_cluster)
    read, columns = ParquetFile.read, []

    def noted(*given, **named):
        columns.extend(named["columns"])
        return read(*given, **named)

    monkeypatch.setattr(ParquetFile, "read", noted)
    (summary,) = fleet_summary(tmp_path / "out")
    assert (summary["recordings"], summary["failed"]) == (2, {"unusable": 1})
    assert summary["reasons"] == {"b.mcap": "b.mcap is damaged"}
    assert "details" not in columns
    (tmp_path / "drives" / "a.mcap").rename(tmp_path / "drives" / "moved.mcap")
    moved = find_recordings([str(tmp_path / "drives")])
    run_stage(text_stage(tmp_path / "log"), moved, tmp_path / "out", fake_cluster)
    (summary,) = fleet_summary(tmp_path / "out")
    assert (summary["recordings"], summary["contents"]) == (3, 2)
    FleetDataset(tmp_path / "out").drop("text", set(FleetDataset(tmp_path / "out").done("text")))
    assert fleet_frame(tmp_path / "out", "text").empty


def test_the_inputs_are_hashed_once_for_a_run(tmp_path, monkeypatch) -> None:
    """The simulation may be a bag of gigabytes, and the fleet has thousands of recordings."""
    run_here(monkeypatch)
    recordings = text_fleet(tmp_path / "drives", {f"r{i}": f"ok {i}" for i in range(9)})
    stage = CountingStage()
    assert run_stage(stage, recordings, tmp_path / "out", fake_cluster).computed == 9
    assert stage.hashed == 1
    assert {row["inputs_hash"] for row in rows_of(tmp_path)} == {"inputs"}


def test_a_recording_that_could_not_be_read_is_read_again_on_demand(tmp_path, monkeypatch) -> None:
    run_here(monkeypatch)
    (tmp_path / "a.mcap").write_text("content")
    readable = False

    def hashed(recording):
        if readable:
            return content_hash(recording)
        raise UsageError(f"{recording.uri} cannot be read")

    monkeypatch.setattr("adk_ros.fleet.recording_work.content_hash", hashed)
    stage, found = CountingStage(), find_recordings([str(tmp_path / "a.mcap")])

    def run_again(limits):
        run_stage(stage, found, tmp_path / "out", fake_cluster, limits)
        return current_rows(version_of(stage), found, FleetDataset(tmp_path / "out"))

    (row,) = run_again(LIMITS)
    assert row["content_hash"].startswith(UNREADABLE)
    readable = True
    (row,) = run_again(LIMITS)
    assert row["content_hash"].startswith(UNREADABLE), "not asked for"
    (row,) = run_again(replace(LIMITS, retry_failed=True))
    assert row["content_hash"] == content_hash(found[0])
    assert run_again(LIMITS) == [row]


class GrowingStage(CountingStage):
    """Reads a recording to which something is appended meanwhile."""

    def run(self, path, recording):
        rows = super().run(path, recording)
        if len(path.read_text()) < 10:
            path.write_text("more and complete")
        return rows


def test_a_recording_that_is_still_being_written_has_no_result(tmp_path, monkeypatch) -> None:
    run_here(monkeypatch)
    path, out = tmp_path / "a.mcap", tmp_path / "out"
    path.write_text("half")
    stage = GrowingStage()
    # It grows before its content is hashed.
    early = find_recordings([str(path)])
    path.write_text("half of")
    texts = []
    for found in (early, find_recordings([str(path)]), None):
        listed = found or find_recordings([str(path)])
        run_stage(stage, listed, out, fake_cluster, LIMITS)
        (row,) = current_rows(version_of(stage), listed, FleetDataset(out))
        texts.append(row["reason"] or row["text"])
    assert "has changed while it was read" in texts[0]
    assert "has changed while it was read" in texts[1]
    assert texts[2] == "more and complete"


class MovingStage(CountingStage):
    """Does not find a recording that is moved before it is read, once."""

    def run(self, path, recording):
        moved = path.with_name("moved.mcap")
        if not moved.exists():
            path.rename(moved)
            raise DataError(f"{path} does not exist")
        return super().run(path, recording)


def test_a_recording_that_was_moved_meanwhile_is_read_where_it_is(tmp_path, monkeypatch) -> None:
    """That it was gone is no result of its content, which the moved one has as well."""
    run_here(monkeypatch)
    (tmp_path / "a.mcap").write_text("content")
    stage, out = MovingStage(), tmp_path / "out"
    summary = run_stage(
        stage, find_recordings([str(tmp_path / "*.mcap")]), out, fake_cluster, LIMITS
    )
    assert summary.failures == {"changed": 1}
    listed = find_recordings([str(tmp_path / "*.mcap")])
    summary = run_stage(stage, listed, out, fake_cluster, LIMITS)
    assert (summary.reused, summary.computed, summary.failures) == (0, 1, {})
    (row,) = current_rows(version_of(stage), listed, FleetDataset(out))
    assert (row["recording"], row["text"]) == ("moved.mcap", "content")


def test_what_is_left_for_later_keeps_its_reason(tmp_path, monkeypatch) -> None:
    run_here(monkeypatch)
    for name in "abc":
        (tmp_path / f"{name}.mcap").write_text(name)

    def unreadable(recording):
        raise UsageError(f"{recording.uri} cannot be read")

    def run_unreadable(self, path, recording):
        raise DataError(f"{path} cannot be read")

    monkeypatch.setattr("adk_ros.fleet.recording_work.content_hash", unreadable)
    monkeypatch.setattr(CountingStage, "run", run_unreadable)
    stage, found, out = CountingStage(), find_recordings([str(tmp_path)]), tmp_path / "out"
    run_stage(stage, found, out, fake_cluster, LIMITS)
    run_stage(stage, found, out, fake_cluster, replace(LIMITS, retry_failed=True, count=1))
    frame = fleet_frame(out, stage.name)
    assert sorted(frame["recording"]) == ["a.mcap", "b.mcap", "c.mcap"]
    # Also where one that could be read takes the limit.
    monkeypatch.setattr("adk_ros.fleet.recording_work.content_hash", content_hash)
    (tmp_path / "d.mcap").write_text("d")
    found = find_recordings([str(tmp_path / "d.mcap")])
    run_stage(stage, found, out, fake_cluster, LIMITS)
    monkeypatch.setattr("adk_ros.fleet.recording_work.content_hash", unreadable)
    found = find_recordings([str(tmp_path)])
    run_stage(stage, found, out, fake_cluster, replace(LIMITS, retry_failed=True, count=1))
    frame = fleet_frame(out, stage.name)
    assert len(frame) == 4
    assert frame["reason"].str.contains("cannot be read").all()


def test_a_tag_with_the_name_of_a_column_keeps_both(tmp_path, monkeypatch) -> None:
    run_here(monkeypatch)
    (tmp_path / "a.mcap").write_text("content")
    stage, out = CountingStage(), tmp_path / "out"
    run_stage(stage, find_recordings([str(tmp_path)]), out, fake_cluster, LIMITS)
    table = "recording,vehicle,time,status,rain,time_s\na.mcap,car,,loaded,no,x\n"
    (out / "fleet.csv").write_text(table)
    (row,) = fleet_frame(out, stage.name).to_dict("records")
    assert (row["status"], row["status_tag"], row["rain"]) == ("ok", "loaded", "no")
    assert (row["vehicle"], row["time_s_tag"]) == ("car", "x")


@pytest.mark.slow(seconds=10)
def test_a_scheduler_without_workers_is_said(tmp_path) -> None:
    running = RunningCluster(tmp_path, workers=0)

    def progress(done, total, text):
        if "no worker" in text:
            raise KeyboardInterrupt(text)

    try:
        lacking = f"no worker is connected: start one with 'dask worker {running.address}'"
        with pytest.raises(
            KeyboardInterrupt, match=re.escape(f"hashing 0/{len(FLEET)}, {lacking}")
        ):
            run(tmp_path, tmp_path / "log", partial(open_cluster, 1, running.address),
                progress=progress)  # fmt: skip
        assert workers_of(FleetOptions(2, running.address)) == 0
    finally:
        running.stop()
    assert workers_of(FleetOptions(2)) == 2
