# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The simulation of a fleet: its surrogate, identified once, and what its own error may feign.

The surrogate's error repeats in every recording and would pool into an effect of all cars. The
scores of the effects on the simulation itself, by blocks of time, show how large: their sum over
the simulation has the covariance of the sum of independent blocks. The residuals are those that
the control variate leaves on stretches left out of its fit (`surrogate.systematic_error`),
whitened as those of a recording of the fleet.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from adk_ros.errors import UsageError
from adk_ros.fleet.inference.evidence import (
    SIMULATION,
    Columns,
    Evidence,
    SimulationError,
    effect_columns,
)
from adk_ros.fleet.inference.further_simulations import error_on
from adk_ros.fleet.inference.linearisation import linearised
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.recording.nominal_vehicle import NominalVehicle
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.simulator import surrogate_of
from adk_ros.mismatch.surrogate.acceleration_envelope import AccelerationEnvelope
from adk_ros.mismatch.surrogate.feature_terms import FeatureTerm
from adk_ros.mismatch.surrogate.identification import SETTLING_BINS, SurrogateModel
from adk_ros.mismatch.surrogate.residuals import BIN_S, prepare_residual_problem
from adk_ros.mismatch.surrogate.road_profile import RoadProfile
from adk_ros.mismatch.surrogate.substeps import scale_of
from adk_ros.mismatch.surrogate.systematic_error import SystematicError
from adk_ros.numerics.arrays import FloatArray

KIND, SCHEMA = "fleet_simulation", 2
Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class FleetSimulation:
    """The surrogate of a simulation and the evidence of the simulation about itself."""

    surrogate: SurrogateModel
    evidence: Evidence
    notes: tuple[str, ...] = ()

    @property
    def columns(self) -> Columns:
        """Layout of the joint vector of all evidence with this simulation."""
        return self.evidence.columns

    @property
    def length_scale(self) -> float:
        """Scale of lengths of the vehicle."""
        return scale_of(self.surrogate.parameters)

    @classmethod
    def identify(
        cls,
        simulation: SensorLog,
        recording: SensorLog,
        nominal: NominalVehicle | None = None,
        progress: Progress | None = None,
        further: Sequence[SensorLog] = (),
    ) -> FleetSimulation:
        """
        Identify the surrogate of a simulation; `recording`: a typical one of the fleet.

        The recording gives the sensors' noise, and whether the simulated road is the fleet's.
        `further`: drives of the same simulated car on roads of the fleet, which show what the
        surrogate's error feigns there.

        :raises DataError: a drive cannot be used, or is not of the simulated car.
        """
        size = 1.0 if nominal is None else nominal.length_scale
        simulation = replace(simulation, length_scale=size)
        recording = replace(recording, length_scale=size)
        surrogate, notes = surrogate_of(
            simulation, recording, nominal, progress or (lambda done, text: None)
        )
        columns = _columns(surrogate, [c.key for c in effect_columns()])
        noise = recording.noise()
        evidence = simulation_evidence(simulation, surrogate, columns, noise)
        if further:
            drives = [replace(log, length_scale=size) for log in further]
            error = error_on(drives, surrogate, columns, noise)
            evidence = replace(evidence, error=error)
        return cls(surrogate, evidence, tuple(notes))

    def save(self, path: Path) -> None:
        """Write the simulation as a file of arrays without pickled objects."""
        s = self.surrogate
        text = {
            "kind": KIND,
            "schema": SCHEMA,
            "notes": list(self.notes),
            "augmentation_notes": list(s.augmentation_notes),
            "deviations": dict(s.deviations),
            "feature_terms": [asdict(term) for term in s.feature_terms],
            "road": None if s.road is None else [list(s.road.entries), s.road.spacing],
            "effects": list(self.columns.effects),
            "counted_s": self.evidence.counted_s,
            "blocks": self.evidence.blocks,
            "name": self.evidence.name,
            "loss": self.evidence.loss,
            "expected_loss": self.evidence.expected_loss,
            "further_drives": 0 if self.evidence.error is None else self.evidence.error.drives,
        }
        arrays: dict[str, Any] = {
            "parameters": s.parameters,
            "error": s.error,
            "residuals": s.residuals,
            "weak_directions": s.weak_directions,
            "score": self.evidence.score,
            "information": self.evidence.information,
            "scatter": self.evidence.scatter,
        }
        if self.evidence.error is not None:
            arrays["further_vector"] = self.evidence.error.vector
            arrays["further_variance"] = self.evidence.error.variance
        if s.road is not None:
            arrays |= {"road_line": s.road.line, "road_coefficients": s.road.coefficients}
        if s.systematic is not None:
            arrays |= {f"systematic_{k}": v for k, v in vars(s.systematic).items()}
        if s.envelope is not None:
            arrays["envelope"] = s.envelope.vertices
        if s.open_loop_error is not None:
            arrays["open_loop_error"] = s.open_loop_error
        encoded = np.frombuffer(json.dumps(text).encode(), dtype=np.uint8)
        with path.open("wb") as file:
            np.savez_compressed(file, text=encoded, **arrays)

    @classmethod
    def load(cls, path: Path) -> FleetSimulation:
        """
        Read a file of `save`.

        :raises UsageError: the file cannot be read, or is none.
        """
        try:
            with np.load(path, allow_pickle=False) as content:
                arrays = {name: content[name] for name in content.files}
            text = json.loads(arrays.pop("text").tobytes())
            if text["kind"] != KIND or text["schema"] != SCHEMA:
                raise ValueError("another kind or schema")
            return cls._of(text, arrays)
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise UsageError(f"{path} is no simulation of a fleet: {error}") from None

    @classmethod
    def _of(cls, text: dict[str, Any], arrays: dict[str, FloatArray]) -> FleetSimulation:
        road = text["road"]
        systematic = {
            k.removeprefix("systematic_"): v
            for k, v in arrays.items()
            if k.startswith("systematic_")
        }
        surrogate = SurrogateModel(
            parameters=arrays["parameters"],
            error=arrays["error"],
            residuals=arrays["residuals"],
            weak_directions=arrays["weak_directions"],
            road=None
            if road is None
            else RoadProfile(
                arrays["road_line"], tuple(road[0]), arrays["road_coefficients"], road[1]
            ),
            feature_terms=tuple(FeatureTerm(**term) for term in text["feature_terms"]),
            augmentation_notes=tuple(text["augmentation_notes"]),
            open_loop_error=arrays.get("open_loop_error"),
            systematic=SystematicError(**systematic) if systematic else None,
            envelope=AccelerationEnvelope(arrays["envelope"]) if "envelope" in arrays else None,
            deviations=text["deviations"],
        )
        columns = _columns(surrogate, text["effects"])
        evidence = Evidence(
            text["name"],
            SIMULATION,
            columns,
            arrays["score"],
            arrays["information"],
            text["counted_s"],
            loss=text["loss"],
            expected_loss=text["expected_loss"],
            scatter=arrays["scatter"],
            blocks=text["blocks"],
            error=SimulationError(
                arrays["further_vector"], arrays["further_variance"], text["further_drives"]
            )
            if text["further_drives"]
            else None,
        )
        return cls(surrogate, evidence, tuple(text["notes"]))


def _columns(surrogate: SurrogateModel, keys: Sequence[str]) -> Columns:
    """Return the layout of the joint vector of all evidence with a surrogate."""
    weak = surrogate.weak_directions.shape[0]
    return Columns(weak, tuple(keys), scale_of(surrogate.parameters))


def simulation_evidence(
    simulation: SensorLog, surrogate: SurrogateModel, columns: Columns, noise: FloatArray
) -> Evidence:
    """Return the evidence of a simulation about itself, with the noise (6,) of a recording."""
    problem = prepare_residual_problem(simulation, noise)
    likelihood = Likelihood.of(problem, surrogate)
    remaining = np.zeros((6, problem.bins))
    left = surrogate.unexplained_residuals
    remaining[:, problem.bins - left.shape[1] :] = left
    if left.shape[1] == problem.bins:
        remaining[:, :SETTLING_BINS] = 0.0
    # The simulation's distances agree by construction: they say nothing about its errors.
    distances = np.zeros(likelihood.distance_residuals(likelihood.parameters).shape[0])
    e = np.concatenate([likelihood.whiten(remaining).ravel(), distances])
    linear = linearised(likelihood, columns, effect_columns(likelihood.effects), residuals=e)
    scores = linear.block_scores(np.zeros(columns.size))
    counted = (likelihood.weights > 0.0).any(axis=0)
    expected = likelihood.expected_loss(linear.residuals)
    return Evidence(
        simulation.name,
        SIMULATION,
        columns,
        linear.score,
        linear.information,
        BIN_S * float(counted.sum()),
        loss=linear.loss,
        expected_loss=expected,
        scatter=scores.T @ scores,
        blocks=scores.shape[0],
    )
