# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The simulation of a fleet as `adk fleet mismatch` keeps it: identified once for its inputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from adk_ros.api.fleet.index_stage import file_hash
from adk_ros.api.recording import read_log
from adk_ros.bags.recording import RecordingOptions
from adk_ros.errors import AdkError, DataError, UsageError
from adk_ros.files.code_digest import code_digest
from adk_ros.fleet.recordings import FleetRecording, local_recording
from adk_ros.fleet.run import Progress
from adk_ros.fleet.stage import hash_of
from adk_ros.fleet.store import StoreUnreachable

_FIRST_TRIED = 20
"""Recordings that are tried as the typical one before giving up."""


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
    progress: Progress | None,
) -> Path:
    """
    Return the file of the simulation, identified unless the dataset has it.

    The caller holds the lock of `out`: another run would identify the same.

    :raises DataError: none of the first recordings can be used, or a drive of the simulation.
    :raises StoreUnreachable: a store does not answer.
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
    for recording in recordings[:_FIRST_TRIED]:
        try:
            with local_recording(recording) as local:
                typical = read_log(
                    local,
                    inputs.reading,
                    needs_imu=not inputs.without_imu,
                    wheel_radius=radius,
                )
            known = FleetSimulation.identify(simulated, typical, nominal, report, further)
        except (StoreUnreachable, DifferentCar):
            # Says nothing about the recording: another one would give no other result.
            raise
        except AdkError as error:
            reasons.append(f"{recording.name}: {error}")
            continue
        scratch = out / ".simulation.npz"
        known.save(scratch)
        scratch.replace(path)
        return path
    raise DataError(f"none of the first {len(reasons)} recordings can be used; {reasons[0]}")
