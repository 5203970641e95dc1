# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What to drive next: manoeuvres, simulated, that would tell apart what this drive could not.

The corrected model drives each manoeuvre twice, once with an effect and once with what stands in
its place, of the sizes that both had on the recording. What differs counts in units of the noise,
less what build tolerances and 3 % of the rival's size could make up:

    loss = min over t of  1/2 |d - J t|^2 + 1/2 |t|^2        d: difference over noise, a 40 ms bin

with J what a tolerance of its usual size changes. It tells them apart where that loss is
`ENOUGH`, five times what chance allows a rival on a recording (`ambiguity.MARGIN`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from adk_ros.mismatch.inference.identifiability import INDISTINGUISHABLE_LOSS
from adk_ros.mismatch.inference.likelihood import (
    TOLERANCE_PARAMETERS,
    TOLERANCE_SIGMA,
    ActiveEffect,
)
from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.mismatch.surrogate.equations_of_motion import integrate
from adk_ros.mismatch.surrogate.residuals import BIN_S, COMMAND_GRID_S, cumulative_command
from adk_ros.mismatch.surrogate.state_index import (
    A_X,
    A_Y,
    OUTPUTS,
    S_PLAY,
    S_STEER,
    S_STEER_MORE,
    S_V_X,
    STATE_SIZE,
    V_X,
    V_Y,
    YAW_RATE,
)
from adk_ros.numerics.arrays import FloatArray

DISCRIMINATION_LOSS = 5.0 * INDISTINGUISHABLE_LOSS
STEP_S = 0.005
DURATION_S = 20.0
_MIN_SPEED = 3.0
"""m/s, below which nothing is compared."""
_ROWS = (A_X, A_Y, YAW_RATE, V_X, V_Y, YAW_RATE)
"""Of a run's output, for `evidence.CHANNELS`."""
_COMPETITOR_SIGMA = 0.03
_BIN_STEPS = round(BIN_S / STEP_S)
_SETTLING_STEPS = round(0.5 / STEP_S)


@dataclass(frozen=True)
class Manoeuvre:
    """
    Commands along time.

    `speed` (m/s) at the start; `push` (n,) longitudinal acceleration asked for, m/s^2; `angle`
    (n,) of the road wheels, rad.
    """

    text: str
    speed: float
    acceleration_request: FloatArray
    steering_request: FloatArray


@dataclass(frozen=True)
class Discriminability:
    """
    How the best of all manoeuvres tells `of` from `other`.

    `loss` of that, against `ENOUGH`; `tried` manoeuvres were simulated.
    """

    of: str
    other: str
    manoeuvre: str
    loss: float
    tried: int

    @property
    def distinguishes(self) -> bool:
        """Whether it does."""
        return self.loss >= DISCRIMINATION_LOSS


def manoeuvres() -> tuple[Manoeuvre, ...]:
    """Return what is tried, gentle enough for a car on a dry road."""
    t = STEP_S * np.arange(round(DURATION_S / STEP_S))
    none, on = np.zeros_like(t), np.asarray(t > 1.0, dtype=np.float64)
    square = on * np.sign(np.sin(2.0 * np.pi * t / 4.0))
    sweep = np.sin(2.0 * np.pi * (0.2 * t + 0.5 * (1.5 - 0.2) / DURATION_S * t**2))
    return (
        Manoeuvre("coasting down from 25 m/s on a straight", 25.0, none, none),
        Manoeuvre("full acceleration from walking pace on a straight", 4.0, 2.5 * on, none),
        Manoeuvre("firm braking from 30 m/s on a straight", 30.0, -3.0 * on, none),
        Manoeuvre("steps of torque to and fro at 10 m/s", 10.0, 1.5 * square, none),
        Manoeuvre("step steers to and fro at 12 m/s", 12.0, none, 0.05 * square),
        Manoeuvre("step steers to and fro at 25 m/s", 25.0, none, 0.015 * square),
        Manoeuvre("a swept slalom at 15 m/s, 0.2 to 1.5 Hz", 15.0, none, 0.03 * sweep),
        Manoeuvre("a slowly tightening bend at 15 m/s", 15.0, none, 0.006 * np.maximum(t - 1, 0)),
        Manoeuvre("a circle at walking pace, lock to lock", 4.0, none, 0.35 * square),
    )


def most_discriminating_manoeuvre(
    base: FloatArray,
    actives: Sequence[ActiveEffect],
    which: int,
    rival: ActiveEffect,
    noise: FloatArray,
) -> Discriminability:
    """
    Return the manoeuvre that best tells effect `which` of a hypothesis from its rival.

    `base`: the stand-in's parameters; `noise` (6,) of a bin, by channel.
    """
    mine = parameters_with_effects(base, actives)
    others = [a for i, a in enumerate(actives) if i != which]
    theirs = parameters_with_effects(base, [*others, rival])
    larger = parameters_with_effects(base, [*others, _scaled(rival, 1.0 + _COMPETITOR_SIGMA)])
    mass, radius = base[INDEX["mass"]], base[INDEX["wheel_radius"]]
    best, name = -1.0, ""
    tried = manoeuvres()
    for manoeuvre in tried:
        torque = manoeuvre.acceleration_request * mass * radius
        first = _run(mine, manoeuvre, torque)
        difference = _run(theirs, manoeuvre, torque) - first
        columns = [_run(larger, manoeuvre, torque) - first - difference]
        for entry in TOLERANCE_PARAMETERS:
            changed = mine.copy()
            changed[INDEX[entry]] *= 1.0 + TOLERANCE_SIGMA
            columns.append(_run(changed, manoeuvre, torque) - first)
        scaled = np.stack([difference, *columns]) / noise[:, None]
        fair = np.isfinite(scaled).all(axis=(0, 1))
        left = scaled[0][:, fair].ravel()
        free = scaled[1:][:, :, fair].reshape(len(columns), -1).T
        taken = np.linalg.solve(free.T @ free + np.eye(free.shape[1]), free.T @ left)
        loss = 0.5 * float(left @ left - left @ free @ taken)
        if loss > best:
            best, name = loss, manoeuvre.text
    return Discriminability(
        actives[which].effect.name, rival.effect.name, name, max(best, 0.0), len(tried)
    )


def parameters_with_effects(base: FloatArray, actives: Sequence[ActiveEffect]) -> FloatArray:
    """Return the parameters with effects at work, wherever they were found."""
    p: FloatArray = base.copy()
    for active in actives:
        for parameter, inner in zip(active.effect.parameters, active.theta, strict=True):
            for i, amount in parameter.amounts(inner, base):
                p[i] += amount
    return p


def _scaled(active: ActiveEffect, share: float) -> ActiveEffect:
    inner = tuple(
        p.theta_neutral + share * (x - p.theta_neutral)
        for p, x in zip(active.effect.parameters, active.theta, strict=True)
    )
    return ActiveEffect(active.effect, inner, active.activation)


def _run(p: FloatArray, manoeuvre: Manoeuvre, torque: FloatArray) -> FloatArray:
    """Return a run's channels (6, bins), NaN where the car is all but standing."""
    n = torque.shape[0]
    at = STEP_S * np.arange(n, dtype=np.float64)
    torques, angles = (
        cumulative_command(at, values, COMMAND_GRID_S, DURATION_S)
        for values in (torque, manoeuvre.steering_request)
    )
    state = np.zeros(STATE_SIZE)
    state[S_V_X] = manoeuvre.speed
    state[[S_PLAY, S_STEER, S_STEER_MORE]] = p[INDEX["steer_gain"]] * manoeuvre.steering_request[0]
    out, none = np.empty((OUTPUTS, n)), np.empty(0, dtype=np.int64)
    integrate(
        p,
        none,
        np.empty(0),
        none,
        np.ones((1, n)),
        torques,
        angles,
        COMMAND_GRID_S,
        0.0,
        STEP_S,
        np.empty(0),
        np.full((n, 3), np.nan),
        np.zeros(3),
        np.empty((0, 3)),
        state,
        out,
        np.empty((0, 0)),
    )
    heard = out[list(_ROWS)]
    # As sensors would say it: a bias or a scale of theirs tells effects apart too.
    heard[0] += p[INDEX["bias_a_x"]]
    heard[1] += p[INDEX["bias_a_y"]]
    heard[2] = heard[2] * p[INDEX["gyro_gain"]] + p[INDEX["bias_gyro"]]
    heard[3] *= p[INDEX["odometry_gain"]]
    heard[:, out[V_X] < _MIN_SPEED] = np.nan
    heard[:, :_SETTLING_STEPS] = 0.0
    bins = n // _BIN_STEPS
    return np.asarray(heard[:, : bins * _BIN_STEPS].reshape(6, bins, _BIN_STEPS).mean(axis=2))
