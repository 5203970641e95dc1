# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Understeer and resistance of recordings whose parameters are known."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.mismatch_drive import driven, likelihood_of, questioned, simulated_car

from adk_ros.mismatch.inference.joint_likelihood import JointLikelihood
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.steady_state import (
    AIR_DENSITY,
    SteadyState,
    line_error,
    steady_state,
)
from adk_ros.mismatch.library.surrogate_parameters import INDEX, SIZE
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.mismatch.surrogate.joined_problem import JoinedProblem
from adk_ros.numerics.constants import QUANTILE_90


def shown(**changes: float) -> SteadyState:
    likelihood = likelihood_of(driven(**changes))
    return steady_state(likelihood, likelihood.fit([]), has_torque=True)


def test_more_drag_is_a_steeper_resistance() -> None:
    result = shown(drag_area=1.6)
    assert result.resistance is not None
    measured, simulation = result.resistance.measured, result.resistance.simulation
    area = 2.0 * result.mass / AIR_DENSITY
    more = area * (measured.line[0] - simulation.line[0])
    half = QUANTILE_90 * area * line_error(measured.left_out - simulation.left_out)[0]
    assert more == pytest.approx(1.0, abs=max(3.0 * half, 0.1))
    assert half < 0.2


def test_spinning_wheels_are_no_drag() -> None:
    """The line is that of the car's drag; the resistance of gentle bends leaves some of it."""
    result = shown()
    assert result.resistance is not None
    area = 2.0 * result.mass / AIR_DENSITY * result.resistance.simulation.line[0]
    assert area == pytest.approx(float(simulated_car()[INDEX["drag_area"]]), abs=0.1)


def test_the_corrected_model_lies_on_the_measurement() -> None:
    about = questioned(driven(drag_area=1.6), "aero_drag")
    result = steady_state(about.likelihood, about.decision.hypothesis, has_torque=True)
    assert result.resistance is not None
    left = result.resistance.measured.y - result.resistance.corrected.y
    assert np.abs(left).max() < 0.02
    assert np.all(result.resistance.errors[1] <= result.resistance.errors[0] + 1e-3)


def test_softer_front_tyres_are_more_understeer() -> None:
    p = simulated_car()
    result = shown(stiffness_f=0.7 * float(p[INDEX["stiffness_f"]]))
    assert result.understeer is not None
    measured, simulation = result.understeer.measured, result.understeer.simulation
    difference = measured.line[0] - simulation.line[0]
    error = line_error(measured.left_out - simulation.left_out)[0]
    # An axle's slip angle per a_y is 1 / (g stiffness over load); theirs differ by this.
    expected = (1.0 / 0.7 - 1.0) / (9.81 * float(p[INDEX["stiffness_f"]]))
    assert difference == pytest.approx(expected, rel=0.3)
    assert difference > 3.0 * error


def test_without_a_torque_there_is_no_resistance() -> None:
    likelihood = likelihood_of(driven())
    assert steady_state(likelihood, likelihood.fit([]), has_torque=False).resistance is None


def test_too_little_quasi_steady_driving_gives_none() -> None:
    log = driven()
    wild = log.command.copy()
    wild[:, 1] += 0.05 * np.sign(np.sin(40.0 * log.command_s))
    likelihood = likelihood_of(type(log)(**{**vars(log), "command": wild}))
    assert steady_state(likelihood, likelihood.fit([]), has_torque=True).understeer is None


def test_several_recordings_are_one_characteristic() -> None:
    log = driven(drag_area=1.6)
    joined = JoinedProblem.of([log, log], [log.noise(), log.noise()])
    surrogate = SurrogateModel(
        simulated_car(), np.zeros(6), 1e-4 * np.ones((6, joined.bins)), np.empty((0, SIZE))
    )
    parts = [Likelihood.of(part, surrogate) for part in joined.parts]
    both = JointLikelihood.joined(joined, surrogate, parts)
    result = steady_state(both, both.fit([]), has_torque=True)
    assert result.resistance is not None
    alone = shown(drag_area=1.6).resistance
    assert alone is not None
    assert result.resistance.seconds == pytest.approx(2.0 * alone.seconds, rel=0.1)
    np.testing.assert_allclose(
        result.resistance.measured.line, alone.measured.line, rtol=0.1, atol=1e-3
    )
