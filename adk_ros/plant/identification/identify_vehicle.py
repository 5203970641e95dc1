# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Identify vehicle parameters from records by output error.

The physics model is rolled out under the recorded commands from starts spread over the records.
Predictions some steps ahead are compared with the measurement, e = (x_ref - x) / sigma, and

    sum over starts of mean over steps of sum over channels huber(e) + sum (p / prior_sigma)^2

is minimised by Levenberg-Marquardt over the parameters p, which are zero at the given vehicle.
`sigma` is the remaining error by step and channel, estimated anew between rounds, so that each
round weights the channels by what the model can explain. The prior weighs as much as one start; it
matters only for parameters that the record does not excite. The Huber loss limits the influence of
a few starts in which the tyres slide.

Grip and stiffness are separate: grip scales mu and divides B, so that the slip stiffness B C D is
unchanged; stiffness scales B only. Wheel radius and torque gain are indistinguishable, since both
scale the driving force; neither is identified.
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
from adk_ros.numerics.levenberg_marquardt import (
    BoundedParameters,
    DampingSchedule,
    FitOptions,
    Linearisation,
    derivative_by_difference,
    huber_values,
    linearise_dense,
    minimise,
)
from adk_ros.plant.identification.vehicle_rollout import actuator_states, rollout
from adk_ros.plant.vehicle.vehicle_parameters import Constants, Tyre, Vehicle
from adk_ros.signals.channels import Record
from adk_ros.signals.score import scorable_rows

SPEED_MIN = 3.0
"""m/s. Slower starts are left out: there the model's slip is not that of a vehicle. Empirical."""

_MIN_STARTS = 50
"""Fewest starts for 18 parameters. Empirical."""
_MIN_ERROR_SHARE = 2e-3
"""Errors below this share of the signal's change have no influence. Empirical."""
_DIFFERENCE_SHARE = 0.02
"""Step of the finite differences over the prior's standard deviation."""
_FIT = FitOptions(
    iterations=10,
    relative_tolerance=3e-3,
    absolute_tolerance=0.0,
    huber_threshold=3.0,
    damping=DampingSchedule(initial=1e-3, increase=8.0, decrease=0.2, minimum=0.0, trials=10),
)
"""
More damping than the default: the data sheet may be far off, and the first steps leave the range
in which the errors are linear. Huber threshold: few starts slide, and would otherwise dominate.
"""


@dataclass(frozen=True)
class VehicleParameter:
    """
    A parameter p of a vehicle, zero at the given vehicle.

    A factor multiplies each of `fields` (of `Constants`) by exp(p exponent), a shift adds
    p exponent. `prior_sigma`: standard deviation of the data sheet's error. `bound`: bound of |p|.
    """

    name: str
    fields: dict[str, float]
    prior_sigma: float
    bound: float
    shift: bool = False

    def reported(self, p: float) -> float:
        """Return the value to report: the factor, or the added amount."""
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
"""Parameters that a recording with commands can identify; priors and bounds are empirical."""


@dataclass(frozen=True)
class IdentifiedVehicle:
    """
    Result of an identification: the vehicle, without a chassis, and its changes.

    `changes` by parameter: a factor, or the added amount (SI). `deviation`: standard deviation of
    the same (of the logarithm for a factor), if the errors are white. `at_bound`: parameters at
    their bounds. `cost_before`, `cost_after`: mean Huber loss of the whitened errors of the given
    and of the identified vehicle, with the same weights.
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
    Identify `parameters` of `vehicle` from `records` of a flat road with friction `mu`.

    The last rounds use `count` starts and `ahead` steps of 25 ms, a first round half of both,
    which converges from farther away.

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


def actuator_state_history(
    vehicle: Vehicle | Constants, record: Record, commands: FloatArray | None = None
) -> FloatArray:
    """
    Return the actual torque and road-wheel angle at each row of a record, (n, 2).

    `commands` (n, 2), by default `record.u`. In a gap (NaN) the last command is held, as the
    vehicle does. Each episode starts afresh; rows before its first command are NaN.
    """
    u = record.u if commands is None else commands
    c = vehicle.constants() if isinstance(vehicle, Vehicle) else vehicle
    out = np.full((len(record), 2), np.nan)
    known: BoolArray = np.asarray(np.isfinite(u).all(axis=1))
    for episode in np.unique(record.episode):
        rows = np.flatnonzero(record.episode == episode)
        last_known = np.maximum.accumulate(np.where(known[rows], np.arange(rows.size), -1))
        commanded = last_known >= 0
        out[rows[commanded]] = actuator_states(c, u[rows[last_known[commanded]]])
    return out


@dataclass(frozen=True)
class _Batch:
    """Starts, their commands (n, ahead, 2), and the measurements `steps` later, (n, s, 3)."""

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
                f"the vehicle cannot be identified from {total} starts of {ahead * 0.025:g} s:"
                f" give records of at least {_MIN_STARTS} at more than {SPEED_MIN:g} m/s"
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
    """The fit of one vehicle: constants at p, errors, scale, minimisation."""

    def __init__(
        self, given: Constants, parameters: tuple[VehicleParameter, ...], mu: float
    ) -> None:
        self._given = given
        self._parameters = parameters
        self._mu = mu
        self._prior_sigma = np.array([q.prior_sigma for q in parameters])
        self._actuator_states: dict[tuple[float, ...], list[FloatArray]] = {}
        low = [-min([q.bound, *self._room(q)]) for q in parameters]
        self.bounds = np.array(low), np.array([q.bound for q in parameters])

    def _room(self, q: VehicleParameter) -> list[float]:
        """Return how far a shift may go down before a field becomes negative."""
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
        """Return measured minus predicted states (n, s, 3), SI."""
        c = self.constants(p)
        key = (id(batch), c.torque_lag, c.steer_lag)
        if key not in self._actuator_states:
            if len(self._actuator_states) > 8:
                self._actuator_states.clear()
            both = zip(batch.records, batch.rows, strict=True)
            self._actuator_states[key] = [actuator_state_history(c, r)[i] for r, i in both]
        actuators = np.concatenate(self._actuator_states[key])
        predicted = rollout(c, batch.x0, batch.u, actuators=actuators, mu=self._mu)
        return np.asarray(batch.truth - predicted[:, batch.steps - 1])

    def error_scale(self, batch: _Batch, p: FloatArray) -> FloatArray:
        """Return the robust standard deviation of the errors at `p` (s, 3), with a lower limit."""
        error = self.errors(batch, p)
        change = np.sqrt(np.square(batch.truth - batch.x0[:, None]).mean(axis=0))
        typical = np.median(np.abs(error), axis=0) / 0.6745
        return np.asarray(np.maximum(np.maximum(typical, _MIN_ERROR_SHARE * change), 1e-9))

    def loss(self, batch: _Batch, sigma: FloatArray, p: FloatArray) -> float:
        """Return the mean Huber loss of the whitened errors."""
        return float(huber_values(self.errors(batch, p) / sigma, _FIT.huber_threshold).mean())

    def minimise(self, batch: _Batch, sigma: FloatArray, p: FloatArray) -> FloatArray:
        """Return the parameters of least cost near `p`."""

        def linearise(q: FloatArray, e: FloatArray) -> Linearisation:
            return linearise_dense(self._jacobian(batch, sigma, q, e), e, _FIT.huber_threshold)

        return minimise(
            lambda q: self._whitened(batch, sigma, q),
            self._bounded_parameters(batch, p),
            _FIT,
            linearise=linearise,
        ).x

    def _whitened(self, batch: _Batch, sigma: FloatArray, p: FloatArray) -> FloatArray:
        """Return the errors over `sigma` as one vector (n s 3,)."""
        return np.ravel(self.errors(batch, p) / sigma)

    def _bounded_parameters(self, batch: _Batch, p: FloatArray) -> BoundedParameters:
        """Return start, bounds and prior of a fit whose loss is summed over a start's steps."""
        # The cost takes the mean over the steps: the prior counts once per step of the sum.
        deviation = self._prior_sigma / math.sqrt(batch.steps.size)
        step = _DIFFERENCE_SHARE * self._prior_sigma
        return BoundedParameters(p, *self.bounds, step, np.zeros_like(p), deviation)

    def _jacobian(
        self, batch: _Batch, sigma: FloatArray, p: FloatArray, e: FloatArray
    ) -> FloatArray:
        """Return the derivatives (m, n) of the whitened errors, by differences."""
        columns = []
        for j, (sigma_p, high) in enumerate(zip(self._prior_sigma, self.bounds[1], strict=True)):
            # A lag shorter than the integration step has no influence: a wide difference finds it.
            for share in (_DIFFERENCE_SHARE, 1.0):
                column = derivative_by_difference(
                    lambda q: self._whitened(batch, sigma, q), p, e, j, share * sigma_p, high
                )
                if column.any():
                    break
            columns.append(column)
        return np.column_stack(columns)

    def deviation(self, batch: _Batch, sigma: FloatArray, p: FloatArray) -> FloatArray:
        """Return the standard deviation of each parameter."""
        e = self._whitened(batch, sigma, p)
        data = linearise_dense(self._jacobian(batch, sigma, p, e), e, _FIT.huber_threshold)
        precision = self._bounded_parameters(batch, p).prior_precision()
        covariance = np.linalg.inv((data.normal + precision) / batch.steps.size)
        return np.sqrt(np.diag(covariance))


def _range(info: Any) -> tuple[float, float]:
    """Return the limits of a field of a vehicle file."""
    rules = [(key, getattr(rule, key, None)) for rule in info.metadata for key in ("ge", "le")]
    low = [float(value) for key, value in rules if key == "ge" and value is not None]
    high = [float(value) for key, value in rules if key == "le" and value is not None]
    return max(low, default=-math.inf), min(high, default=math.inf)


_LIMITS = {name: _range(info) for name, info in Vehicle.model_fields.items()} | {
    f"{name}_{axle}": _range(info) for name, info in Tyre.model_fields.items() for axle in "fr"
}


def _with(vehicle: Vehicle, c: Constants) -> Vehicle:
    """Return `vehicle` with the values of `c`; without a chassis, which could contradict them."""
    content = vehicle.model_dump(exclude={"chassis"})
    for name, value in c._asdict().items():
        if name in content:
            content[name] = value
    for axle in ("front", "rear"):
        tyre = content[f"{axle}_tyre"]
        tyre.update({name: getattr(c, f"{name}_{axle[0]}", tyre[name]) for name in tyre})
    return validate(f"{vehicle.name}, tuned", content, Vehicle)
