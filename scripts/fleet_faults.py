# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Disturb runs of `adk fleet` and compare their results with those of an undisturbed run.

    python scripts/fleet_faults.py [--times 20] [--seed 0] [--only worker --only "full disk"]

Faults: SIGKILL of a worker, of the scheduler or of the driver at random moments of `index` and
`mismatch`; a full disk; a store that does not answer for a minute; two drivers on one folder. A
run that stops is started again by the same command. Recordings, all processes and the store are
on this machine. Prints a row of a table for each kind of fault, then PASS or FAIL for each
criterion. The exit code is 0 even if one fails.
"""

from __future__ import annotations

import argparse
import itertools
import logging
import os
import random
import re
import shutil
import subprocess
import tempfile
import time
import urllib.request
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import psutil

from adk_ros.bench.fleet.disturbed_runs import (
    WORKERS,
    Driver,
    RunningCluster,
    compared_rows,
    different_rows,
    repeats_of,
)
from adk_ros.fleet.dataset import SCRATCH
from adk_ros.fleet.demo.fleet_folder import write_fleet
from adk_ros.fleet.demo.fleet_plan import FleetSize, InjectedTerm, plan_fleet
from adk_ros.fleet.inference.levels import SHARED, Level
from adk_ros.plant.injection.injectors import scale_strength

if TYPE_CHECKING:
    from moto.server import ThreadedMotoServer

SIZE = FleetSize(5, 8, (30.0, 40.0), 120.0, 1, 1, 2)
_MISSING = "aero_drag"
"""Effect that the simulation lacks, at full strength: `mismatch` claims it, and makes passes."""
MISMATCH_SHARE = 4
"""A verb that takes longer is disturbed at one of so many kills. By choice."""
ROUND_SHARE = 4
"""Rounds of two drivers: one for so many kills. By choice."""
INDEX, MISMATCH = "index", "mismatch"
KILLED = ("worker", "scheduler", "driver")
FULL, STORE, SECOND = "full disk", "unreachable store", "second driver"
_NAP_S = 0.3
"""Time that each stage waits first: it spreads the work in time, also on a fast machine."""
_POLL_S = 0.05
_LONGEST_S = 1800.0
"""Duration after which a run counts as one that does not end."""
_LEFT_S = 30.0
"""Time that the processes of a run may take to end after it."""
_DISK_MIB, _PAGE_BYTES = 4, 4096
_BUCKET = "fleet"


@dataclass(frozen=True)
class Verb:
    """
    A verb of `adk fleet`: its arguments, which workers it uses, and its undisturbed run.

    `seconds`: duration of that run, `rows`: what it has found.
    """

    arguments: tuple[str, ...]
    workers: tuple[str, ...] = ("--workers", str(WORKERS))
    seconds: float = 0.0
    rows: Counter[str] = field(default_factory=Counter)

    @property
    def name(self) -> str:
        """Name of the verb."""
        return self.arguments[0]


@dataclass
class Tally:
    """
    What one kind of fault did.

    `faults`; results that `ended` without another start, and further starts (`resumed`); rows
    `compared` and `different`, and the first of these as an `example`; pairs of stage and
    recording that were `started` again, also after their result was `stored`; processes that were
    `left`; messages of runs that `stopped`.
    """

    name: str
    faults: int = 0
    ended: int = 0
    resumed: int = 0
    compared: int = 0
    different: int = 0
    started: int = 0
    stored: int = 0
    left: int = 0
    stopped: list[str] = field(default_factory=list)
    example: str = ""

    def add_result(
        self, log: Path, out: Path, verb: Verb, rows: Counter[str] | None = None
    ) -> None:
        """Compare a finished result, by default its rows, with that of the undisturbed run."""
        found = compared_rows(out) if rows is None else rows
        self.compared += verb.rows.total()
        different = different_rows(verb.rows, found)
        self.different += len(different)
        self.example = self.example or "".join(different[:1])
        repeats = repeats_of(log, out)
        self.started += repeats.started
        self.stored += repeats.stored

    @property
    def row(self) -> str:
        """Row of the table."""
        values = [self.name, self.faults, self.ended, self.resumed, self.compared, self.different]
        return f"| {' | '.join(map(str, [*values, self.started, self.stored]))} |"


HEADINGS = (
    "fault", "times", "ended by themselves", "started again", "rows compared", "rows different",
    "recordings computed twice", "after they were stored",
)  # fmt: skip


class Faults:
    """Runs in folders below `root`, of a small fleet that is simulated first."""

    def __init__(self, root: Path, seed: int) -> None:
        self._root, self._seed = root, seed
        fleet = root / "demo"
        missing = InjectedTerm(_MISSING, scale_strength(_MISSING, 1.0), Level(SHARED))
        write_fleet(replace(plan_fleet(0, SIZE), terms=(missing,)), fleet)
        self.drives = fleet / "drives"
        simulation = ["--simulation", str(fleet / "simulation"), "--reports", "0"]
        vehicle = ["--vehicle", str(fleet / "vehicle.yaml")]
        self.index = self._undisturbed((INDEX, str(self.drives)))
        self.mismatch = Verb((MISMATCH, str(self.drives), *simulation, *vehicle))

    def _undisturbed(self, arguments: Sequence[str]) -> Verb:
        verb = Verb(tuple(arguments))
        log, out = self._folder(f"{verb.name} undisturbed")
        started = time.monotonic()
        with self._driver(log, out, verb) as driver:
            code = driver.wait(_LONGEST_S)
            if code != 0:
                raise SystemExit(f"the undisturbed run ends with {code}: {driver.lines}")
        seconds = time.monotonic() - started
        rows = compared_rows(out)
        print(f"undisturbed {verb.name}: {rows.total()} rows in {seconds:.1f} s", flush=True)
        return replace(verb, seconds=seconds, rows=rows)

    def killed(self, kind: str, verb: str, times: int) -> Tally:
        """Kill processes of one kind in runs of `index`, or less often in runs of `mismatch`."""
        if verb == INDEX:
            return self._killed(kind, self.index, times)
        if not self.mismatch.rows:
            self.mismatch = self._undisturbed(self.mismatch.arguments)
        return self._killed(kind, self.mismatch, -(-times // MISMATCH_SHARE))

    def _killed(self, kind: str, verb: Verb, times: int) -> Tally:
        chance = random.Random(f"{self._seed} {kind} {verb.name}")
        tally = Tally(f"{kind} killed, {verb.name}")
        with ExitStack() as stack:
            cluster: RunningCluster | None = None
            given = verb
            if kind == "scheduler":
                cluster = RunningCluster(self._folder(tally.name)[0].parent)
                stack.callback(cluster.stop)
                given = replace(verb, workers=("--cluster", cluster.address))
            kill = _killer(kind, cluster, chance)
            numbers = itertools.count()
            while tally.faults < times:
                log, out = self._folder(f"{tally.name} {next(numbers)}")
                is_resumed = False
                while self._run(log, out, given, tally, times, kill, chance) != 0:
                    is_resumed = True
                    tally.resumed += 1
                    if tally.resumed > 2 * times:
                        raise SystemExit(f"runs do not end: {tally}")
                tally.ended += not is_resumed
                tally.add_result(log, out, verb)
                shutil.rmtree(out)
        return tally

    def _run(
        self,
        log: Path,
        out: Path,
        verb: Verb,
        tally: Tally,
        times: int,
        kill: Callable[[Driver], bool],
        chance: random.Random,
    ) -> int:
        """
        Run a verb and kill at a random moment of it; again when work goes on after that.

        Returns the exit code, negative after a signal.
        """
        with self._driver(log, out, verb) as driver:
            begun = time.monotonic()
            moment = begun + chance.uniform(0.0, verb.seconds)
            known = -1
            while (code := driver.exit_code()) is None and time.monotonic() - begun < _LONGEST_S:
                time.sleep(_POLL_S)
                if tally.faults == times or time.monotonic() < moment:
                    continue
                if known < 0:
                    if kill(driver):
                        tally.faults += 1
                        known = driver.started
                elif driver.started > known:
                    known, moment = -1, time.monotonic() + chance.uniform(0.0, verb.seconds)
            if code is None or code > 0:
                tally.stopped.append(f"exit code {code}: {' '.join(driver.lines)}")
            driver.kill()
            tally.left += len(driver.left(_LEFT_S))
            return -1 if code is None else code

    def second_driver(self, rounds: int) -> tuple[Tally, bool]:
        """Start two drivers on one folder; return also whether the other is refused in a line."""
        chance = random.Random(f"{self._seed} {SECOND}")
        tally, refused = Tally(f"{SECOND}, {self.index.name}"), 0
        for number in range(rounds):
            log, out = self._folder(f"{SECOND} {number}")
            with self._driver(log, out, self.index) as first:
                # Once at the same time.
                time.sleep(chance.uniform(0.0, 0.5 * self.index.seconds) if number else 0.0)
                with self._driver(log, out, self.index) as second:
                    pair = [first, second]
                    codes = [each.wait(_LONGEST_S) for each in pair]
                    tally.faults += 1
                    tally.ended += 0 in codes
                    for code, each in zip(codes, pair, strict=True):
                        if code != 0:
                            tally.stopped.append(" ".join(each.lines))
                            is_line = len(each.lines) == 1 and "is in use by" in each.lines[0]
                            refused += code == 2 and is_line
            tally.add_result(log, out, self.index)
        return tally, refused == rounds

    def full_disk(self) -> tuple[Tally, bool]:
        """Fill the disk of a run; return also whether it stops in a line and leaves no file."""
        tally = Tally(f"{FULL}, {self.index.name}")
        with small_disk(self._folder(FULL)[0].parent / "disk") as disk:
            log, out = self._folder(FULL)[0], disk / "out"
            few = replace(self.index, arguments=(*self.index.arguments, "--limit", "2"))
            codes = [self._finished(log, out, few, tally)]
            space = os.statvfs(disk)
            filler = disk / "filler"
            # A page is left; a file of results needs more.
            filler.write_bytes(bytes(space.f_bavail * space.f_frsize - _PAGE_BYTES))
            codes.append(self._finished(log, out, self.index, tally))
            compared_rows(out)  # All files can be read.
            is_clean = not any((out / SCRATCH).iterdir())
            filler.unlink()
            codes.append(self._finished(log, out, self.index, tally))
            tally.faults = tally.resumed = 1
            tally.add_result(log, out, self.index)
        is_line = codes == [0, 2, 0] and len(tally.stopped) == 1
        return tally, is_clean and is_line and "cannot be written" in tally.stopped[0]

    def unreachable_store(self, outage_s: float) -> tuple[Tally, bool]:
        """
        Stop the store of a run at a random moment of its work.

        Returns also whether the run waits for it, or stops in a line.
        """
        chance = random.Random(f"{self._seed} {STORE}")
        tally = Tally(f"{STORE} for {outage_s:g} s, {self.index.name}")
        log, out = self._folder(STORE)
        arguments = (self.index.name, f"s3://{_BUCKET}/drives")
        with (
            object_store(self.drives) as stopped,
            self._driver(log, out, Verb(arguments)) as driver,
        ):
            while not driver.started and driver.exit_code() is None:
                time.sleep(_POLL_S)
            time.sleep(chance.uniform(0.0, 1.0))
            with stopped():
                tally.faults += 1
                time.sleep(outage_s)
            if driver.wait(_LONGEST_S) == 0:
                tally.ended += 1
            else:
                tally.stopped.append(" ".join(driver.lines))
                tally.resumed += 1
                self._finished(log, out, Verb(arguments), tally)
        # Reasons name the place of a recording.
        folder = re.compile(f"{re.escape(str(self.drives))}/|s3://{_BUCKET}/drives/")
        known = replace(self.index, rows=self._index_rows(folder))
        tally.add_result(log, out, known, compared_rows(out, folder, ["uri"]))
        return tally, all("does not answer for" in line for line in tally.stopped)

    def _index_rows(self, removed: re.Pattern[str]) -> Counter[str]:
        return compared_rows(self._folder(f"{INDEX} undisturbed")[1], removed, ["uri"])

    def _finished(self, log: Path, out: Path, verb: Verb, tally: Tally) -> int:
        with self._driver(log, out, verb) as driver:
            code = driver.wait(_LONGEST_S)
            if code != 0:
                tally.stopped.append(" ".join(driver.lines))
            return code

    def _driver(self, log: Path, out: Path, verb: Verb) -> Driver:
        return Driver(log, out, [*verb.arguments, *verb.workers], _NAP_S)

    def _folder(self, name: str) -> tuple[Path, Path]:
        """Return the folders of the log and of the results of a run."""
        folder = self._root / re.sub(r"\W+", "_", name)
        (folder / "starts").mkdir(parents=True, exist_ok=True)
        return folder / "starts", folder / "out"


def _killer(
    kind: str, cluster: RunningCluster | None, chance: random.Random
) -> Callable[[Driver], bool]:
    """Return the function that kills a process of a kind, and says whether there was one."""

    def kill_worker(driver: Driver) -> bool:
        workers = driver.workers()
        try:
            chance.choice(workers).kill()
        except (IndexError, psutil.Error):  # there is none yet, or it has just ended
            return False
        return True

    def kill_scheduler(driver: Driver) -> bool:
        assert cluster is not None
        cluster.processes[0].kill()
        return True

    def kill_driver(driver: Driver) -> bool:
        driver.kill()
        return True

    return {"worker": kill_worker, "scheduler": kill_scheduler, "driver": kill_driver}[kind]


class Unavailable(Exception):
    """This machine lacks what a fault needs."""


@contextmanager
def small_disk(mount: Path) -> Iterator[Path]:
    """
    Yield a folder on a file system of `_DISK_MIB`, mounted in a namespace of its own.

    :raises Unavailable: this user may not mount one.
    """
    mount.mkdir()
    script = f'mount -t tmpfs -o size={_DISK_MIB}m fleet "$0" && echo mounted && exec sleep 86400'
    try:
        holder = subprocess.Popen(
            ["unshare", "--map-root-user", "--mount", "sh", "-c", script, str(mount)],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
    except OSError as error:
        raise Unavailable(f"no command unshare ({error.strerror})") from None
    with holder:
        try:
            assert holder.stdout is not None
            assert holder.stderr is not None
            if holder.stdout.readline().strip() != "mounted":
                raise Unavailable(f"no file system can be mounted: {holder.stderr.readline()}")
            yield Path(f"/proc/{holder.pid}/root{mount}")
        finally:
            holder.kill()


def empty_store() -> tuple[ThreadedMotoServer, dict[str, str]]:
    """
    Return a started object store without content, and the environment variables that reach it.

    :raises ImportError: moto's server is not installed.
    """
    from moto.server import ThreadedMotoServer

    # It would print each request.
    logging.getLogger("werkzeug").setLevel(logging.ERROR)
    server = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    address = "http://{}:{}".format(*server.get_host_and_port())
    # Servers of one process share their content.
    urllib.request.urlopen(urllib.request.Request(f"{address}/moto-api/reset", method="POST"))
    return server, {
        "AWS_ACCESS_KEY_ID": "testing",
        "AWS_SECRET_ACCESS_KEY": "testing",
        "AWS_DEFAULT_REGION": "us-east-1",
        "AWS_ENDPOINT_URL": address,
    }


@contextmanager
def object_store(drives: Path) -> Iterator[Callable[[], AbstractContextManager[None]]]:
    """
    Serve a folder as s3://fleet/drives; yield a context in which the store does not answer.

    :raises Unavailable: moto's server is not installed.
    """
    try:
        import boto3
        from moto.server import ThreadedMotoServer

        server, access = empty_store()
    except ImportError as error:
        raise Unavailable(f"{error.name} is not installed") from None
    os.environ |= access
    _, port = server.get_host_and_port()
    client = boto3.client("s3", endpoint_url=access["AWS_ENDPOINT_URL"])
    client.create_bucket(Bucket=_BUCKET)
    for path in sorted(drives.rglob("*")):
        if path.is_file():
            client.upload_file(str(path), _BUCKET, f"drives/{path.relative_to(drives)}")

    @contextmanager
    def stopped() -> Iterator[None]:
        nonlocal server
        server.stop()
        # Its socket would accept connections otherwise. Its content stays in this process.
        server._server.server_close()  # type: ignore[union-attr]
        try:
            yield
        finally:
            server = ThreadedMotoServer(ip_address="127.0.0.1", port=port, verbose=False)
            server.start()

    try:
        yield stopped
    finally:
        server.stop()


@dataclass(frozen=True)
class Criterion:
    """A statement, and whether it holds; None if it was not measured."""

    text: str
    is_met: bool | None

    @property
    def line(self) -> str:
        """Line that is printed."""
        verdict = {True: "PASS", False: "FAIL", None: "-   "}[self.is_met]
        return f"{verdict} {self.text}"


def criteria_of(tallies: Sequence[Tally]) -> list[Criterion]:
    """Return the criteria that hold for all kinds of faults, for those that were measured."""
    found = []
    for tally in tallies:
        rows = f"{tally.different} of {tally.compared} rows differ from the undisturbed run"
        rows += _texts([f"the first: {tally.example}"] if tally.example else [])
        found.append(
            Criterion(f"{tally.name}: {rows}", tally.compared > 0 and not tally.different)
        )
        stored = f"{tally.stored} recordings are computed again after their result was stored"
        found.append(Criterion(f"{tally.name}: {stored}", not tally.stored))
        if tally.name.startswith(("worker", "scheduler")):
            text = f"{tally.resumed} runs have to be started again{_texts(tally.stopped)}"
            found.append(Criterion(f"{tally.name}: {text}", not tally.resumed))
        if tally.name.startswith("driver"):
            text = f"{tally.left} processes of killed drivers are left after {_LEFT_S:g} s"
            text += _texts(tally.stopped)
            found.append(Criterion(f"{tally.name}: {text}", not tally.left and not tally.stopped))
    return found


def _texts(lines: Sequence[str]) -> str:
    return f" ({'; '.join(lines)})" if lines else ""


def main() -> None:
    """Print the table and the criteria."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--times", type=int, default=20, help="kills of each kind")
    parser.add_argument("--seed", type=int, default=0, help="of the random moments")
    parser.add_argument("--outage", type=float, default=60.0, help="of the store, s")
    parser.add_argument(
        "--only", action="append", choices=[*KILLED, FULL, STORE, SECOND], help="repeatable"
    )
    parser.add_argument(
        "--verb", action="append", choices=[INDEX, MISMATCH], help="to kill in, repeatable"
    )
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="fleet_faults_") as root:
        only = given.only or [*KILLED, FULL, STORE, SECOND]
        verbs = given.verb or [INDEX, MISMATCH]
        run_faults(Faults(Path(root), given.seed), only, verbs, given.times, given.outage)


def run_faults(
    faults: Faults, only: Sequence[str], verbs: Sequence[str], times: int, outage_s: float
) -> None:
    """Measure some faults, kills in some verbs, and print."""
    tallies: list[Tally] = []
    criteria: list[Criterion] = []
    print(f"| {' | '.join(HEADINGS)} |\n|{' --- |' * len(HEADINGS)}", flush=True)

    def add(tally: Tally) -> None:
        tallies.append(tally)
        print(tally.row, flush=True)

    others: dict[str, tuple[Callable[[], tuple[Tally, bool]], str]] = {
        FULL: (faults.full_disk, "the run stops in one line and leaves no half-written file"),
        STORE: (
            lambda: faults.unreachable_store(outage_s),
            "the run waits for the store or stops in one line",
        ),
        SECOND: (
            lambda: faults.second_driver(max(1, times // ROUND_SHARE)),
            "one of two drivers is refused in one line",
        ),
    }
    for kind in only:
        if kind in KILLED:
            for verb in verbs:
                add(faults.killed(kind, verb, times))
            continue
        measure, text = others[kind]
        try:
            tally, is_met = measure()
        except Unavailable as error:
            criteria.append(Criterion(f"{kind}: not measured, {error}", None))
            continue
        add(tally)
        criteria.append(Criterion(f"{tally.name}: {text}{_texts(tally.stopped)}", is_met))
    for criterion in [*criteria_of(tallies), *criteria]:
        print(criterion.line)


if __name__ == "__main__":
    main()
