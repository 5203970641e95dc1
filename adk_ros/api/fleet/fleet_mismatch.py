# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Which physics a simulation lacks, by the evidence of a whole fleet, and whose fault it is.

The surrogate of the simulation is identified once. Each recording is summarised (`EvidenceStage`),
the summaries are combined (`fleet.inference.fleet_estimate`), and the recordings are linearised
again at the estimate, at which a quadratic summary is more exact.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Collection, Mapping, Sequence
from contextlib import ExitStack, nullcontext, suppress
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote

from adk_ros.api.fleet.evidence_stage import EvidenceStage
from adk_ros.api.fleet.fleet_evidence import CurrentEvidence, point_file, remove_points
from adk_ros.api.fleet.fleet_run import (
    FleetOptions,
    check_options,
    chosen_recordings,
    keep_tags,
    listed_recordings,
    tags_file,
)
from adk_ros.api.fleet.identified_simulation import SimulationInputs, identified_simulation
from adk_ros.api.fleet.lost_files import forget_lost_files
from adk_ros.api.fleet.pass_progress import PassProgress
from adk_ros.api.fleet.report_stage import ReportStage
from adk_ros.bags.recording import RecordingOptions
from adk_ros.errors import UsageError
from adk_ros.fleet.cluster import Cluster, open_cluster
from adk_ros.fleet.dataset import FleetDataset
from adk_ros.fleet.plan import current_rows
from adk_ros.fleet.recordings import FleetRecording
from adk_ros.fleet.run import Progress, run_stage
from adk_ros.fleet.run_lock import run_lock
from adk_ros.fleet.stage import version_of
from adk_ros.fleet.tags import Tags

if TYPE_CHECKING:
    from adk_ros.fleet.inference.evidence import Row
    from adk_ros.fleet.inference.fleet_estimate import FleetEstimate
    from adk_ros.fleet.inference.fleet_evidence import RecordingTags
    from adk_ros.fleet.inference.fleet_result import FleetResult

REPORT, RECORDINGS, LOGS = "report", "recordings", "logs"
_DAY_S = 86_400.0


@dataclass(frozen=True)
class FleetMismatch:
    """
    Result of a fleet, the page that was written, and the recordings without evidence.

    `left`: number of recordings that were not chosen because of a limit. `notes`: what does not
    match in fleet.csv, and how many recordings take no part in the search for places.
    """

    result: FleetResult
    page: Path
    failed: tuple[tuple[str, str], ...]
    left: int = 0
    notes: tuple[str, ...] = ()

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
    further_simulations: Sequence[Path | str] = (),
    without_imu: bool = False,
    recording_options: RecordingOptions | None = None,
    simulation_options: RecordingOptions | None = None,
    reports: int = 5,
    options: FleetOptions | None = None,
    progress: Progress | None = None,
) -> FleetMismatch:
    """
    Find what a simulation lacks for all cars, one car, a condition, a place or from a time on.

    :param simulation: bag of the simulator, as in `explain`.
    :param recordings: folders, globs and fsspec URLs.
    :param out: folder of the dataset, which all workers see under this path; an interrupted run
        continues. The page is in `out`/report.
    :param vehicle: nominal vehicle of the simulation, YAML or a packaged name.
    :param further_simulations: bags of the same simulated car on roads of the fleet: what the
        surrogate of the simulation feigns there in all cars is known then.
    :param recording_options: topics and sensor configuration of the bags.
    :param simulation_options: those of the simulator's bag. Default: `recording_options`.
    :param reports: so many recordings, those that are explained worst, get the report of an
        analysis of them alone; the page links all that exist.
    :param options: a limit on the number of recordings chooses them before the first pass.
    :raises UsageError: an argument is invalid, `out` is in use, or a service does not answer.
    :raises DataError: no recording can be used.
    """
    from adk_ros.api.provenance import RunTimer
    from adk_ros.fleet.inference.analysis import analyse_fleet
    from adk_ros.fleet.inference.corrected_models import corrected_models, simulation_model
    from adk_ros.fleet.inference.fleet_simulation import FleetSimulation
    from adk_ros.fleet.inference.recording_evidence import UNPLACED
    from adk_ros.fleet.report.fleet_page import write_fleet_page
    from adk_ros.fleet.report.fleet_rows import unplaced_text
    from adk_ros.fleet.report.result_file import PageContext

    timer = RunTimer()
    out, options = Path(out), options or FleetOptions()
    check_options(options)
    inputs = SimulationInputs.of(
        simulation, further_simulations, vehicle, without_imu, recording_options,
        simulation_options,
    )  # fmt: skip
    listed, table = listed_recordings(recordings, options)
    found = chosen_recordings(listed, options.limits.count)
    limits = replace(options.limits, count=None)
    with run_lock(out):
        try:
            (out / REPORT / RECORDINGS).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise UsageError(f"{out} cannot be written: {error.strerror or error}") from None
        keep_tags(out, table)
        # Workers of other machines run in other folders.
        shared = out.resolve()
        path = identified_simulation(inputs, listed, shared, limits, progress)
        known = FleetSimulation.load(path)
        in_pass = PassProgress(progress)
        unplaced: set[str] = set()
        current = CurrentEvidence(out)
        logs = shared / LOGS
        logs.mkdir(exist_ok=True)
        with ExitStack() as stack:

            @cache
            def cluster() -> Cluster:
                return stack.enter_context(open_cluster(options.workers, options.cluster))

            def evidence_at(
                estimate: FleetEstimate | None, moved: Collection[str] | None
            ) -> tuple[list[Row], dict[str, str]]:
                point = point_file(shared, estimate)
                stage = EvidenceStage(str(path), point, without_imu, inputs.reading, str(logs))
                # What has no evidence without effects has none at an estimate either.
                names = {x.name for x in found} if estimate is None else set(estimate.fleet.names)
                names &= names if moved is None else set(moved)
                usable = [recording for recording in found if recording.name in names]
                run_stage(stage, usable, out, lambda: nullcontext(cluster()), limits, in_pass)
                rows, failed = current.of(stage, usable)
                unplaced.update(row["recording"] for row in rows if row.get(UNPLACED))
                return rows, failed

            analysis = analyse_fleet(
                evidence_at,
                known,
                lambda rows: recording_tags(rows, table.tags),
                in_pass.of_analysis,
                in_pass.begin_pass,
            )
            worst = {x.name for x in analysis.result.worst(reports)}
            surrogate = shared / REPORT / "simulation.yaml"
            surrogate.write_text(simulation_model(known.surrogate), encoding="utf-8")
            folder = shared / REPORT / RECORDINGS
            stage = ReportStage(str(surrogate), str(folder), without_imu, inputs.reading)
            forget_lost_files(out, stage.name, folder, "report")
            shown = [recording for recording in found if recording.name in worst]
            run_stage(stage, shown, out, lambda: nullcontext(cluster()), limits, progress)
        # An interrupted run needs them when it continues.
        shutil.rmtree(logs, ignore_errors=True)
        remove_points(shared)
        failed = tuple(sorted(analysis.failed.items()))
        models = corrected_models(analysis.result, known.surrogate)
        made, not_made = _reports(out, stage, found)
        sources: list[tuple[str, Path | str | None]] = [("simulation", inputs.simulation)]
        sources += [("further simulation", further) for further in inputs.further]
        if vehicle is not None and Path(vehicle).is_file():
            sources.append(("vehicle", vehicle))
        provenance = timer.provenance([*sources, *tags_file(out)])
        context = PageContext(made, not_made, failed, len(unplaced), provenance)
        page = write_fleet_page(analysis.result, out / REPORT, context, models)
        left = len(listed) - len(found)
        if not left:
            # Nothing that is lost: a run of all recordings has another estimate than a trial.
            with suppress(UsageError):
                current.prune()
        text = unplaced_text(len(unplaced))
        notes = (*table.notes, text) if text else table.notes
        return FleetMismatch(analysis.result, page, failed, left, notes)


def _reports(
    out: Path, stage: ReportStage, recordings: Sequence[FleetRecording]
) -> tuple[dict[str, str], dict[str, str]]:
    """
    Return recording -> address of its report, relative to the page, and -> why it has none.

    Of all reports against this simulation, also those of earlier runs.
    """
    made, not_made = {}, {}
    for row in current_rows(version_of(stage), recordings, FleetDataset(out)):
        if row["status"] != "ok":
            not_made[str(row["recording"])] = str(row["reason"])
        page = json.loads(row["details"] or "{}").get("report")
        if page is not None:
            made[str(row["recording"])] = quote(f"{RECORDINGS}/{page}")
    return made, not_made


def recording_tags(rows: Sequence[Row], tags: Mapping[str, Tags]) -> dict[str, RecordingTags]:
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
