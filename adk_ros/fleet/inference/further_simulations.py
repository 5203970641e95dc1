# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What the surrogate's error resembles on roads of the fleet, by further drives of the simulation.

The surrogate is identified on one road. On others it errs in a way that is the same for all cars,
and seems an effect of them (`shared_error`). In further drives of the simulation nothing acts:
what they say about tolerances, offsets and effects is that error. It is the joint vector

    x = (H + P)^-1 s,     P = diag(1 / sigma^2),

with their score s, their information H, and as sigma the prior deviations of nuisance parameters
and the usual size of the error of each effect. The effects of a fleet count from it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import stdtrit

from adk_ros.errors import DataError
from adk_ros.fleet.inference.evidence import Columns, SimulationError, effect_columns
from adk_ros.fleet.inference.fleet_model import nuisance_prior
from adk_ros.fleet.inference.linearisation import dispersion, linearised
from adk_ros.fleet.inference.shared_error import FLEETS, shared_error
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.library.criteria import FAMILYWISE_ERROR_RATE
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.mismatch.surrogate.residuals import prepare_residual_problem
from adk_ros.numerics.arrays import FloatArray


class DifferentCar(DataError):
    """Further drives of a simulation that are not of the simulated car."""


def error_on(
    logs: Sequence[SensorLog], surrogate: SurrogateModel, columns: Columns, noise: FloatArray
) -> SimulationError:
    """
    Return what the surrogate's error resembles in drives of the simulation.

    `noise` (6,): of a sample of a recording of the fleet, by channel.

    :raises DataError: a drive is too short.
    :raises DifferentCar: the drives are not of the simulated car.
    """
    d = columns.size
    score, information = np.zeros(d), np.zeros((d, d))
    for log in logs:
        likelihood = Likelihood.of(prepare_residual_problem(log, noise), surrogate)
        linear = linearised(likelihood, columns, effect_columns(likelihood.effects))
        over = dispersion(linear, columns)
        score += linear.score / over
        information += linear.information / over
    usual = np.array([shared_error(key) for key in columns.effects])
    prior = np.concatenate([nuisance_prior(columns), 1.0 / usual**2])
    response = np.linalg.inv(information + np.diag(prior))
    # The simulation's sensors may be noisy as well; those of most simulators are not.
    share = float(np.mean([np.mean((log.noise() / noise) ** 2) for log in logs]))
    _check_same_car(logs, columns, score, information, share)
    return SimulationError(
        response @ score, share * np.diag(response @ information @ response), len(logs)
    )


def _check_same_car(
    logs: Sequence[SensorLog],
    columns: Columns,
    score: FloatArray,
    information: FloatArray,
    share: float,
) -> None:
    """
    Raise an error if an effect, fitted alone, is beyond what the surrogate's error feigns.

    Beyond what chance exceeds in `criteria.FAMILYWISE_ERROR_RATE` of simulations in any parameter,
    by Student's t with the degrees of freedom of that error.
    """
    k = columns.first_effect
    inner = information[:k, :k] + np.diag(nuisance_prior(columns))
    gain = np.linalg.solve(inner, information[:k, k:])
    scores = score[k:] - gain.T @ score[:k]
    alone = np.diag(information)[k:] - (gain * information[:k, k:]).sum(axis=0)
    tests = len(columns.effects)
    most = float(-stdtrit(FLEETS - 1, 0.5 * FAMILYWISE_ERROR_RATE / tests))
    found = {
        key: (s / h, float(np.sqrt(shared_error(key) ** 2 + share / h)))
        for key, s, h in zip(columns.effects, scores, alone, strict=True)
        if h > 0.0
    }
    if not found:
        return
    key, (size, usual) = max(found.items(), key=lambda one: abs(one[1][0]) / one[1][1])
    if abs(size) > most * usual:
        names = ", ".join(log.name for log in logs)
        column = columns.column(key)
        raise DifferentCar(
            f"{names}: differs from the simulation, most clearly like {column.effect.name} "
            f"({column.parameter.name} {size * column.materiality:+.3g}): give drives of the same "
            "simulated car as --further-simulation, on other roads"
        )
