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
from adk_ros.api.fleet.recording_minutes import recording_minutes
from adk_ros.bags.recording import RecordingOptions
from adk_ros.fleet.dataset import FleetDataset

DEFAULT_CORE_S = 0.4
"""
s of a core for a minute of recording and pass, before there is a result: the analysis of 'adk
fleet demo' took 12 min on two cores for 1256 min of recording (doc/fleet.md), counted as three
passes.
"""
_DEFAULT_BASIS = (
    f"a default of {DEFAULT_CORE_S:g} s of a core for a minute of recording and pass, as an "
    "AMD EPYC takes"
)


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
    an upper limit if later passes were done in part, or at `DEFAULT_CORE_S`; reports of recordings
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
    is_finished = first.missing == 0 and (out / REPORT / "fleet.json").is_file()
    if is_finished:
        return first
    if first.seconds is None:
        minutes = recording_minutes(found, FleetDataset(out))
        if minutes is None or not options.workers:
            return first
        seconds = DEFAULT_CORE_S * minutes * USUAL_PASSES / options.workers
        return replace(first, seconds=seconds, basis=_DEFAULT_BASIS)
    every = estimate_stage(replace(stage, simulation=""), found, out, options)
    return replace(
        first,
        seconds=first.seconds + (USUAL_PASSES - 1) * (every.seconds or 0.0),
        basis=f"{first.basis}; less where later passes keep evidence of an earlier run",
    )
