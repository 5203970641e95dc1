# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What `adk fleet mismatch` would do, and how long it would take."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from adk_ros.api.fleet.evidence_stage import EvidenceStage
from adk_ros.api.fleet.fleet_mismatch import REPORT
from adk_ros.api.fleet.fleet_run import (
    FleetEstimate,
    FleetOptions,
    check_options,
    chosen_recordings,
    estimate_stage,
    listed_recordings,
    workers_of,
)
from adk_ros.api.fleet.identified_simulation import SimulationInputs
from adk_ros.bags.recording import RecordingOptions
from adk_ros.fleet.dataset import FleetDataset
from adk_ros.fleet.report.file_names import DATA


def estimate_mismatch(
    simulation: Path | str,
    recordings: Sequence[str],
    out: Path | str,
    vehicle: Path | str | None = None,
    *,
    further_simulations: Sequence[Path | str] = (),
    without_imu: bool = False,
    recording_options: RecordingOptions | None = None,
    simulation_options: RecordingOptions | None = None,
    options: FleetOptions | None = None,
) -> FleetEstimate:
    """
    Return what `fleet_mismatch` would do; writes nothing.

    The counts are of the first pass. `seconds` is of all passes at the mean rate of earlier ones,
    an upper limit if later passes were done in part, or at a default rate; reports of recordings
    are not counted.

    :raises UsageError: an argument is invalid.
    """
    from adk_ros.fleet.inference.analysis import USUAL_PASSES

    out, options = Path(out), options or FleetOptions()
    check_options(options)
    inputs = SimulationInputs.of(
        simulation, further_simulations, vehicle, without_imu, recording_options,
        simulation_options,
    )  # fmt: skip
    options = replace(options, workers=workers_of(options))
    listed, table = listed_recordings(recordings, options)
    found = chosen_recordings(listed, options.limits.count)
    options = replace(options, limits=replace(options.limits, count=None))
    path = inputs.file(out)
    stage = EvidenceStage(str(path) if path.exists() else "", "", without_imu, inputs.reading)
    first = replace(estimate_stage(stage, found, out, options), notes=table.notes)
    if first.missing == 0 and _is_reported(out, stage.name):
        return first
    if first.seconds is None:
        return first
    if not first.measured:
        return replace(first, seconds=first.seconds * USUAL_PASSES)
    every = estimate_stage(replace(stage, simulation=""), found, out, options)
    return replace(
        first,
        seconds=first.seconds + (USUAL_PASSES - 1) * (every.seconds or 0.0),
        basis=f"{first.basis}; less where later passes keep evidence of an earlier run",
    )


def _is_reported(out: Path, stage: str) -> bool:
    """Whether the report is later than all evidence: else a run was stopped after a pass."""
    report = out / REPORT / DATA
    if not report.is_file():
        return False
    written_s = FleetDataset(out).columns(stage, ["written_s"]).column("written_s").to_pylist()
    return report.stat().st_mtime >= max(written_s, default=0.0)
