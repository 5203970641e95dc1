# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The surrogate model of a simulator, from its recording."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from adk_ros.mismatch.inference.surrogate_extension import augment_surrogate, is_underfit
from adk_ros.mismatch.library.criteria import MIN_ROAD_COVERAGE
from adk_ros.mismatch.library.surrogate_parameters import INDEX, SURROGATE_PARAMETERS
from adk_ros.mismatch.recording.implied_values import implied_mass
from adk_ros.mismatch.recording.nominal_vehicle import NominalVehicle
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.surrogate.identification import (
    MASS_AND_LENGTH_PARAMETERS,
    SurrogateModel,
    identify_surrogate,
)
from adk_ros.mismatch.surrogate.implied_dimensions import DIMENSIONS, implied_dimensions
from adk_ros.mismatch.surrogate.residuals import ResidualProblem, prepare_residual_problem
from adk_ros.mismatch.surrogate.road_profile import zero_profile
from adk_ros.mismatch.validation import open_loop_error
from adk_ros.numerics.constants import QUANTILE_90

DEFAULT_WHEEL_RADIUS = 0.325
"""m, where no vehicle is given: torque over mass and wheel radius are not identifiable apart."""
_DEFAULT_MASS = 1600.0
_MASS_RANGE = (200.0, 4e4)
"""kg: default and range of the mass of a vehicle that is not given."""
_INERTIA_PER_MASS, _CG_TO_FRONT, _CG_TO_REAR, _TRACK_WIDTH = 1.75, 1.3, 1.4, 1.6
"""m² and m, of a mid-size car."""


def surrogate_of(
    simulation: SensorLog,
    recording: SensorLog,
    nominal: NominalVehicle | None,
    report: Callable[[float, str], None],
    of_torque: str = "",
) -> tuple[SurrogateModel, list[str]]:
    """
    Identify the simulator's surrogate, extended where it underfits; return it with notes.

    `report(done, stage)`: the share of the work that is done. `of_torque`: what the torque
    response implies for the vehicle file, in words, for the note on that file.
    """
    surrogate, notes = _surrogate_and_notes(simulation, recording, nominal, report, of_torque)
    error = open_loop_error(surrogate, simulation)
    surrogate = surrogate.with_known_driving(prepare_residual_problem(simulation))
    return replace(surrogate, open_loop_error=error), notes


def _surrogate_and_notes(
    simulation: SensorLog,
    recording: SensorLog,
    nominal: NominalVehicle | None,
    report: Callable[[float, str], None],
    of_torque: str,
) -> tuple[SurrogateModel, list[str]]:
    problem = prepare_residual_problem(simulation)
    assumed = frozenset(MASS_AND_LENGTH_PARAMETERS) if nominal is None else nominal.assumed
    unknown = assumed & MASS_AND_LENGTH_PARAMETERS.keys()
    start = (nominal or default_vehicle(simulation)).parameters()
    plain = identify_surrogate(
        problem,
        start,
        lambda done, total: report(0.5 * done / total, "identifying the simulator"),
        unknown,
    )
    of_steering = ""
    if nominal is not None and not (nominal.is_simulated or assumed & DIMENSIONS):
        implied = implied_dimensions(problem, plain, start)
        implied.check(simulation.name)
        of_steering = implied.text
    of_file = _notes_on_file(of_torque, of_steering)
    # The thresholds of roads and laps are lengths of full-size roads.
    is_full_size = simulation.length_scale == 1.0
    on_road = is_full_size and _is_on_same_road(problem, prepare_residual_problem(recording))
    extended = augment_surrogate(
        problem,
        plain,
        start,
        unknown,
        lambda done, total: report(0.5 + 0.5 * done / total, "extending the surrogate"),
        on_road,
    )
    notes = [] if nominal is None else _notes_on_assumed(nominal, extended, unknown)
    if is_full_size and not on_road and is_underfit(problem, plain):
        notes.append(
            "the recording is on another road than the simulation, or their pose frames differ: "
            "slopes of the simulated road are not identified"
        )
    if not extended.augmentation_notes:
        return plain, [*notes, *of_file]
    return extended, [
        *notes,
        "the surrogate needed more than tyres and body to reproduce the simulation, and has also: "
        f"{'; '.join(extended.augmentation_notes)}",
        *of_file,
    ]


def _notes_on_file(*implied: str) -> list[str]:
    """Return one note on what the simulation implies for the values of its vehicle file."""
    parts = [text for text in implied if text]
    if not parts:
        return []
    return [f"the vehicle file against the simulation, 90 % intervals: {'; '.join(parts)}"]


def _notes_on_assumed(
    nominal: NominalVehicle, surrogate: SurrogateModel, unknown: frozenset[str]
) -> list[str]:
    """Return what the vehicle file leaves out, with the values used instead."""
    identified = []
    for name in sorted(unknown):
        value, half = surrogate.parameters[INDEX[name]], QUANTILE_90 * surrogate.deviations[name]
        unit = SURROGATE_PARAMETERS[name].unit
        identified.append(f"{name} {value:.3g} ({value - half:.3g} to {value + half:.3g}) {unit}")
    rest = [f"{k} {getattr(nominal, k):.3g}" for k in sorted(nominal.assumed - unknown)]
    notes = []
    if identified:
        notes.append(
            "not in the vehicle file and identified from the simulation, with 90 % confidence "
            f"intervals: {', '.join(identified)}"
        )
    if rest:
        notes.append(
            "not in the vehicle file and assumed, as of a vehicle of this wheelbase: "
            f"{', '.join(rest)}"
        )
    return notes


def _is_on_same_road(simulation: ResidualProblem, recording: ResidualProblem) -> bool:
    """Whether enough of a recording is on the simulated road for that road's profile."""
    return zero_profile(simulation, ()).covered_share(recording) >= MIN_ROAD_COVERAGE


def default_vehicle(simulation: SensorLog) -> NominalVehicle:
    """Return a mid-size car of the mass that the simulation's torque response implies."""
    implied = implied_mass(simulation, DEFAULT_WHEEL_RADIUS)
    mass = _DEFAULT_MASS if implied is None else implied.value
    mass = min(max(mass, _MASS_RANGE[0]), _MASS_RANGE[1])
    return NominalVehicle(
        mass=mass,
        yaw_inertia=_INERTIA_PER_MASS * mass,
        cg_to_front_axle=_CG_TO_FRONT,
        cg_to_rear_axle=_CG_TO_REAR,
        track_width=_TRACK_WIDTH,
        wheel_radius=DEFAULT_WHEEL_RADIUS,
    )
