# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What `adk fleet mismatch` would do, and how long it would take."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from adk_ros.api.fleet.evidence_stage import EvidenceStage
from adk_ros.api.fleet.fleet_mismatch import REPORT
from adk_ros.api.fleet.fleet_run import FleetEstimate, FleetOptions, estimate_fleet
from adk_ros.api.fleet.identified_simulation import simulation_file
from adk_ros.bags.recording import RecordingOptions
from adk_ros.errors import UsageError


def estimate_mismatch(
    simulation: Path | str,
    recordings: Sequence[str],
    out: Path | str,
    vehicle: Path | str | None = None,
    *,
    without_imu: bool = False,
    recording_options: RecordingOptions | None = None,
    options: FleetOptions | None = None,
) -> FleetEstimate:
    """
    Return what `fleet_mismatch` would do; writes nothing.

    The counts are of the first pass. `seconds` is of all passes at the mean rate of earlier ones,
    an upper limit if later passes were done in part; reports of recordings are not counted.

    :raises UsageError: an argument is invalid.
    """
    from adk_ros.fleet.inference.analysis import USUAL_PASSES

    simulation, out = Path(simulation), Path(out)
    if not simulation.exists():
        raise UsageError(f"--simulation {simulation} does not exist")
    reading = recording_options or RecordingOptions()
    path = simulation_file(simulation, vehicle, out, reading)
    stage = EvidenceStage(str(path) if path.exists() else "", "", without_imu, reading)
    first = estimate_fleet(stage, recordings, out, options)
    is_finished = first.missing == 0 and (out / REPORT / "fleet.json").is_file()
    if is_finished or first.seconds is None:
        return first
    every = estimate_fleet(replace(stage, simulation=""), recordings, out, options)
    return replace(first, seconds=first.seconds + (USUAL_PASSES - 1) * (every.seconds or 0.0))
