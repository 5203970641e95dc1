# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rows of evidence: complete, flat, and refused where they do not belong together."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from adk_ros.errors import DataError
from adk_ros.fleet.inference.evidence import (
    RECORDING,
    SIMULATION,
    Columns,
    Evidence,
    column_of,
    effect_columns,
    place_columns,
)
from adk_ros.fleet.inference.fleet_evidence import FleetEvidence, RecordingTags
from adk_ros.fleet.inference.fleet_simulation import FleetSimulation
from adk_ros.fleet.inference.place_evidence import Cell
from adk_ros.mismatch.library.surrogate_parameters import INDEX, default_parameters
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.numerics.similarity import length_scale

LAYOUT = Columns(2, ("aero_drag.cda", "steering_lag.tau"))


def evidence(name: str, kind: str = RECORDING, layout: Columns = LAYOUT) -> Evidence:
    d = layout.size
    rng = np.random.default_rng(len(name))
    return Evidence(
        name, kind, layout, rng.standard_normal(d), np.eye(d), 60.0,
        dispersion=2.0, scatter=np.eye(d) if kind == SIMULATION else None, blocks=12,
    )  # fmt: skip


def test_a_row_holds_the_evidence() -> None:
    one = evidence("simulation", SIMULATION)
    row = one.to_row()
    assert all(isinstance(value, int | float | str | bytes) for value in row.values())
    back = Evidence.from_row(row)
    np.testing.assert_array_equal(back.score, one.score)
    assert back.scatter is not None
    np.testing.assert_array_equal(back.scatter, one.scatter)
    assert back.columns == LAYOUT
    assert back.blocks == 12


def test_scales_are_prior_deviations_and_thresholds() -> None:
    scale = LAYOUT.scale
    assert scale.shape == (LAYOUT.size,)
    assert scale[0] == 0.004
    assert scale[-2] == column_of("aero_drag.cda").materiality == 0.03


def test_catalogue_columns() -> None:
    keys = [c.key for c in effect_columns()]
    assert "imu_bias.gyro" in keys
    assert "road_grade.grade" not in keys
    assert "road_grade.grade" in [c.key for c in place_columns()]
    assert column_of("power_limit.power").materiality == pytest.approx(1.0 / 1.5e5)
    with pytest.raises(DataError, match=r"'warp\.factor' is no parameter"):
        column_of("warp.factor")


def test_scale_models_have_thresholds_and_bounds_of_their_size() -> None:
    layout = replace(LAYOUT, length_scale=0.1)
    drag, lag = (layout.column(key) for key in LAYOUT.effects)
    assert drag.materiality == pytest.approx(0.03 * 0.1**2)
    assert drag.bounds == pytest.approx(LAYOUT.column("aero_drag.cda").bounds)
    # A delay is that of electronics: it does not scale.
    assert lag.materiality == LAYOUT.column("steering_lag.tau").materiality
    np.testing.assert_array_equal(layout.scale[-2:], [drag.materiality, lag.materiality])
    one = evidence("a", layout=layout)
    assert Evidence.from_row(one.to_row()).columns == layout
    with pytest.raises(DataError, match="evidence of bb is about other effects"):
        FleetEvidence.of([one.to_row(), evidence("bb").to_row()], {})


def test_the_layout_of_a_simulation_has_the_size_of_its_vehicle(tmp_path: Path) -> None:
    parameters = default_parameters()
    for name in ("cg_to_front_axle", "cg_to_rear_axle"):
        parameters[INDEX[name]] = 0.135
    surrogate = SurrogateModel(
        parameters, np.zeros(6), np.zeros((6, 100)), np.zeros((2, parameters.size))
    )
    scale = length_scale(0.27)
    one = evidence("simulation", SIMULATION, replace(LAYOUT, length_scale=scale))
    path = tmp_path / "simulation.npz"
    FleetSimulation(surrogate, one).save(path)
    loaded = FleetSimulation.load(path)
    assert scale == pytest.approx(0.1)
    assert loaded.columns == one.columns
    assert loaded.columns.length_scale == loaded.length_scale


def test_a_fleet_divides_by_the_dispersion() -> None:
    rows = [evidence("a").to_row(), evidence("bb").to_row(), evidence("s", SIMULATION).to_row()]
    fleet = FleetEvidence.of(rows, {"a": RecordingTags("car1", 3.0, {"tyres": "summer"})})
    assert fleet.cars == ("car1", "bb")
    np.testing.assert_array_equal(fleet.informations[0], 0.5 * np.eye(LAYOUT.size))
    np.testing.assert_array_equal(fleet.shares, [0.5, 0.5])
    assert fleet.kept([1]).names == ("bb",)


def test_rows_that_do_not_belong_together_are_refused() -> None:
    other = evidence("b", layout=Columns(1, LAYOUT.effects)).to_row()
    with pytest.raises(DataError, match="evidence of b is about other effects"):
        FleetEvidence.of([evidence("a").to_row(), other], {})
    with pytest.raises(DataError, match="nothing to combine"):
        FleetEvidence.of([], {})
    row = evidence("a").to_row()
    with pytest.raises(DataError, match="schema 0"):
        Evidence.from_row({**row, "schema": 0})
    with pytest.raises(DataError, match="values where"):
        Evidence.from_row({**row, "score": b"12345678"})


def test_cells_adjoin() -> None:
    cell = Cell(3, -2, 0)
    assert Cell.of_text(cell.text) == cell
    assert cell.is_next_to(Cell(4, -2, 7))
    assert not cell.is_next_to(Cell(4, -2, 4))
    assert cell.centre == (210.0, -90.0)
