# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The simulation of a fleet as `adk fleet mismatch` keeps it: identified once for its inputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from adk_ros.api.fleet.index_stage import file_hash
from adk_ros.api.recording import read_log
from adk_ros.bags.recording import RecordingOptions
from adk_ros.errors import AdkError, DataError
from adk_ros.files.code_digest import code_digest
from adk_ros.fleet.recordings import FleetRecording, local_recording
from adk_ros.fleet.run import Progress
from adk_ros.fleet.stage import hash_of
from adk_ros.fleet.store import StoreUnreachable

_FIRST_TRIED = 20
"""Recordings that are tried as the typical one before giving up."""


def simulation_file(
    simulation: Path,
    vehicle: Path | str | None,
    out: Path,
    without_imu: bool,
    reading: RecordingOptions,
    simulation_reading: RecordingOptions,
) -> Path:
    """
    Return the file of the identified simulation, named by its inputs, whether it exists.

    The typical recording is no such input: a fleet grows, and its first one stays the typical one.
    """
    given = "" if vehicle is None else str(vehicle)
    files = [file_hash(str(simulation)), file_hash(given)]
    read_with = [without_imu, asdict(reading), asdict(simulation_reading)]
    key = hash_of([*files, *read_with, code_digest()])
    return out / f"simulation-{key[:16]}.npz"


def identified_simulation(
    simulation: Path,
    vehicle: Path | str | None,
    recordings: Sequence[FleetRecording],
    out: Path,
    without_imu: bool,
    reading: RecordingOptions,
    simulation_reading: RecordingOptions,
    progress: Progress | None,
) -> Path:
    """
    Return the file of the simulation, identified unless the dataset has it.

    The caller holds the lock of `out`: another run would identify the same.

    :raises DataError: none of the first recordings can be used.
    :raises StoreUnreachable: a store does not answer.
    """
    from adk_ros.fleet.inference.fleet_simulation import FleetSimulation
    from adk_ros.mismatch.recording.nominal_vehicle import load_nominal_vehicle

    path = simulation_file(simulation, vehicle, out, without_imu, reading, simulation_reading)
    if path.exists():
        return path
    nominal = None if vehicle is None else load_nominal_vehicle(vehicle)
    radius = 0.0 if nominal is None else nominal.wheel_radius
    simulated = read_log(simulation, simulation_reading, wheel_radius=radius)

    def report(done: float, text: str) -> None:
        if progress is not None:
            progress(done, 1.0, text)

    reasons = []
    for recording in recordings[:_FIRST_TRIED]:
        try:
            with local_recording(recording) as local:
                typical = read_log(local, reading, needs_imu=not without_imu, wheel_radius=radius)
            known = FleetSimulation.identify(simulated, typical, nominal, report)
        except StoreUnreachable:
            # Says nothing about the recording: another one would give another result.
            raise
        except AdkError as error:
            reasons.append(f"{recording.name}: {error}")
            continue
        scratch = out / ".simulation.npz"
        known.save(scratch)
        scratch.replace(path)
        return path
    raise DataError(f"none of the first {len(reasons)} recordings can be used; {reasons[0]}")
