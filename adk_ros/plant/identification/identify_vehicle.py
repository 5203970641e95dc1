# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Which vehicle drives like these records: the physics model's parameters by output errors.

From starts spread over the records the model is rolled out under the known commands, and what it
predicts some steps ahead is held against the measurement, e = (x_ref - x) / sigma. Minimised is

    sum over starts of mean over steps of sum over channels huber(e) + sum (p / usual)^2

by Levenberg-Marquardt over a handful of parameters p, zero at the given vehicle. `sigma` is the
error that is left, by step and channel, taken anew between rounds, so that each round weighs the
channels by what the model can explain; the pull to the given vehicle is as strong as one start's
evidence, and matters only for what the drive does not excite. Huber, because a few sliding starts
would decide everything.

Friction and stiffness are told apart as the tyre tells them: grip scales mu and divides B, so that
the slip stiffness B C D stays, and stiffness scales B alone. What no drive can tell apart is not
asked: wheel radius and torque (both scale what drives the mass).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from adk_ros.errors import DataError
from adk_ros.files.yaml_file import validate
from adk_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from adk_ros.plant.identification.vehicle_rollout import actuator_states, rollout
from adk_ros.plant.vehicle.vehicle_parameters import Constants, Tyre, Vehicle
from adk_ros.signals.channels import Record
from adk_ros.signals.score import scorable_rows

SPEED_MIN = 3.0
"""Starts slower than this, m/s, tell of the model's slip at standstill and not of the car."""

_MIN_STARTS = 50
_HUBER = 3.0
_RESOLVED = 2e-3
"""Errors below this share of the signal's own change are not worth explaining."""
_MAX_ITERATIONS = 10
_SETTLED = 3e-3
"""An iteration that gains less than this share of the cost is the last."""


@dataclass(frozen=True)
class VehicleParameter:
    """
    One direction in which a vehicle may be changed, zero at the given one.

    A factor multiplies each of `fields` (of `Constants`) by exp(p exponent), a shift adds
    p exponent. `usual` is how far off a data sheet usually is, `most` the bound of |p|.
    """

    name: str
    fields: dict[str, float]
    prior_sigma: float
    bound: float
    shift: bool = False

    def reported(self, p: float) -> float:
        """As a person reads it: the factor, or what is added."""
        return p if self.shift else math.exp(p)


def _grip(axle: str) -> dict[str, float]:
    return {f"mu_{axle}": 1.0, f"b_y_{axle}": -1.0, f"b_x_{axle}": -1.0}


DEFAULT_PARAMETERS = (
    VehicleParameter("mass", {"mass": 1.0}, 0.1, 0.5),
    VehicleParameter("yaw inertia", {"yaw_inertia": 1.0}, 0.2, 1.2),
    VehicleParameter(
        "centre of gravity",
        {"cg_to_front_axle": 1.0, "cg_to_rear_axle": -1.0},
        0.1,
        0.5,
        shift=True,
    ),
    VehicleParameter("height of the centre of gravity", {"cg_height": 1.0}, 0.15, 0.6),
    VehicleParameter("roll share front", {"roll_share_front": 1.0}, 0.1, 0.4, shift=True),
    VehicleParameter("load lag", {"load_lag": 1.0}, 0.05, 0.3, shift=True),
    VehicleParameter("grip front", _grip("f"), 0.15, 1.0),
    VehicleParameter("grip rear", _grip("r"), 0.15, 1.0),
    VehicleParameter("stiffness front", {"b_y_f": 1.0}, 0.2, 1.0),
    VehicleParameter("stiffness rear", {"b_y_r": 1.0}, 0.2, 1.0),
    VehicleParameter("shape front", {"c_y_f": 1.0, "b_y_f": -1.0}, 0.1, 0.3),
    VehicleParameter("shape rear", {"c_y_r": 1.0, "b_y_r": -1.0}, 0.1, 0.3),
    VehicleParameter(
        "relaxation length", {"relaxation_length_f": 1.0, "relaxation_length_r": 1.0}, 0.4, 1.5
    ),
    VehicleParameter(
        "load sensitivity",
        {"load_sensitivity_f": 1.0, "load_sensitivity_r": 1.0},
        0.05,
        0.2,
        shift=True,
    ),
    VehicleParameter("drag", {"cda": 1.0}, 0.2, 1.0),
    VehicleParameter("rolling resistance", {"crr": 1.0}, 0.005, 0.05, shift=True),
    VehicleParameter("steering lag", {"steer_lag": 1.0}, 0.03, 0.3, shift=True),
    VehicleParameter("torque lag", {"torque_lag": 1.0}, 0.03, 0.5, shift=True),
)
"""What a drive under known commands can tell of a car."""


@dataclass(frozen=True)
class IdentifiedVehicle:
    """
    The vehicle found, without a chassis, and how it differs.

    `changes` by parameter: a factor, or what is added (SI); `deviation` its standard deviation in
    the same terms (of the logarithm for a factor), as far as the errors were white; `at_bound`
    the parameters that stopped at their bounds. `cost_before`, `cost_after`: mean Huber loss of
    the whitened errors of the given and of the found vehicle, with the same weights.
    """

    vehicle: Vehicle
    changes: dict[str, float]
    cost_before: float
    cost_after: float
    deviation: dict[str, float] = field(default_factory=dict)
    at_bound: tuple[str, ...] = ()


def identify_vehicle(
    vehicle: Vehicle,
    records: Sequence[Record],
    *,
    parameters: Sequence[VehicleParameter] = DEFAULT_PARAMETERS,
    mu: float = 1.0,
    count: int = 400,
    ahead: int = 40,
) -> IdentifiedVehicle:
    """
    Identify `parameters` of `vehicle` on `records`, driven on a flat road of friction `mu`.

    `count` starts and `ahead` steps of 25 ms in the last rounds; a first round takes half of both,
    to come near from far off.

    :raises DataError: the records hold too few starts.
    """
    solver = _Solver(vehicle.constants(), tuple(parameters), mu)
    p = np.zeros(len(parameters))
    early = _Batch.of(records, max(count // 2, _MIN_STARTS), max(ahead // 2, 1))
    p = solver.minimise(early, solver.error_scale(early, p), p)
    batch = _Batch.of(records, count, ahead)
    for _ in range(2):
        sigma = solver.error_scale(batch, p)
        p = solver.minimise(batch, sigma, p)
    before, after = (solver.loss(batch, sigma, q) for q in (np.zeros_like(p), p))
    deviation = solver.deviation(batch, sigma, p)
    low, high = solver.bounds
    return IdentifiedVehicle(
        vehicle=_with(vehicle, solver.constants(p)),
        changes={q.name: q.reported(v) for q, v in zip(parameters, p.tolist(), strict=True)},
        cost_before=before,
        cost_after=after,
        deviation={q.name: float(d) for q, d in zip(parameters, deviation, strict=True)},
        at_bound=tuple(
            q.name for q, v, a, b in zip(parameters, p, low, high, strict=True) if not a < v < b
        ),
    )


def actuator_state_history(vehicle: Vehicle | Constants, record: Record) -> FloatArray:
    """
    Return what torque and angle have reached at each row of a record, (n, 2).

    As `actuator_states`, started afresh where the grid breaks or a command is unknown (NaN there).
    """
    c = vehicle.constants() if isinstance(vehicle, Vehicle) else vehicle
    out = np.full((len(record), 2), np.nan)
    known: BoolArray = np.asarray(np.isfinite(record.u).all(axis=1))
    breaks = (np.diff(record.episode) != 0) | (np.diff(known.astype(np.int64)) != 0)
    for part in np.split(np.arange(len(record)), np.flatnonzero(breaks) + 1):
        if known[part].any():
            out[part] = actuator_states(c, record.u[part])
    return out


@dataclass(frozen=True)
class _Batch:
    """Starts, their commands (n, ahead, 2), and what was measured `steps` ahead, (n, s, 3)."""

    records: Sequence[Record]
    rows: list[IntArray]
    steps: IntArray
    x0: FloatArray
    u: FloatArray
    truth: FloatArray

    @staticmethod
    def of(records: Sequence[Record], count: int, ahead: int) -> _Batch:
        found = [_fast_enough_rows(record, scorable_rows(record, 1, ahead)) for record in records]
        total = sum(i.size for i in found)
        if total < _MIN_STARTS:
            raise DataError(
                f"the vehicle cannot be tuned on {total} starts of {ahead * 0.025:g} s: give"
                f" records of at least {_MIN_STARTS} at more than {SPEED_MIN:g} m/s"
            )
        share = min(1.0, count / total)
        picks = [np.linspace(0, i.size - 1, round(i.size * share)) for i in found]
        rows = [i[pick.astype(np.int64)] for i, pick in zip(found, picks, strict=True)]
        chosen = [max(1, round(ahead * part)) for part in (0.05, 0.125, 0.25, 0.5, 0.75, 1.0)]
        steps = np.unique(chosen)
        both = list(zip(records, rows, strict=True))
        return _Batch(
            records=records,
            rows=rows,
            steps=steps,
            x0=np.concatenate([r.x[i] for r, i in both]),
            u=np.concatenate([r.u[i[:, None] + np.arange(ahead)] for r, i in both]),
            truth=np.concatenate([r.x_ref[i[:, None] + steps] for r, i in both]),
        )


def _fast_enough_rows(record: Record, rows: IntArray) -> IntArray:
    kept: IntArray = rows[record.x[rows, 0] > SPEED_MIN]
    return kept


class _Solver:
    """Levenberg-Marquardt in the parameters' own units, with bounds."""

    def __init__(
        self, given: Constants, parameters: tuple[VehicleParameter, ...], mu: float
    ) -> None:
        self._given = given
        self._parameters = parameters
        self._mu = mu
        self._usual = np.array([q.prior_sigma for q in parameters])
        self._reached: dict[tuple[float, ...], list[FloatArray]] = {}
        low = [-min([q.bound, *self._room(q)]) for q in parameters]
        self.bounds = np.array(low), np.array([q.bound for q in parameters])

    def _room(self, q: VehicleParameter) -> list[float]:
        """How far a shift may go down before a field, none of which is negative, is used up."""
        return [getattr(self._given, name) for name, e in q.fields.items() if q.shift and e > 0.0]

    def constants(self, p: FloatArray) -> Constants:
        """Return the vehicle's constants at `p`, each within what a vehicle file may hold."""
        values = self._given._asdict()
        for q, amount in zip(self._parameters, p.tolist(), strict=True):
            for name, exponent in q.fields.items():
                if q.shift:
                    values[name] += exponent * amount
                else:
                    values[name] *= math.exp(exponent * amount)
        for name in {name for q in self._parameters for name in q.fields}:
            low, high = _LIMITS[name]
            values[name] = min(max(values[name], low), high)
        return Constants(**values)

    def errors(self, batch: _Batch, p: FloatArray) -> FloatArray:
        """Measured less predicted, (n, s, 3), SI."""
        c = self.constants(p)
        key = (id(batch), c.torque_lag, c.steer_lag)
        if key not in self._reached:
            if len(self._reached) > 8:
                self._reached.clear()
            both = zip(batch.records, batch.rows, strict=True)
            self._reached[key] = [actuator_state_history(c, r)[i] for r, i in both]
        begun = np.concatenate(self._reached[key])
        predicted = rollout(c, batch.x0, batch.u, actuators=begun, mu=self._mu)
        return np.asarray(batch.truth - predicted[:, batch.steps - 1])

    def error_scale(self, batch: _Batch, p: FloatArray) -> FloatArray:
        """Usual error at `p`, by step and channel (s, 3), not below what is worth explaining."""
        error = self.errors(batch, p)
        change = np.sqrt(np.square(batch.truth - batch.x0[:, None]).mean(axis=0))
        typical = np.median(np.abs(error), axis=0) / 0.6745
        return np.asarray(np.maximum(np.maximum(typical, _RESOLVED * change), 1e-9))

    def loss(self, batch: _Batch, sigma: FloatArray, p: FloatArray) -> float:
        """Mean Huber loss of the whitened errors."""
        return float(_huber(self.errors(batch, p) / sigma).mean())

    def _cost(self, e: FloatArray, p: FloatArray) -> float:
        return float(_huber(e).sum() / e.shape[1] + np.square(p / self._usual).sum())

    def minimise(self, batch: _Batch, sigma: FloatArray, p: FloatArray) -> FloatArray:
        """Return the parameters of least cost near `p`."""
        low, high = self.bounds
        damping = 1e-3
        e = self.errors(batch, p) / sigma
        cost = self._cost(e, p)
        for _ in range(_MAX_ITERATIONS):
            gram, slope = self._normal(batch, sigma, p, e)
            tried = cost
            while damping < 1e6:
                free = ~((p <= low) & (slope > 0.0)) & ~((p >= high) & (slope < 0.0))
                damped = gram + damping * np.diag(np.diag(gram))
                step = np.zeros_like(p)
                step[free] = -np.linalg.solve(damped[np.ix_(free, free)], slope[free])
                there = np.clip(p + step, low, high)
                e_there = self.errors(batch, there) / sigma
                tried = self._cost(e_there, there)
                if tried < cost:
                    break
                damping = max(damping * 8.0, 1e-3)
            if not tried < cost:
                return p
            gained = cost - tried
            p, e, cost = there, e_there, tried
            damping *= 0.2
            if gained < _SETTLED * cost:
                return p
        return p

    def _normal(
        self, batch: _Batch, sigma: FloatArray, p: FloatArray, e: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Half the Hessian (Gauss-Newton) and half the gradient of the cost, the pull included."""
        weight = np.minimum(1.0, _HUBER / np.maximum(np.abs(e), 1e-12)) / e.shape[1]
        jacobian = np.zeros((p.size, e.size))
        for i in range(p.size):
            # A lag shorter than the model's step acts like none: what is flat is tried further.
            for share in (0.02, 1.0):
                jacobian[i] = self._slope(batch, sigma, p, e, i, share * self._usual[i])
                if jacobian[i].any():
                    break
        weighted = jacobian * weight.ravel()
        pull = 1.0 / np.square(self._usual)
        return weighted @ jacobian.T + np.diag(pull), weighted @ e.ravel() + pull * p

    def _slope(
        self, batch: _Batch, sigma: FloatArray, p: FloatArray, e: FloatArray, i: int, delta: float
    ) -> FloatArray:
        """Change of the errors per change of one parameter: forwards, at the bound backwards."""
        delta = delta if p[i] + delta <= self.bounds[1][i] else -delta
        moved = p.copy()
        moved[i] += delta
        return np.ravel((self.errors(batch, moved) / sigma - e) / delta)

    def deviation(self, batch: _Batch, sigma: FloatArray, p: FloatArray) -> FloatArray:
        """Standard deviation of each parameter."""
        gram, _ = self._normal(batch, sigma, p, self.errors(batch, p) / sigma)
        return np.sqrt(np.diag(np.linalg.inv(gram)))


def _huber(e: FloatArray) -> FloatArray:
    size = np.abs(e)
    return np.where(size <= _HUBER, size**2, 2.0 * _HUBER * size - _HUBER**2)


def _range(info: Any) -> tuple[float, float]:
    """What a field of a vehicle file may hold."""
    rules = [(key, getattr(rule, key, None)) for rule in info.metadata for key in ("ge", "le")]
    low = [float(value) for key, value in rules if key == "ge" and value is not None]
    high = [float(value) for key, value in rules if key == "le" and value is not None]
    return max(low, default=-math.inf), min(high, default=math.inf)


_LIMITS = {name: _range(info) for name, info in Vehicle.model_fields.items()} | {
    f"{name}_{axle}": _range(info) for name, info in Tyre.model_fields.items() for axle in "fr"
}


def _with(vehicle: Vehicle, c: Constants) -> Vehicle:
    """Return `vehicle` with the constants' values; a chassis would contradict them."""
    content = vehicle.model_dump(exclude={"chassis"})
    for name, value in c._asdict().items():
        if name in content:
            content[name] = value
    for axle in ("front", "rear"):
        tyre = content[f"{axle}_tyre"]
        tyre.update({name: getattr(c, f"{name}_{axle[0]}", tyre[name]) for name in tyre})
    return validate(f"{vehicle.name}, tuned", content, Vehicle)
