# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The surrogate's own error, learned on the simulation and carried over to a recording."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.mismatch import case

from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.observability import ObservableEffects
from adk_ros.mismatch.surrogate import systematic_error
from adk_ros.mismatch.surrogate.feature_terms import feature_signals
from adk_ros.mismatch.surrogate.identification import (
    SETTLING_BINS,
    SurrogateModel,
    identify_surrogate,
)
from adk_ros.mismatch.surrogate.residuals import (
    BIN_S,
    ResidualProblem,
    prepare_residual_problem,
)
from adk_ros.mismatch.surrogate.systematic_error import SystematicError, learn_systematic_error
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.filters import low_pass

LAG_S = 0.2


@cache
def problems() -> tuple[ResidualProblem, ResidualProblem]:
    """The residual problems of a simulation, and of a recording on another road."""
    c = case()
    return prepare_residual_problem(c.simulation), prepare_residual_problem(c.recording)


@cache
def surrogate() -> SurrogateModel:
    return identify_surrogate(problems()[0], case().nominal.parameters())


def transient(problem: ResidualProblem, out: FloatArray) -> FloatArray:
    """An error (bins,) that depends on how the steering angle changes, rad/s in size."""
    delta = np.ascontiguousarray(problem.binned(feature_signals(problem, out)["delta"]))
    return np.asarray(0.1 * (delta - low_pass(delta, BIN_S, LAG_S)))


def learned(error: FloatArray) -> SystematicError | None:
    """What is learned of an error (6, bins) along the simulation."""
    problem = problems()[0]
    return learn_systematic_error(problem, run(problem), error, SETTLING_BINS)


def run(problem: ResidualProblem) -> FloatArray:
    return problem.run(surrogate().parameters)


def test_an_error_in_transients_is_known_on_another_recording() -> None:
    simulation, recording = problems()
    error = np.zeros((6, simulation.bins))
    error[2] = transient(simulation, run(simulation))
    known = learned(error)
    assert known is not None
    expected = transient(recording, run(recording))
    left = expected - known.along(recording, run(recording))[2]
    assert np.std(left) < 0.3 * np.std(expected)
    assert not known.along(recording, run(recording))[[0, 1, 3, 4, 5]].any()
    # What remains is as large as on stretches that were left out.
    assert 0.0 < np.std(known.remaining[2]) < 0.3 * np.std(error[2])


def test_noise_is_not_learned() -> None:
    simulation, _ = problems()
    noise = np.random.default_rng(1).normal(size=(6, simulation.bins))
    known = learned(noise)
    sizes = [0.0] if known is None else known.along(simulation, run(simulation)).std(axis=1)
    assert np.max(sizes) < 0.1


def test_an_error_is_not_extrapolated() -> None:
    simulation, _ = problems()
    error = np.zeros((6, simulation.bins))
    error[2] = transient(simulation, run(simulation))
    known = learned(error)
    assert known is not None
    wild = replace(simulation, smoothed_odometry=50.0 * simulation.smoothed_odometry)
    limit = np.abs(known.coefficients[2]) @ np.maximum(np.abs(known.low), np.abs(known.high))
    assert np.abs(known.along(wild, 50.0 * run(simulation))[2]).max() <= limit + 1e-12


def test_a_short_simulation_teaches_nothing() -> None:
    log = case().simulation
    short = replace(
        log,
        odometry_s=log.odometry_s[log.odometry_s < 20.0],
        odometry=log.odometry[log.odometry_s < 20.0],
        pose=log.pose[log.odometry_s < 20.0],
        imu_s=log.imu_s[log.imu_s < 20.0],
        imu=log.imu[log.imu_s < 20.0],
    )
    problem = prepare_residual_problem(short)
    error = np.zeros((6, problem.bins))
    error[2] = transient(problem, run(problem))
    assert learn_systematic_error(problem, run(problem), error, SETTLING_BINS) is None


@pytest.mark.parametrize(("lap_s", "known"), [(30.0, True), (20.0, False)])
def test_a_lap_shorter_than_ten_bends_has_shorter_stretches(
    monkeypatch: pytest.MonkeyPatch, lap_s: float, known: bool
) -> None:
    simulation, _ = problems()
    speed = float(np.mean(np.abs(simulation.smoothed_odometry[:, 0])))
    travelled = speed * (simulation.middle_s - simulation.middle_s[0])
    lap = SimpleNamespace(length=speed * lap_s, unwrapped=travelled)
    monkeypatch.setattr(systematic_error, "find_lap", lambda _: lap)
    error = np.zeros((6, simulation.bins))
    error[2] = transient(simulation, run(simulation))
    assert (learned(error) is not None) is known


def test_the_likelihood_subtracts_what_is_known() -> None:
    simulation, recording = problems()
    plain = surrogate()
    known = plain.with_known_driving(simulation)
    assert known.systematic is not None
    before, after = (Likelihood.of(recording, x) for x in (plain, known))
    assert after.surrogate_error_dof() < 0.9 * before.surrogate_error_dof()
    assert not before.systematic_error.any()
    inputs = after.simulation_inputs(np.zeros(after.n_nuisances), [])
    difference = before.channel_residuals(*inputs) - after.channel_residuals(*inputs)
    assert difference == pytest.approx(known.systematic_error(recording))


def test_without_a_torque_nothing_is_known() -> None:
    known = surrogate().with_known_driving(problems()[0])
    assert ObservableEffects(torque=False).adapted(known).systematic is None
    assert ObservableEffects().adapted(known).systematic is known.systematic
