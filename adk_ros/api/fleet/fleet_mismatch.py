# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Which physics a simulation lacks, by the evidence of a whole fleet, and whose fault it is.

The surrogate of the simulation is identified once. Each recording is summarised (`EvidenceStage`),
the summaries are combined (`fleet.inference.fleet_estimate`), and the recordings are linearised
again at the estimate, at which a quadratic summary is more exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from adk_ros.api.fleet.evidence_stage import EvidenceStage, evidence_row, write_point
from adk_ros.api.fleet.fleet_run import FleetOptions, listed_recordings, run_fleet
from adk_ros.api.fleet.index_stage import file_hash
from adk_ros.errors import AdkError, DataError, UsageError
from adk_ros.files.code_digest import code_digest
from adk_ros.fleet.dataset import FleetDataset
from adk_ros.fleet.inference.analysis import PASSES
from adk_ros.fleet.recordings import FleetRecording, local_recording
from adk_ros.fleet.run import Progress
from adk_ros.fleet.stage import hash_of
from adk_ros.fleet.tags import Tags

if TYPE_CHECKING:
    from adk_ros.fleet.inference.evidence import Row
    from adk_ros.fleet.inference.fleet_estimate import FleetEstimate
    from adk_ros.fleet.inference.fleet_evidence import RecordingTags
    from adk_ros.fleet.inference.fleet_result import FleetResult
    from adk_ros.fleet.inference.fleet_simulation import FleetSimulation

REPORT = "report"
_DAY_S = 86_400.0
_FIRST_TRIED = 20
"""Recordings that are tried as the typical one before giving up."""


@dataclass(frozen=True)
class FleetMismatch:
    """Result of a fleet, the page that was written, and the recordings without evidence."""

    result: FleetResult
    page: Path
    failed: tuple[tuple[str, str], ...]

    @property
    def summary(self) -> str:
        """The result in sentences."""
        from adk_ros.fleet.report.fleet_rows import summary_sentence

        return summary_sentence(self.result)


def fleet_mismatch(
    simulation: Path | str,
    recordings: Sequence[str],
    out: Path | str,
    vehicle: Path | str | None = None,
    *,
    without_imu: bool = False,
    options: FleetOptions | None = None,
    passes: int = PASSES,
    progress: Progress | None = None,
) -> FleetMismatch:
    """
    Find what a simulation lacks for all cars, one car, a condition, a place or from a time on.

    :param simulation: bag of the simulator, as in `explain`.
    :param recordings: folders, globs and fsspec URLs.
    :param out: folder of the dataset; an interrupted run continues. The page is in `out`/report.
    :param vehicle: nominal vehicle of the simulation, YAML or a packaged name.
    :raises UsageError: an argument is invalid, `out` is in use, or a service does not answer.
    :raises DataError: no recording can be used.
    """
    from adk_ros.fleet.inference.corrected_models import corrected_models
    from adk_ros.fleet.inference.fleet_result import fleet_result
    from adk_ros.fleet.inference.fleet_simulation import FleetSimulation
    from adk_ros.fleet.report.fleet_page import write_fleet_page

    out, options = Path(out), options or FleetOptions()
    found, tags = listed_recordings(recordings, options)
    try:
        (out / REPORT).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"{out} cannot be written: {error.strerror or error}") from None
    path = _identified(Path(simulation), vehicle, found, out, without_imu, progress)
    known = FleetSimulation.load(path)
    stage = EvidenceStage(str(path), without_imu=without_imu)
    first: dict[str, float] | None = None
    estimate: FleetEstimate | None = None
    for turn in range(passes):
        run_fleet(stage, recordings, out, options, progress)
        rows, failed = evidence_of(out, stage)
        estimate = _estimated(rows, known, tags, estimate, turn + 1 < passes, progress)
        first = first or dict(estimate.loss_ratios)
        if not estimate.claims and not estimate.places:
            break
        if turn + 1 < passes:
            stage = EvidenceStage(str(path), str(_point(out, estimate)), without_imu)
    assert estimate is not None
    if progress is not None:
        progress(0.0, 1.0, "combining the evidence")
    result = fleet_result(estimate, first)
    page = write_fleet_page(
        result, out / REPORT, models=corrected_models(result, known.surrogate), failed=failed
    )
    return FleetMismatch(result, page, tuple(failed))


def evidence_of(out: Path, stage: EvidenceStage) -> tuple[list[Row], list[tuple[str, str]]]:
    """Return the rows of evidence of this stage in a dataset; (recording, reason) of others."""
    inputs, code = stage.inputs_hash, code_digest()
    rows, failed = [], []
    for row in FleetDataset(out).rows(stage.name):
        if row["inputs_hash"] != inputs or row["code_version"] != code:
            continue
        if row["status"] == "ok":
            rows.append(evidence_row(row["details"], row["recording"]))
        else:
            failed.append((str(row["recording"]), str(row["reason"])))
    return rows, sorted(failed)


def _estimated(
    rows: list[Row],
    known: FleetSimulation,
    tags: dict[str, Tags],
    before: FleetEstimate | None,
    is_repeated: bool,
    progress: Progress | None,
) -> FleetEstimate:
    from adk_ros.fleet.inference.fleet_estimate import ROUNDS, estimate_fleet

    def report(done: float, text: str) -> None:
        if progress is not None:
            progress(done, 1.0, text)

    return estimate_fleet(
        [known.evidence.to_row(), *rows],
        recording_tags(rows, tags),
        report,
        ROUNDS - 1 if is_repeated else ROUNDS,
        () if before is None else before.places,
    )


def recording_tags(rows: Sequence[Row], tags: dict[str, Tags]) -> dict[str, RecordingTags]:
    """
    Return name of recording -> car, day and tags.

    The day counts from the first recording; without a time in fleet.csv that of the bag counts. A
    recording without a vehicle counts as a separate car.
    """
    from adk_ros.fleet.inference.evidence import RECORDING
    from adk_ros.fleet.inference.fleet_evidence import RecordingTags

    starts = {row["recording"]: row["start_ns"] * 1e-9 for row in rows if row["kind"] == RECORDING}
    every = {name: tags.get(name, Tags()) for name in starts}
    times = {
        name: starts[name] if each.time_s is None else each.time_s for name, each in every.items()
    }
    first = min(times.values(), default=0.0)
    return {
        name: RecordingTags(
            each.vehicle or name, (times[name] - first) / _DAY_S, dict(each.conditions)
        )
        for name, each in every.items()
    }


def _point(out: Path, estimate: FleetEstimate) -> Path:
    """Write the estimate to linearise at, named by its content."""
    scratch = out / ".point.json"
    values = {name: estimate.values_of(name) for name in estimate.fleet.names}
    write_point(scratch, values, list(estimate.local_values()))
    path = out / f"point-{file_hash(str(scratch))[:16]}.json"
    scratch.replace(path)
    return path


def _identified(
    simulation: Path,
    vehicle: Path | str | None,
    recordings: Sequence[FleetRecording],
    out: Path,
    without_imu: bool,
    progress: Progress | None,
) -> Path:
    """Return the file of the simulation, identified unless the dataset has it."""
    from adk_ros.fleet.inference.fleet_simulation import FleetSimulation
    from adk_ros.mismatch.recording.from_bag import read_sensor_log
    from adk_ros.mismatch.recording.nominal_vehicle import load_nominal_vehicle

    if not simulation.exists():
        raise UsageError(f"--simulation {simulation} does not exist")
    given = "" if vehicle is None else str(vehicle)
    key = hash_of([file_hash(str(simulation)), file_hash(given), code_digest()])
    path = out / f"simulation-{key[:16]}.npz"
    if path.exists():
        return path
    nominal = None if vehicle is None else load_nominal_vehicle(vehicle)
    simulated = read_sensor_log(simulation)

    def report(done: float, text: str) -> None:
        if progress is not None:
            progress(done, 1.0, text)

    reasons = []
    for recording in recordings[:_FIRST_TRIED]:
        try:
            with local_recording(recording) as local:
                typical = read_sensor_log(local, needs_imu=not without_imu)
            known = FleetSimulation.identify(simulated, typical, nominal, report)
        except AdkError as error:
            reasons.append(f"{recording.name}: {error}")
            continue
        scratch = out / ".simulation.npz"
        known.save(scratch)
        scratch.replace(path)
        return path
    raise DataError(f"none of the first {len(reasons)} recordings can be used; {reasons[0]}")
