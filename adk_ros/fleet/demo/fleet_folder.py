# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Write a synthetic fleet as a folder.

`simulation/` and `simulation_routes/*/` are bags of the simulation, on a separate road and on each
route; `drives/*/` are those of the fleet. `vehicle.yaml` has masses and lengths of the simulated
car; `drives/fleet.csv` has a row per recording: recording, vehicle, time, and the tags;
`truth.json` is what was injected, written last. Some bags are damaged on purpose.
"""

from __future__ import annotations

import csv
import json
import shutil
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, wait
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from datetime import datetime, timezone
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import yaml  # type: ignore[import-untyped, unused-ignore]

from adk_ros.errors import UsageError
from adk_ros.files.code_digest import code_digest
from adk_ros.fleet.demo.fleet_drives import FleetDrives
from adk_ros.fleet.demo.fleet_plan import FleetPlan, PlannedDrive
from adk_ros.fleet.run_lock import LOCK_FILE, run_lock
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.offline.sensor_log_bag import write_sensor_log
from adk_ros.plant.scenario.sensor_simulation import START_NS
from adk_ros.shutdown import begin_worker, worker_pool

_NS_PER_DAY = 86_400 * 10**9
_SHORT_S = 3.0
"""Duration of a recording that is too short, s."""
_KEPT_BYTES = 2000
"""Bytes that are left of a truncated file: the header and no chunk."""
TAGS = ("software", "tyres")
_UNFINISHED, _WRITING, _TRUTH = ".unfinished", ".writing", "truth.json"
"""In the folder while it is written: a file with the hash of the plan, and a folder with bags."""

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class SimulatedDrive:
    """A drive of the simulation: on a separate road, or on a route of the fleet."""

    route: int | None = None

    def log(self, drives: FleetDrives) -> SensorLog:
        """Simulate it."""
        if self.route is None:
            return drives.simulation()
        return drives.further_simulation(self.route)


_Bag = PlannedDrive | SimulatedDrive


def write_fleet(
    plan: FleetPlan, out: Path, progress: Progress | None = None, workers: int = 1
) -> None:
    """
    Write the fleet of a plan into a new folder; `progress(done, total)` counts the recordings.

    What an interrupted call for the same plan has written is not simulated again.

    :param workers: processes that simulate, one core each; the fleet does not depend on it. With
        more than one, a script that calls this needs `if __name__ == "__main__":`.
    :raises UsageError: the folder exists, and has another content than that, or another process
        writes it.
    :raises DataError: a process was killed.
    """
    unfinished = out / _UNFINISHED
    of_plan = sha256(f"{plan!r} {code_digest()}".encode()).hexdigest()
    if out.exists() and not (unfinished.is_file() and unfinished.read_text() == of_plan):
        raise UsageError(f"{out} exists: give a new folder for the fleet")
    with run_lock(out / _WRITING):
        if (out / _TRUTH).exists():
            raise UsageError(f"{out} exists: another process has just written it")
        unfinished.write_text(of_plan)
        _complete(plan, out, progress, workers)
        unfinished.unlink()
    shutil.rmtree(out / _WRITING, ignore_errors=True)


def _complete(plan: FleetPlan, out: Path, progress: Progress | None, workers: int) -> None:
    """Write what the folder of a plan lacks."""
    drives = FleetDrives(plan)
    (out / "drives").mkdir(parents=True, exist_ok=True)
    for left in (out / _WRITING).iterdir():
        if left.name != LOCK_FILE:
            shutil.rmtree(left, ignore_errors=True)
    (out / "vehicle.yaml").write_text(yaml.safe_dump(drives.nominal.model_dump()))
    with (out / "drives" / "fleet.csv").open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["recording", "vehicle", "time", *TAGS])
        for planned in plan.drives:
            table.writerow(
                [
                    planned.name,
                    planned.car,
                    date_of(planned),
                    *(planned.tags[tag] for tag in TAGS),
                ]
            )
    simulated = [SimulatedDrive(), *(SimulatedDrive(i) for i in range(plan.size.routes))]
    every: list[_Bag] = [*simulated, *plan.drives]
    bags = [planned for planned in every if not _bag(planned, out).exists()]
    before = len(every) - len(bags)
    with closing(_written(plan, out, bags, workers)) as written:
        for done, _ in enumerate(written, start=before + 1):
            if progress is not None:
                progress(done, len(every))
    # Last: a folder that has it is complete.
    (out / _TRUTH).write_text(json.dumps(truth(drives), indent=1))


def _written(
    plan: FleetPlan, out: Path, bags: Sequence[_Bag], workers: int
) -> Generator[None, None, None]:
    """Write bags, and yield after each."""
    if workers == 1:
        drives = FleetDrives(plan)
        for planned in bags:
            _write_bag(drives, planned, out)
            yield
        return
    with worker_pool(workers, _begin, (plan,)) as executor:
        futures = {executor.submit(_write_planned, planned, out) for planned in bags}
        while futures:
            finished, futures = wait(futures, return_when=FIRST_COMPLETED)
            for future in finished:
                future.result()
                yield


_drives: list[FleetDrives] = []
"""The drives that a worker simulates, one entry."""


def _begin(plan: FleetPlan) -> None:
    """Set up a worker."""
    begin_worker()
    _drives.append(FleetDrives(plan))


def _write_planned(planned: _Bag, out: Path) -> None:
    """Write a bag in a worker."""
    _write_bag(_drives[0], planned, out)


def _write_bag(drives: FleetDrives, planned: _Bag, out: Path) -> None:
    bag = _bag(planned, out)
    # A bag that is there is complete.
    scratch = out / _WRITING / bag.name
    scratch.parent.mkdir(exist_ok=True)
    bag.parent.mkdir(exist_ok=True)
    if isinstance(planned, SimulatedDrive):
        write_sensor_log(planned.log(drives), scratch)
    else:
        write_drive(drives, planned, scratch)
    scratch.rename(bag)


def _bag(planned: _Bag, out: Path) -> Path:
    """Return the path of a bag."""
    if isinstance(planned, PlannedDrive):
        return out / "drives" / planned.name
    if planned.route is None:
        return out / "simulation"
    return out / "simulation_routes" / f"route_{planned.route + 1}"


def start_ns(planned: PlannedDrive) -> int:
    """Return the time at which a drive starts, ns."""
    return START_NS + int(planned.day * _NS_PER_DAY)


def date_of(planned: PlannedDrive) -> str:
    """Return the start of a drive as an ISO 8601 text in UTC."""
    at = datetime.fromtimestamp(start_ns(planned) / 1e9, timezone.utc)
    return at.isoformat(timespec="seconds")


def write_drive(drives: FleetDrives, planned: PlannedDrive, path: Path) -> None:
    """Write the bag of a drive, damaged if the plan says so."""
    log = drives.drive(planned)
    if planned.damage == "short":
        log = log.between(0.0, _SHORT_S)
    elif planned.damage == "without_commands":
        log = _without_commands(log)
    write_sensor_log(log, path, start_ns(planned))
    if planned.damage in {"truncated", "random_bytes", "empty"}:
        _spoil(path, planned)


def _without_commands(log: SensorLog) -> SensorLog:
    return replace(log, command_s=log.command_s[:0], command=log.command[:0])


def _spoil(path: Path, planned: PlannedDrive) -> None:
    """Spoil the data file of a bag; its metadata go, since a crash does not write them."""
    files = [file for file in path.rglob("*") if file.is_file() and file.suffix != ".yaml"]
    for file in path.rglob("*.yaml"):
        file.unlink()
    for file in files:
        content = file.read_bytes()
        if planned.damage == "truncated":
            content = content[:_KEPT_BYTES]
        elif planned.damage == "empty":
            content = b""
        else:
            rng = np.random.default_rng(planned.seed)
            content = rng.integers(0, 256, min(len(content), 1 << 20), dtype=np.uint8).tobytes()
        file.write_bytes(content)


def truth(drives: FleetDrives) -> dict[str, Any]:
    """Return what is injected, as plain values; the place has its path, points (x, y), m."""
    plan = drives.plan
    path = drives.place_path().round(1).tolist()
    return {
        "seed": plan.seed,
        "drives": len(plan.drives),
        "effects": [
            {"effect": t.effect, "parameters": t.parameters, "level": asdict(t.level)}
            for t in plan.terms
        ],
        "place": asdict(plan.place) | {"path": path},
        "damaged": {d.name: d.damage for d in plan.drives if d.damage},
    }
