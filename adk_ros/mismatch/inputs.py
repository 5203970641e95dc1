# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Inputs of a mismatch analysis: checked recordings, and the simulator's surrogate model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from adk_ros.calibration.scope import Scope, common_scope
from adk_ros.mismatch.inference.observability import is_torque
from adk_ros.mismatch.library.criteria import SURROGATE_ERROR_AS_NOISE
from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.mismatch.recorded_data import RecordedData, usable_recordings
from adk_ros.mismatch.recording.checks import (
    check_recording,
    check_same_vehicle,
    check_torque_unit,
    check_vehicle,
    torque_response_text,
)
from adk_ros.mismatch.recording.dead_channels import without_dead_channels
from adk_ros.mismatch.recording.frozen_readings import without_frozen_readings
from adk_ros.mismatch.recording.inferred_torque import with_inferred_torque
from adk_ros.mismatch.recording.joined import concatenated, in_sequence
from adk_ros.mismatch.recording.nominal_vehicle import NominalVehicle
from adk_ros.mismatch.recording.recorded_scope import recorded_scope
from adk_ros.mismatch.recording.sensor_log import CHANNELS, SensorLog
from adk_ros.mismatch.road_by_ins import with_measured_road, with_measured_roads
from adk_ros.mismatch.simulator import DEFAULT_WHEEL_RADIUS, default_vehicle, surrogate_of
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.mismatch.surrogate.lap import Lap
from adk_ros.mismatch.surrogate.residuals import BIN_S
from adk_ros.mismatch.surrogate.substeps import scale_of
from adk_ros.numerics.arrays import FloatArray

SurrogateProgress = Callable[[float, str], None]


@dataclass(frozen=True)
class Inputs:
    """The simulator's bag or surrogate, the identified surrogate, the recordings, and notes."""

    simulation: SensorLog | SurrogateModel
    surrogate: SurrogateModel
    data: RecordedData
    has_imu: bool
    notes: tuple[str, ...]
    scope: tuple[Scope, ...] = ()
    """What the channels of the recordings allow, before any analysis."""

    @classmethod
    def of(
        cls,
        simulation: SensorLog | SurrogateModel,
        recordings: Sequence[SensorLog],
        nominal: NominalVehicle | None,
        held_out_share: float,
        progress: SurrogateProgress,
    ) -> Inputs:
        """
        Check recordings and simulation, and identify the simulator.

        `held_out_share` of each recording is not used for training.
        :raises DataError: the recordings do not allow an analysis.
        """
        size = vehicle_scale(simulation, nominal)
        recordings = [replace(log, length_scale=size) for log in recordings]
        scope = common_scope([recorded_scope(log) for log in recordings])
        live = [without_dead_channels(log) for log in recordings]
        notes = [line for _, lines in live for line in lines]
        has_imu = all(log.imu_s.size > 0 for log, _ in live)
        logs = usable_recordings([log for log, _ in live])
        for i, log in enumerate(logs):
            logs[i], dropouts = without_frozen_readings(log)
            notes += [f"{log.name}: {line}" for line in dropouts] if len(logs) > 1 else dropouts
        noise = [log.noise() for log in logs]
        if isinstance(simulation, SurrogateModel):
            surrogate = simulation
            notes += _notes_on_known(surrogate)
            noise = [np.maximum(x, _error_as_noise(surrogate)) for x in noise]
        else:
            simulation = replace(simulation, length_scale=size)
            of_torque = _check_simulation(simulation, logs, nominal)
            progress(0.0, "identifying the simulator")
            every = logs[0] if len(logs) == 1 else concatenated(in_sequence(logs))
            surrogate, found = surrogate_of(simulation, every, nominal, progress, of_torque)
            notes += [*found, *_notes_on_default_vehicle(nominal)]
        logs = [_with_torque(log, surrogate) for log in logs]
        # Without an IMU, a slope is not separated from a force.
        logs, found = with_measured_roads(logs, surrogate) if has_imu else (logs, [])
        notes += found
        data = RecordedData.of(surrogate, logs, noise, has_imu, held_out_share)
        notes += [
            *_notes_on_size(size),
            *_notes_on_lap(data.lap, size),
            *_notes_on_driving(surrogate, data),
        ]
        return cls(simulation, surrogate, data, has_imu, tuple(notes), tuple(scope))

    def completed(self, log: SensorLog) -> SensorLog:
        """Return a further recording as the analysed ones are: without dead channels."""
        sized = replace(log, length_scale=scale_of(self.surrogate.parameters))
        complete = _with_torque(without_dead_channels(sized)[0], self.surrogate)
        return with_measured_road(complete, self.surrogate, self.data.problem.log)


def vehicle_scale(simulation: SensorLog | SurrogateModel, nominal: NominalVehicle | None) -> float:
    """Return the scale of lengths of the vehicle; 1 where nothing says that it is a model."""
    if isinstance(simulation, SurrogateModel):
        return scale_of(simulation.parameters)
    return 1.0 if nominal is None else nominal.length_scale


def _with_torque(log: SensorLog, surrogate: SurrogateModel) -> SensorLog:
    """Return a recording with the torque that its motion takes where the command is none."""
    p = surrogate.parameters
    if log.torque_is_inferred or is_torque(log, p[INDEX["mass"]], p[INDEX["wheel_radius"]]):
        return log
    return with_inferred_torque(log, p)


def _check_simulation(
    simulation: SensorLog, logs: Sequence[SensorLog], nominal: NominalVehicle | None
) -> str:
    """
    Check the simulation's bag, alone and with the recordings.

    Return what its torque response implies for the vehicle file, in words; empty without a file.
    """
    check_recording(simulation, is_simulation=True)
    for log in logs:
        check_same_vehicle(simulation, log)
    of_torque = ""
    if nominal is not None and not nominal.is_simulated:
        of_torque = torque_response_text(check_vehicle(nominal, simulation), nominal)
    vehicle = nominal or default_vehicle(simulation)
    for log in logs:
        check_torque_unit(log, vehicle.mass, vehicle.wheel_radius)
    return of_torque


def _error_as_noise(surrogate: SurrogateModel) -> FloatArray:
    """
    Return the part (6,) of a known surrogate's error that counts as sensor noise.

    Not for a surrogate from a file, which was identified on a noise-free simulation.
    """
    if surrogate.autocovariance is not None:
        return np.zeros(len(CHANNELS))
    return np.asarray(SURROGATE_ERROR_AS_NOISE * surrogate.error)


def _notes_on_known(surrogate: SurrogateModel) -> list[str]:
    if np.any(surrogate.error > 0.0):
        return []
    return [
        "the surrogate's file does not hold its error on the simulation: effects may be reported "
        "with too much confidence; write the file again from the simulation's bag"
    ]


def _notes_on_default_vehicle(nominal: NominalVehicle | None) -> list[str]:
    if nominal is not None:
        return []
    return [
        "no --vehicle: masses and lengths are identified from the simulation, for wheels of "
        f"{DEFAULT_WHEEL_RADIUS:g} m radius"
    ]


def _notes_on_size(size: float) -> list[str]:
    if size == 1.0:
        return []
    return [
        f"a scale model, 1:{1.0 / size:.2g} of a mid-size car: thresholds of speed, time, mass "
        "and length are those at the same Froude number; effects at places of a lap are not "
        "examined"
    ]


def _notes_on_lap(lap: Lap | None, size: float) -> list[str]:
    if lap is not None or size < 1.0:
        return []
    return [
        "no part of the route is driven twice, so local effects (grade, bank, friction patches) "
        "cannot be identified"
    ]


def _notes_on_driving(surrogate: SurrogateModel, data: RecordedData) -> list[str]:
    """Return how much of the recordings is driven harder than the simulation."""
    beyond_s = BIN_S * sum(float(surrogate.harder_driving(part).sum()) for part in data.parts)
    if beyond_s == 0.0:
        return []
    share = beyond_s / (BIN_S * data.problem.bins)
    left_out = any(surrogate.bins_beyond(part).any() for part in data.parts)
    return [
        f"{beyond_s:.0f} s ({100.0 * share:.0f} %) of the recording are driven harder than the "
        "simulation, with accelerations that it does not reach: there the surrogate extrapolates, "
        f"and {'nothing is compared' if left_out else 'its error is unknown'}; simulate a drive "
        "that is as hard"
    ]
