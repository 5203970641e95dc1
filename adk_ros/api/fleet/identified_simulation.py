# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The simulation of a fleet as `adk fleet mismatch` keeps it: identified once for its inputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from adk_ros.api.fleet.index_stage import file_hash
from adk_ros.api.recording import read_log
from adk_ros.bags.recording import RecordingOptions
from adk_ros.errors import AdkError, DataError, UsageError
from adk_ros.files.code_digest import code_digest
from adk_ros.fleet.recordings import FleetRecording, local_recording
from adk_ros.fleet.run import Limits, Progress, stop_if_needed
from adk_ros.fleet.stage import hash_of
from adk_ros.fleet.stage_process import StageProcess

if TYPE_CHECKING:
    from adk_ros.mismatch.recording.sensor_log import SensorLog

_FIRST_TRIED, _FURTHER_TRIED = 10, 10
"""
Recordings that are tried as the typical one before giving up: the first ones, then some spread
over the others, since what is unusable may lie together.
"""


@dataclass(frozen=True)
class SimulationInputs:
    """
    What the simulation of a fleet is identified from, and how bags are read.

    `further`: drives of the same simulated car on roads of the fleet. `reading`: of recordings;
    `simulation_reading`: of the simulator's bags.
    """

    simulation: Path
    vehicle: Path | str | None
    without_imu: bool
    reading: RecordingOptions
    simulation_reading: RecordingOptions
    further: tuple[Path, ...] = ()

    @classmethod
    def of(
        cls,
        simulation: Path | str,
        further: Sequence[Path | str],
        vehicle: Path | str | None,
        without_imu: bool,
        reading: RecordingOptions | None,
        simulation_reading: RecordingOptions | None,
    ) -> SimulationInputs:
        """
        Return the inputs, with the options of the recordings for the simulator's bags by default.

        :raises UsageError: a bag of the simulator does not exist, or is given twice.
        """
        reading = reading or RecordingOptions()
        bags = (Path(simulation), *(Path(path) for path in further))
        for i, path in enumerate(bags):
            option = "--further-simulation" if i else "--simulation"
            if not path.exists():
                raise UsageError(f"{option} {path} does not exist")
            if path.resolve() in {other.resolve() for other in bags[:i]}:
                raise UsageError(f"{option} {path} is given already: another drive")
        return cls(bags[0], vehicle, without_imu, reading, simulation_reading or reading, bags[1:])

    def file(self, out: Path) -> Path:
        """
        Return the file of the identified simulation, named by its inputs, whether it exists.

        The typical recording is no such input: a fleet grows, and its first one stays the typical
        one.
        """
        given = "" if self.vehicle is None else str(self.vehicle)
        files = [file_hash(str(path)) for path in (self.simulation, given, *self.further)]
        read_with = [self.without_imu, asdict(self.reading), asdict(self.simulation_reading)]
        key = hash_of([*files, *read_with, code_digest()])
        return out / f"simulation-{key[:16]}.npz"


def identified_simulation(
    inputs: SimulationInputs,
    recordings: Sequence[FleetRecording],
    out: Path,
    limits: Limits,
    progress: Progress | None,
) -> Path:
    """
    Return the file of the simulation, identified unless the dataset has it.

    The caller holds the lock of `out`: another run would identify the same. The recording next to
    which it is identified is decoded within `limits`, as those of the stages.

    :raises DataError: none of the recordings tried can be used, or a drive of the simulation.
    :raises UsageError: a store does not answer, or a disk is full.
    """
    from adk_ros.fleet.inference.fleet_simulation import FleetSimulation
    from adk_ros.fleet.inference.further_simulations import DifferentCar
    from adk_ros.mismatch.recording.checks import check_recording
    from adk_ros.mismatch.recording.nominal_vehicle import load_nominal_vehicle

    path = inputs.file(out)
    if path.exists():
        return path
    nominal = None if inputs.vehicle is None else load_nominal_vehicle(inputs.vehicle)
    radius = 0.0 if nominal is None else nominal.wheel_radius
    simulated, *further = (
        read_log(path, inputs.simulation_reading, wheel_radius=radius)
        for path in (inputs.simulation, *inputs.further)
    )
    size = 1.0 if nominal is None else nominal.length_scale
    for log in further:
        check_recording(replace(log, length_scale=size), is_simulation=True)

    def report(done: float, text: str) -> None:
        if progress is not None:
            progress(done, 1.0, text)

    reasons = []
    for recording in _tried(recordings):
        try:
            typical = _decoded(recording, inputs, radius, out, limits)
            known = FleetSimulation.identify(simulated, typical, nominal, report, further)
        except DifferentCar:
            # Says nothing about the recording: another one would give no other result.
            raise
        except AdkError as error:
            reasons.append(f"{recording.name}: {error}")
            continue
        scratch = out / ".simulation.npz"
        known.save(scratch)
        scratch.replace(path)
        return path
    raise DataError(
        f"none of {len(reasons)} recordings that were tried can be used ('adk fleet index' says "
        f"of each why); {reasons[0]}"
    )


def _tried(recordings: Sequence[FleetRecording]) -> list[FleetRecording]:
    """Return the recordings that may be the typical one, in the order in which they are tried."""
    others = recordings[_FIRST_TRIED:]
    step = max(1, -(-len(others) // _FURTHER_TRIED))
    return [*recordings[:_FIRST_TRIED], *others[step // 2 :: step]]


def _decoded(
    recording: FleetRecording, inputs: SimulationInputs, radius: float, out: Path, limits: Limits
) -> SensorLog:
    """
    Return a recording, decoded in another process: it may hang, or take all memory.

    :raises DataError: it cannot be used.
    :raises UsageError: neither could others, see `stage_process.ENDS_RUN`.
    """
    from adk_ros.mismatch.recording.sensor_log_file import load_sensor_log

    kept = out / ".typical.npz"
    process = StageProcess(limits.memory_mib)
    given = (recording, inputs.reading, not inputs.without_imu, radius, kept)
    try:
        reply = process.run(_keep_log, given, limits.timeout_s)
        stop_if_needed(reply)
        if reply.failure is not None:
            raise DataError(reply.reason)
        return load_sensor_log(kept)
    finally:
        process.close()
        kept.unlink(missing_ok=True)


def _keep_log(
    recording: FleetRecording,
    reading: RecordingOptions,
    needs_imu: bool,
    wheel_radius: float,
    path: Path,
) -> None:
    """Decode a recording into a file: what the other process runs."""
    from adk_ros.mismatch.recording.sensor_log_file import save_sensor_log

    with local_recording(recording) as local:
        log = read_log(local, reading, needs_imu=needs_imu, wheel_radius=wheel_radius)
    save_sensor_log(log, path)
