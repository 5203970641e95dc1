# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings that the surrogate itself drives: analyses of known parameters, in a second."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from adk_ros.mismatch.inference.decision import Decision
from adk_ros.mismatch.inference.effect_intervals import confidence_intervals
from adk_ros.mismatch.inference.fit_budget import FINAL, NULL_HYPOTHESIS
from adk_ros.mismatch.inference.hypothesis import ActiveEffect, inactive_effect
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.question import Questioned
from adk_ros.mismatch.inference.result import EXPLAINED, NONE, IdentifiedEffect
from adk_ros.mismatch.inference.selection_path import SelectionPath
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.surrogate_parameters import INDEX, SIZE
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.surrogate.command_integrals import integrate_commands
from adk_ros.mismatch.surrogate.equations_of_motion import integrate
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.mismatch.surrogate.residuals import prepare_residual_problem
from adk_ros.mismatch.surrogate.run_inputs import (
    ActiveTerms,
    no_terms,
    open_loop_inputs,
    run_buffers,
)
from adk_ros.mismatch.surrogate.state_index import (
    A_X,
    A_Y,
    E_HEADING,
    E_V_X,
    E_V_Y,
    E_X,
    E_Y,
    E_YAW_RATE,
    S_V_X,
    STATE_SIZE,
    YAW_RATE,
)
from adk_ros.numerics.arrays import FloatArray
from helpers.mismatch import car

STEP_S, SECONDS, SPEED = 0.01, 60.0, 20.0
SIMULATED = {"drag_area": 0.6, "rolling": 0.012}
"""Parameters of the simulated car beyond the default ones."""


def simulated_car(**changes: float) -> FloatArray:
    """Parameters (SIZE,) of the simulated car, some of them changed."""
    return car(**(SIMULATED | changes))


@cache
def driven(**changes: float) -> SensorLog:
    """Recording of the simulated car with changed parameters: speed and bends vary slowly."""
    return drive_of(simulated_car(**changes), no_terms(round(SECONDS / STEP_S)), SECONDS)


def drive_of(
    p: FloatArray,
    terms: ActiveTerms,
    seconds: float,
    seed: int = 1,
    pose_noise_m: float = 0.0,
    steered: float = 1.0,
) -> SensorLog:
    """
    Recording of a car with the parameters `p` and `terms`: speed and bends vary slowly.

    `steered`: factor on the steering angle; 0 for a straight drive.
    """
    command_s = np.arange(0.0, seconds + 1.0, 0.025)
    hold = 0.5 * 1.225 * 0.6 * SPEED**2 + 0.012 * p[INDEX["mass"]] * 9.81
    torque = p[INDEX["wheel_radius"]] * (hold + 1500.0 * np.sin(0.35 * command_s))
    angle = steered * (0.02 * np.sin(0.2 * command_s) + 0.006 * np.sin(1.9 * command_s))
    command = np.column_stack([torque, angle])
    n = round(seconds / STEP_S)
    state = np.zeros(STATE_SIZE)
    state[S_V_X] = SPEED
    buffers = run_buffers(state, n, keep_end_states=True)
    commands = integrate_commands(command_s, command, seconds + 2.0)
    integrate(p, terms, open_loop_inputs(commands, 0.0, STEP_S, n), buffers)
    random = np.random.default_rng(seed)
    imu = buffers.output[[A_X, A_Y, YAW_RATE]].T
    imu = np.asarray(imu + random.normal(0.0, [0.05, 0.05, 2e-3], imu.shape), np.float64)
    ends = buffers.end_states[2::2]
    odometry = ends[:, [E_V_X, E_V_Y, E_YAW_RATE]]
    odometry = odometry + random.normal(0.0, [0.02, 0.02, 2e-3], odometry.shape)
    pose = ends[:, [E_X, E_Y, E_HEADING]]
    return SensorLog(
        "driven",
        seconds,
        np.asarray(STEP_S * (np.arange(n) + 0.5), np.float64),
        imu,
        np.asarray(STEP_S * np.arange(2, n + 1, 2), np.float64),
        np.asarray(odometry, np.float64),
        np.asarray(pose + pose_noise_m * random.normal(size=pose.shape), np.float64),
        command_s,
        command,
    )


def likelihood_of(log: SensorLog) -> Likelihood:
    """Likelihood of a recording under the simulated car, without lap or weak directions."""
    problem = prepare_residual_problem(log)
    residuals = 1e-3 * problem.bin_noise[:, None] * np.ones((6, problem.bins))
    surrogate = SurrogateModel(simulated_car(), np.zeros(6), residuals, np.empty((0, SIZE)))
    return Likelihood.of(problem, surrogate)


def questioned(log: SensorLog, *names: str) -> Questioned:
    """A decision for the effects `names`, fitted to a recording, that questions are about."""
    likelihood = likelihood_of(log)
    null = likelihood.fit([], budget=NULL_HYPOTHESIS)
    assert null.fit is not None
    path = SelectionPath([[null]], [], likelihood.expected_loss(null.fit.residuals))
    path.null_excess_loss = max(null.loss - path.expected_loss, 0.0)
    path.surrogate_error_dof, path.examined = likelihood.surrogate_error_dof(), 100
    h, effects = null, []
    for name in names:
        first = EFFECTS[name].parameters[0]
        start = replace(inactive_effect(EFFECTS[name]), theta=(first.theta_neutral + first.step,))
        h = likelihood.fit(
            [*h.effects, start], nuisances=h.nuisances, budget=FINAL, fit_activation=True
        )
    for active in h.effects:
        effects.append(_identified(active, null.loss - h.loss))
    verdict = EXPLAINED if effects else NONE
    decision = Decision(verdict, effects, None, h, None)
    return Questioned(likelihood, path, decision, None, simulated_car())


def _identified(active: ActiveEffect, gain: float) -> IdentifiedEffect:
    intervals = confidence_intervals(active, [0.01] * len(active.theta))
    every = [[0.0, SECONDS]]
    return IdentifiedEffect(active.effect, intervals, 0.9, [], "always", every, gain, ())
