# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Evidence of a recording: prepared as for a single analysis, then linearised in all effects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from adk_ros.errors import DataError
from adk_ros.fleet.inference.evidence import (
    RECORDING,
    Evidence,
    Row,
    column_of,
    effect_columns,
)
from adk_ros.fleet.inference.fleet_simulation import FleetSimulation
from adk_ros.fleet.inference.linearisation import dispersion, effects_at, linearised
from adk_ros.fleet.inference.place_evidence import Cell, away_from, in_cells, place_rows
from adk_ros.mismatch.inference.hypothesis import ActiveEffect
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.observability import is_torque
from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.mismatch.recorded_data import RecordedData, usable_recordings
from adk_ros.mismatch.recording.dead_channels import without_dead_channels
from adk_ros.mismatch.recording.frozen_readings import without_frozen_readings
from adk_ros.mismatch.recording.inferred_torque import with_inferred_torque
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.surrogate.activation import Activation
from adk_ros.mismatch.surrogate.residuals import BIN_S

UNPLACED = "unplaced"
"""Entry of a recording's row: whether it takes no part in the search for places."""
_ORIGIN_M = 1.0
"""m from x = y = 0 within which odometry that counts from its start begins. By choice."""


def evidence_rows(
    recording: SensorLog,
    simulation: FleetSimulation,
    values: Mapping[str, float] | None = None,
    local: Sequence[PlacedValue] = (),
    *,
    name: str | None = None,
) -> list[Row]:
    """
    Return the evidence of a recording as flat rows: one of the recording, one per place.

    `values`: key effect.parameter -> difference of the fitted variable from neutral, at which to
    linearise: the fleet's estimate for this recording in a second pass; `local`: the same of
    effects at places, which stay part of the model. `name`: identity of the
    recording in the rows (the log's name by default).

    :raises DataError: the recording does not allow an analysis.
    """
    likelihood = recording_likelihood(recording, simulation)
    columns = effect_columns(likelihood.effects)
    values = {k: v for k, v in (values or {}).items() if v != 0.0}
    placed = [one.active(likelihood) for one in local]
    linear = linearised(likelihood, simulation.columns, columns, values, placed=placed)
    name = recording.name if name is None else name
    counted = (likelihood.weights > 0.0).any(axis=0)
    whole = max(int(counted.sum()), 1)
    rows: list[Row] = []
    unplaced = begins_at_origin(recording)
    if likelihood.problem.log.length_scale == 1.0 and not unplaced:
        rows = place_rows(name, likelihood, linear, values, columns, placed)
        if local:
            away = away_from(likelihood.problem, {cell for one in local for cell in one.cells})
            kept = np.ones(linear.residuals.size, dtype=bool)
            kept[: 6 * away.size] = np.tile(away, 6)
            linear, counted = linear.of_rows(kept), counted & away
    evidence = Evidence(
        name,
        RECORDING,
        simulation.columns,
        linear.score,
        linear.information,
        BIN_S * float(counted.sum()),
        start_ns=recording.start_ns,
        dispersion=dispersion(linear, simulation.columns),
        loss=linear.loss,
        expected_loss=likelihood.expected_loss(linear.residuals, float(counted.sum()) / whole),
        point=linear.point,
        blocks=int(np.unique(linear.block[linear.residuals != 0.0]).size),
    )
    return [evidence.to_row() | {UNPLACED: unplaced}, *rows]


def begins_at_origin(recording: SensorLog) -> bool:
    """
    Whether odometry counts from the start of the drive: two such drives have no place in common.

    In a map, a drive begins at x = y = 0 by chance only, and is missed little.
    """
    known = recording.pose[np.isfinite(recording.pose[:, :2]).all(axis=1), :2]
    return bool(known.size) and float(np.hypot(*known[0])) < _ORIGIN_M


@dataclass(frozen=True)
class PlacedValue:
    """An effect's parameter (key) in cells: difference of the fitted variable from neutral."""

    key: str
    cells: tuple[Cell, ...]
    value: float

    def active(self, likelihood: Likelihood) -> ActiveEffect:
        """Return the effect along a recording."""
        weight = in_cells(likelihood.problem, self.cells)
        (active,) = effects_at(
            [column_of(self.key)], {self.key: self.value}, Activation(weight=weight)
        )
        return active


def recording_likelihood(recording: SensorLog, simulation: FleetSimulation) -> Likelihood:
    """
    Return the likelihood of all data of a recording under the simulation's surrogate.

    :raises DataError: the recording does not allow an analysis.
    """
    surrogate = simulation.surrogate
    log = replace(recording, length_scale=simulation.length_scale)
    log, _ = without_dead_channels(log)
    has_imu = log.imu_s.size > 0
    (log,) = usable_recordings([log])
    log, _ = without_frozen_readings(log)
    noise = log.noise()
    p = surrogate.parameters
    if not log.torque_is_inferred and not is_torque(
        log, p[INDEX["mass"]], p[INDEX["wheel_radius"]]
    ):
        log = with_inferred_torque(log, p)
    data = RecordedData.of(surrogate, [log], [noise], has_imu, 0.0)
    if not data.observable.is_excited:
        lacking = "; ".join(x.text for x in data.observable.missing_channels())
        raise DataError(f"{log.name}: no command to compare the motion with: {lacking}")
    return data.whole()
