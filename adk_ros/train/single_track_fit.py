# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Identify the single-track model of the lifting from training data.

Output error: rollouts of 0.5 s from many rows, compared with the reference at four horizons in
units of the error of persistence, by non-linear least squares. Weak priors, those of road cars by
the wheelbase that the yaw rate implies at small slip, hold what the data leave open, such as the
grip of tyres that never slid.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from adk_ros.model.lifting.encoder import input_size
from adk_ros.model.lifting.scaling import Scaling
from adk_ros.model.lifting.single_track import (
    BLEND,
    RANGE_SOFTNESS,
    SingleTrackParameters,
    single_track_change,
)
from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.numerics.constants import GRAVITY
from adk_ros.numerics.numba_cache import strict_kernel
from adk_ros.signals.score import TICK_S
from adk_ros.train.dataset import Sequences

_ROWS = 1500
"""Starts of rollouts, about 3 s of computing. By choice."""
_SCORED = (2, 5, 10, 20)
"""Steps of a rollout that are compared, as spread as the scored horizons up to 0.5 s."""
_PRIOR_ROWS = 1.5
"""Weight of the priors, in rows: they decide nothing that the data show."""
_LIMIT = 50.0
"""Largest error that counts, in units of persistence: a diverging rollout says no more."""
_POSITIVE = (
    "front", "rear", "front_stiffness", "rear_stiffness", "front_friction", "rear_friction",
    "yaw_ratio", "drive", "torque_lag", "steering_lag", "drag", "transfer",
)  # fmt: skip
_SIGNED = ("rolling",)
_SPREAD = {
    "front": 0.3, "rear": 0.3, "front_stiffness": 0.7, "rear_stiffness": 0.7,
    "front_friction": 0.3, "rear_friction": 0.3, "yaw_ratio": 0.3, "drive": 1.0,
    "torque_lag": 1.0, "steering_lag": 1.0, "rolling": 0.2, "drag": 1.0, "transfer": 0.7,
}  # fmt: skip
"""
Standard deviations of the priors; of the positive ones, of their logarithm. By choice: road cars
and tyres differ by as much.
"""
_MIN_WIDTH = 1e-6
"""Smallest width of a range, SI: a constant quantity must not be divided by zero."""
_MIN_RELATIVE_WIDTH = 1e-4
"""
Smallest width of a range relative to its ends: float32 rounds a quantity by 1e-7, and its distance
from the range counts in tenths of the width.
"""
_MIN_CHANGE = 1e-6
"""In standard deviations, as in `network_fit`."""
_CENTRAL = (0.1, 99.9)
"""Percentiles of the training data within which learned features count in full."""


@dataclass(frozen=True)
class SingleTrack:
    """
    A single-track model for an encoder: `car` (24,), `command_filter` (n, 2), `limits` (3, 6).

    Stored as float32; see `EncoderArrays`. `parameters`: the identified ones.
    """

    car: NDArray[np.float32]
    command_filter: NDArray[np.float32]
    limits: NDArray[np.float32]
    parameters: SingleTrackParameters
    lags: tuple[float, float]

    def as_json(self) -> dict[str, float]:
        """Return the parameters and the lags, s, for the manifest of a model."""
        of_lags = {"torque_lag": self.lags[0], "steering_lag": self.lags[1]}
        return {k: float(f"{v:.6g}") for k, v in (self.parameters._asdict() | of_lags).items()}

    def with_quadratic(self, quadratic: bool) -> SingleTrack:
        """Return one that leaves the trained range to quadratic features, or does not."""
        car = self.car.copy()
        car[BLEND] = float(quadratic)
        return replace(self, car=car)


def lag_weights(lag: float, past: int) -> FloatArray:
    """
    Return the weights (past + 1,) of the present and past commands in the mean over a tick.

    Of a first-order lag, whose tail beyond the past counts to the oldest command.
    """
    decay = math.exp(-TICK_S / lag)
    mean = lag / TICK_S * (1.0 - decay)
    weights = np.empty(past + 1)
    weights[0] = 1.0 - mean
    weights[1:] = mean * (1.0 - decay) * decay ** np.arange(past)
    weights[-1] += 1.0 - weights.sum()
    return weights


def filtered_commands(u: FloatArray, lags: tuple[float, float], past: int) -> FloatArray:
    """Return commands (n, 2) behind first-order lags, s; NaN in the first `past` rows."""
    out = np.full_like(u, np.nan)
    for c in range(2):
        weights = lag_weights(lags[c], past)
        out[past:, c] = np.convolve(u[:, c], weights, mode="valid")
    return out


@strict_kernel
def _roll_out(
    x: FloatArray, u: FloatArray, rows: IntArray, ahead: int, car: FloatArray
) -> FloatArray:
    """Return states (m, ahead, 3) from `rows` of x (n, 3) on, under filtered commands (n, 2)."""
    out = np.empty((rows.size, ahead, 3))
    for k in range(rows.size):
        row = rows[k]
        v_x, v_y, rate = x[row, 0], x[row, 1], x[row, 2]
        for i in range(ahead):
            c = single_track_change(v_x, v_y, rate, u[row + i, 0], u[row + i, 1], car)
            v_x, v_y, rate = v_x + c[0], v_y + c[1], rate + c[2]
            out[k, i, 0], out[k, i, 1], out[k, i, 2] = v_x, v_y, rate
    return out


def fit_single_track(part: Sequences, scaling: Scaling) -> SingleTrack | None:
    """Return the single-track model of a part of the data; None without past samples."""
    if part.history < 1:
        return None
    rows = _spread_rows(part)
    scored = [step - 1 for step in _SCORED if step <= part.ahead]
    if not scored:
        return None
    ahead = scored[-1] + 1
    start = part.x[rows]
    reference = part.x_ref[rows[:, None] + 1 + np.arange(ahead)]
    change = np.sqrt(np.nanmean((reference - start[:, None]) ** 2, axis=0))
    # A channel that never changes is not measured.
    unit = np.where(change > _MIN_CHANGE * scaling.x_scale, change, np.inf)
    first = _first_guess(part)
    spread = np.array([_SPREAD[name] for name in (*_POSITIVE, *_SIGNED)])
    begin = _packed(first)
    weight = np.sqrt(_PRIOR_ROWS) / spread

    def residuals(values: FloatArray) -> FloatArray:
        parameters, lags = _unpacked(values)
        car = np.array(parameters)
        states = _roll_out(part.x, filtered_commands(part.u, lags, part.history), rows, ahead, car)
        error = np.where(np.isfinite(unit), (states - reference) / unit, 0.0)[:, scored]
        error = np.clip(np.nan_to_num(error, nan=_LIMIT, posinf=_LIMIT), -_LIMIT, _LIMIT)
        return np.concatenate([error.ravel(), weight * (values - begin)])

    with np.errstate(over="ignore", invalid="ignore"):
        found = least_squares(residuals, begin, x_scale=spread, max_nfev=40).x
    parameters, lags = _unpacked(found)
    commands = filtered_commands(part.u, lags, part.history)
    limits = trained_limits(parameters, part.x[part.rows], commands[part.rows])
    return single_track_arrays(parameters, lags, limits, scaling, part.history)


def _spread_rows(part: Sequences) -> IntArray:
    """Return at most `_ROWS` rows of a part, evenly spread."""
    chosen = np.linspace(0, part.rows.size - 1, min(_ROWS, part.rows.size)).astype(int)
    return np.asarray(part.rows[chosen])


def _first_guess(part: Sequences) -> dict[str, float]:
    v_x, _, rate = part.x[part.rows].T
    torque, delta = part.u[part.rows].T
    turning = float(np.sum(v_x * delta * rate))
    length = float(np.sum((v_x * delta) ** 2)) / turning if turning > 0.0 else 2.7
    length = min(max(length, 0.1), 10.0)
    change = (part.x_ref[part.rows + 1, 0] - part.x[part.rows, 0]) / TICK_S
    known = np.isfinite(change)
    centred = torque[known] - torque[known].mean()
    power = float(np.sum(centred**2))
    drive = float(np.sum(centred * change[known])) / power if power > 0.0 else 0.0
    return {
        "front": 0.5 * length, "rear": 0.5 * length, "front_stiffness": 12.0,
        "rear_stiffness": 12.0, "front_friction": 0.9, "rear_friction": 0.9, "yaw_ratio": 1.0,
        "drive": max(drive, 1e-6), "torque_lag": 0.03, "steering_lag": 0.03, "rolling": 0.1,
        "drag": 3e-4, "transfer": 0.2,
    }  # fmt: skip


def _packed(values: dict[str, float]) -> FloatArray:
    return np.array([math.log(values[n]) for n in _POSITIVE] + [values[n] for n in _SIGNED])


def _unpacked(values: FloatArray) -> tuple[SingleTrackParameters, tuple[float, float]]:
    bounded = np.clip(values[: len(_POSITIVE)], -20.0, 20.0)
    of = dict(zip(_POSITIVE, np.exp(bounded).tolist(), strict=True))
    of |= dict(zip(_SIGNED, values[len(_POSITIVE) :].tolist(), strict=True))
    front, rear = of["front"], of["rear"]
    yaw = 1.0 / (of["yaw_ratio"] * front * rear)
    length = front + rear
    per_speed = GRAVITY / length * (of["front_stiffness"] * rear + of["rear_stiffness"] * front)
    turning = (
        GRAVITY
        / length
        * yaw
        * front
        * rear
        * (of["front_stiffness"] * front + of["rear_stiffness"] * rear)
    )
    parameters = SingleTrackParameters(
        front,
        rear,
        of["front_stiffness"],
        of["rear_stiffness"],
        of["front_friction"],
        of["rear_friction"],
        yaw,
        of["drive"],
        of["rolling"],
        of["drag"],
        of["transfer"],
        # The midpoint rule is stable up to rate times step = 2; 1 is also accurate.
        TICK_S * max(per_speed, turning),
    )
    return parameters, (min(of["torque_lag"], 1.0), min(of["steering_lag"], 1.0))


def trained_limits(parameters: SingleTrackParameters, x: FloatArray, u: FloatArray) -> FloatArray:
    """
    Return the limits (3, 6) of states (n, 3) and filtered commands (n, 2).

    Lowest, highest, and 1 / softness, of speed, torque, steering, slip angles and lateral
    acceleration.
    """
    speed = np.maximum(np.abs(x[:, 0]), parameters.slowest)
    quantities = np.column_stack(
        [
            x[:, 0],
            u,
            (x[:, 0] * u[:, 1] - x[:, 1] - parameters.front * x[:, 2]) / speed,
            (parameters.rear * x[:, 2] - x[:, 1]) / speed,
            x[:, 0] * x[:, 2],
        ]
    )
    low, high = np.nanpercentile(quantities, _CENTRAL, axis=0)
    least = np.maximum(_MIN_WIDTH, _MIN_RELATIVE_WIDTH * np.maximum(np.abs(low), np.abs(high)))
    width = np.maximum(high - low, least)
    return np.stack([low, high, 1.0 / (RANGE_SOFTNESS * width)])


def single_track_arrays(
    parameters: SingleTrackParameters,
    lags: tuple[float, float],
    limits: FloatArray,
    scaling: Scaling,
    history: int,
) -> SingleTrack:
    """Return the model for an encoder with `history` past samples."""
    car = np.concatenate(
        [
            np.array(parameters),
            1.0 / (scaling.x_scale * scaling.step_scale),
            scaling.x_mean,
            scaling.x_scale,
            scaling.u_mean,
            [0.0],
        ]
    )
    command_filter = np.zeros((input_size(history), 2))
    for c in range(2):
        columns = 3 * (history + 1) + 2 * np.arange(history + 1) + c
        command_filter[columns, c] = lag_weights(lags[c], history) * scaling.u_scale[c]
    return SingleTrack(
        car.astype(np.float32),
        command_filter.astype(np.float32),
        limits.astype(np.float32),
        parameters,
        lags,
    )
