# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Experiment design: the manoeuvre that best discriminates between two competing effects.

The corrected model drives each manoeuvre with the identified effect and with the competing one, at
the sizes fitted to the recording, and both are observed through the sensor model. With d the
difference over the noise of a 40 ms bin, and J its derivatives with respect to nuisance parameters
t (build tolerances, sensor offsets, the competing effect's size) in prior standard deviations,

    loss = 1/2 min over t of |d - J t|^2 + |t|^2

is the loss by which a recording of the manoeuvre would discriminate between them.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from adk_ros.mismatch.inference.hypothesis import ActiveEffect
from adk_ros.mismatch.inference.nuisances import TOLERANCE_PARAMETERS
from adk_ros.mismatch.library.criteria import (
    COMPETITOR_SIZE_SIGMA,
    DISCRIMINATION_LOSS,
    MIN_SPEED,
    SENSOR_OFFSET_PRIORS,
    TOLERANCE_SIGMA,
)
from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.surrogate.command_integrals import integrate_commands
from adk_ros.mismatch.surrogate.residuals import (
    BIN_S,
    STEP_S,
    ResidualProblem,
    prepare_residual_problem,
)
from adk_ros.mismatch.surrogate.run_inputs import open_loop_inputs, run_buffers
from adk_ros.mismatch.surrogate.state_index import (
    S_PLAY,
    S_STEER,
    S_STEER_MORE,
    S_V_X,
    STATE_SIZE,
    V_X,
)
from adk_ros.mismatch.surrogate.substeps import integrate_in_substeps, scale_of
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.similarity import time_scale

COMMAND_PERIOD_S = 0.005
DURATION_S = 20.0
_SETTLING_S = 0.5
"""s at the start of a manoeuvre that do not count: the state settles."""


@dataclass(frozen=True)
class Manoeuvre:
    """
    Requests along time, one every `COMMAND_PERIOD_S`.

    `speed` at the start, m/s; `acceleration_request` (n,) longitudinal, m/s²; `steering_request`
    (n,) of the road wheels, rad.
    """

    text: str
    speed: float
    acceleration_request: FloatArray
    steering_request: FloatArray


@dataclass(frozen=True)
class Discriminability:
    """
    The manoeuvre that best discriminates between effects `of` and `other`.

    `loss` of that manoeuvre; `tried`: number of simulated manoeuvres.
    """

    of: str
    other: str
    manoeuvre: str
    loss: float
    tried: int

    @property
    def distinguishes(self) -> bool:
        """Whether the loss suffices."""
        return self.loss >= DISCRIMINATION_LOSS


def manoeuvres() -> tuple[Manoeuvre, ...]:
    """Return the manoeuvres of a full-size car that are compared, moderate on a dry road."""
    t = COMMAND_PERIOD_S * np.arange(round(DURATION_S / COMMAND_PERIOD_S))
    none, on = np.zeros_like(t), np.asarray(t > 1.0, dtype=np.float64)
    square = on * np.sign(np.sin(2.0 * np.pi * t / 4.0))
    sweep = np.sin(2.0 * np.pi * (0.2 * t + 0.5 * (1.5 - 0.2) / DURATION_S * t**2))
    return (
        Manoeuvre("coasting down from 25 m/s on a straight", 25.0, none, none),
        Manoeuvre("full acceleration from 4 m/s on a straight", 4.0, 2.5 * on, none),
        Manoeuvre("firm braking from 30 m/s on a straight", 30.0, -3.0 * on, none),
        Manoeuvre("alternating torque steps at 10 m/s", 10.0, 1.5 * square, none),
        Manoeuvre("alternating step steers at 12 m/s", 12.0, none, 0.05 * square),
        Manoeuvre("alternating step steers at 25 m/s", 25.0, none, 0.015 * square),
        Manoeuvre("a swept slalom at 15 m/s, 0.2 to 1.5 Hz", 15.0, none, 0.03 * sweep),
        Manoeuvre("a slowly tightening bend at 15 m/s", 15.0, none, 0.006 * np.maximum(t - 1, 0)),
        Manoeuvre("alternating full-lock circles at 4 m/s", 4.0, none, 0.35 * square),
    )


def similar_manoeuvres(size: float) -> tuple[Manoeuvre, ...]:
    """Return the manoeuvres with the speeds of a vehicle at a scale of lengths."""
    if size == 1.0:
        return manoeuvres()
    tempo = time_scale(size)

    def slower(found: re.Match[str]) -> str:
        return f"{tempo * float(found.group(1)):.2g} m/s"

    return tuple(
        replace(x, speed=tempo * x.speed, text=re.sub(r"([\d.]+) m/s", slower, x.text))
        for x in manoeuvres()
    )


def most_discriminating_manoeuvre(
    base: FloatArray,
    effects: Sequence[ActiveEffect],
    which: int,
    competitor: ActiveEffect,
    noise: FloatArray,
) -> Discriminability:
    """
    Return the manoeuvre that best discriminates effect `which` from its competing effect.

    `base`: the surrogate's parameters; `noise` (6,) of a bin, by channel.
    """
    others = [a for i, a in enumerate(effects) if i != which]
    identified = parameters_with_effects(base, effects)
    competing = parameters_with_effects(base, [*others, competitor])
    larger = _scaled(competitor, 1.0 + COMPETITOR_SIZE_SIGMA)
    resized = parameters_with_effects(base, [*others, larger])
    mass, radius = float(base[INDEX["mass"]]), float(base[INDEX["wheel_radius"]])
    best, text = -1.0, ""
    candidates = similar_manoeuvres(scale_of(base))
    for manoeuvre in candidates:
        run = _ManoeuvreRun(manoeuvre, mass * radius)
        observed = run.observe(identified)
        difference = run.observe(competing) - observed
        columns = [run.observe(resized) - observed - difference]
        columns += [run.observe(p) - observed for p in _perturbed(identified)]
        loss = _discrimination_loss(np.stack([difference, *columns]) / noise[:, None])
        if loss > best:
            best, text = loss, manoeuvre.text
    return Discriminability(
        effects[which].effect.name, competitor.effect.name, text, max(best, 0.0), len(candidates)
    )


def _discrimination_loss(scaled: FloatArray) -> float:
    """
    Return the loss of rows (1 + k, 6, bins): the difference, then nuisance derivatives.

    Bins with NaN in any row do not count.
    """
    counted = np.isfinite(scaled).all(axis=(0, 1))
    d = scaled[0][:, counted].ravel()
    jacobian = scaled[1:][:, :, counted].reshape(scaled.shape[0] - 1, -1).T
    normal = jacobian.T @ jacobian + np.eye(jacobian.shape[1])
    explained = np.linalg.solve(normal, jacobian.T @ d)
    return 0.5 * float(d @ d - d @ jacobian @ explained)


def _perturbed(p: FloatArray) -> list[FloatArray]:
    """Return the parameters with one nuisance parameter each at one standard deviation."""
    out = []
    for name in TOLERANCE_PARAMETERS:
        changed = p.copy()
        changed[INDEX[name]] *= 1.0 + TOLERANCE_SIGMA
        out.append(changed)
    for name, (sigma, _) in SENSOR_OFFSET_PRIORS.items():
        changed = p.copy()
        changed[INDEX[name]] += sigma
        out.append(changed)
    return out


def parameters_with_effects(base: FloatArray, effects: Sequence[ActiveEffect]) -> FloatArray:
    """Return the parameters with effects active throughout, wherever they were identified."""
    p: FloatArray = base.copy()
    for active in effects:
        for parameter, theta in zip(active.effect.parameters, active.theta, strict=True):
            for i, amount in parameter.amounts(theta, base):
                p[i] += amount
    return p


def _scaled(active: ActiveEffect, factor: float) -> ActiveEffect:
    theta = tuple(
        p.theta_neutral + factor * (x - p.theta_neutral)
        for p, x in zip(active.effect.parameters, active.theta, strict=True)
    )
    return replace(active, theta=theta)


class _ManoeuvreRun:
    """A manoeuvre prepared for open-loop runs; `torque_factor` N·m per m/s²."""

    def __init__(self, manoeuvre: Manoeuvre, torque_factor: float) -> None:
        self._speed = manoeuvre.speed
        self._first_angle = float(manoeuvre.steering_request[0])
        n = manoeuvre.steering_request.shape[0]
        command_s = COMMAND_PERIOD_S * np.arange(n, dtype=np.float64)
        torque = manoeuvre.acceleration_request * torque_factor
        command = np.column_stack([torque, manoeuvre.steering_request])
        self._commands = integrate_commands(command_s, command, DURATION_S)
        self._problem = _sensor_problem(manoeuvre.text, command_s, command)

    def observe(self, p: FloatArray) -> FloatArray:
        """
        Return the channels (6, bins) as the sensors report them.

        Zero while the state settles, NaN where the car is slower than `MIN_SPEED`.
        """
        problem = self._problem
        state = np.zeros(STATE_SIZE)
        state[S_V_X] = self._speed
        state[[S_PLAY, S_STEER, S_STEER_MORE]] = p[INDEX["steer_gain"]] * self._first_angle
        inputs = open_loop_inputs(self._commands, problem.start_s, STEP_S, problem.steps)
        buffers = run_buffers(state, problem.steps)
        integrate_in_substeps(p, problem.no_terms(), inputs, buffers)
        # The measurements are zero: the residuals are the negative simulated signals.
        channels = -problem.residuals(p, out=buffers.output)
        steps_per_bin = round(BIN_S / STEP_S)
        bin_of = np.minimum(np.arange(problem.steps) // steps_per_bin, problem.bins - 1)
        slowest = MIN_SPEED * time_scale(scale_of(p))
        slow = np.bincount(bin_of, buffers.output[V_X] < slowest, problem.bins) > 0
        channels[:, slow] = np.nan
        channels[:, problem.bin_s < _SETTLING_S] = 0.0
        return channels


def _sensor_problem(name: str, command_s: FloatArray, command: FloatArray) -> ResidualProblem:
    """Return the residual problem of sensors that report zero, one sample per step."""
    at_s = STEP_S * (np.arange(round(DURATION_S / STEP_S), dtype=np.float64) + 0.5)
    zero = np.zeros((at_s.size, 3))
    log = SensorLog(name, DURATION_S, at_s, zero, at_s, zero, zero, command_s, command)
    return prepare_residual_problem(log, np.ones(6))
