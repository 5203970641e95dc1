# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Table of detectable sizes: effects of the catalogue against minutes of driving."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from adk_ros.mismatch.inference.detectability import (
    MATERIALITY,
    NOISE,
    POWER,
    SURROGATE,
    TOLERANCE,
    Drive,
    NoiseModel,
)
from adk_ros.mismatch.inference.hypothesis import ActiveEffect
from adk_ros.mismatch.library.effect import ALWAYS, Effect, EffectParameter
from adk_ros.mismatch.surrogate.activation import ALWAYS_ACTIVE, Activation
from adk_ros.mismatch.surrogate.lap import Lap
from adk_ros.numerics.arrays import FloatArray

MINUTES = (2.0, 5.0, 10.0, 30.0)
PLACE_SHARE = 0.25
"""Share of the lap on which a local effect is assumed to act, where it cannot act everywhere."""
_SIZES = 9
_SMALLEST = 0.25
"""Smallest size that is tried, in materiality thresholds; smaller ones are never reported."""


@dataclass(frozen=True)
class DetectableSize:
    """
    Smallest detectable size of one parameter of an effect, in `unit`, after `minutes`.

    `size`: difference from neutral, NaN if no size within the bounds is detectable; of a parameter
    that enters by its inverse, the largest detectable value. `alone`: the size by contribution,
    each alone; `limit`: the contribution that alone demands the largest effect.
    """

    effect: str
    parameter: str
    unit: str
    minutes: float
    size: float
    limit: str
    alone: Mapping[str, float]


@dataclass(frozen=True)
class _Curve:
    """Differences from neutral (s,) of one parameter, with the columns (m, s) of a noise model."""

    theta: FloatArray
    active: list[ActiveEffect]
    columns: dict[str, FloatArray]


def detectable_sizes(
    drive: Drive,
    minutes: Sequence[float] = MINUTES,
    unobservable: frozenset[str] = frozenset(),
    progress: Callable[[float, float], None] | None = None,
) -> list[DetectableSize]:
    """Return the detectable sizes of all effects that the channels show, by effect and time."""
    effects = [
        effect
        for effect in drive.full.likelihood.effects.values()
        if effect.name not in unobservable and (ALWAYS in effect.activations or drive.lap)
    ]
    models = {"": drive.full, **drive.partial}
    curves: dict[tuple[str, str], _Curve] = {}
    for done, effect in enumerate(effects):
        if progress is not None:
            progress(done, len(effects))
        for j, parameter in enumerate(effect.parameters):
            curves[effect.name, parameter.name] = _curve(drive, models, effect, j)
    out = []
    for (name, parameter_name), curve in curves.items():
        known = drive.full.likelihood.effects[name].parameters
        parameter = next(p for p in known if p.name == parameter_name)
        for time in minutes:
            out.append(_detectable(drive, models, (name, parameter), curve, time))
    return out


def assumed_activation(effect: Effect, lap: Lap | None) -> Activation:
    """Return how an effect is assumed to act: always, or on a quarter of the lap."""
    if ALWAYS in effect.activations or lap is None:
        return ALWAYS_ACTIVE
    begin = 0.5 * (1.0 - PLACE_SHARE) * lap.length
    segment = (begin, begin + PLACE_SHARE * lap.length)
    return Activation(segments=(segment,), lap_length=lap.length, distance=lap.distance)


def active_effect(effect: Effect, values: Mapping[str, float], lap: Lap | None) -> ActiveEffect:
    """Return an effect with the given parameter values, in their units; others are neutral."""
    theta = tuple(
        p.theta(values[p.name]) if p.name in values else p.theta_neutral for p in effect.parameters
    )
    return ActiveEffect(effect, theta, assumed_activation(effect, lap))


def _curve(drive: Drive, models: Mapping[str, NoiseModel], effect: Effect, j: int) -> _Curve:
    parameter = effect.parameters[j]
    sizes = _sizes(parameter)
    activation = assumed_activation(effect, drive.lap)
    active = []
    for size in sizes:
        theta = [p.theta_neutral for p in effect.parameters]
        theta[j] += float(size)
        active.append(ActiveEffect(effect, tuple(theta), activation))
    found = [drive.columns(list(models.values()), each) for each in active]
    columns = {name: np.column_stack([f[i] for f in found]) for i, name in enumerate(models)}
    return _Curve(np.abs(sizes), active, columns)


def _sizes(parameter: EffectParameter) -> FloatArray:
    """Return the differences from neutral that are tried, in the direction with more room."""
    low, high = parameter.bounds()
    room = (high - parameter.theta_neutral, low - parameter.theta_neutral)
    end = max(room, key=abs)
    if parameter.inverse:
        # A limit acts from the size on at which the drive reaches it.
        least = 1.0 / parameter.materiality_threshold
    else:
        least = _SMALLEST * parameter.materiality_threshold
    return np.asarray(np.sign(end) * np.geomspace(least, abs(end), _SIZES))


def _detectable(
    drive: Drive,
    models: Mapping[str, NoiseModel],
    of: tuple[str, EffectParameter],
    curve: _Curve,
    minutes: float,
) -> DetectableSize:
    name, parameter = of
    sizes = {key: _smallest(drive, key, model, curve, minutes) for key, model in models.items()}
    size = sizes.pop("")
    if parameter.inverse:
        # Smaller effects than a limit that is just reached do not exist: sizes do not add.
        limit = MATERIALITY if size <= curve.theta[0] else max(sizes, key=lambda k: sizes[k])
        alone = {key: 1.0 / value for key, value in sizes.items()}
        return DetectableSize(
            name, parameter.name, parameter.unit, minutes, 1.0 / size, limit, alone
        )
    noise = sizes[NOISE]
    # The variances of the estimate due to noise and due to the other contribution add.
    alone = {NOISE: noise, MATERIALITY: parameter.materiality_threshold} | {
        key: float(np.sqrt(max(sizes[key] ** 2 - noise**2, 0.0))) for key in (TOLERANCE, SURROGATE)
    }
    # The estimate, too, exceeds the threshold with probability `POWER`.
    deviation = size / np.sqrt(_lambda(drive, curve, minutes, size))
    material = parameter.materiality_threshold + float(ndtri(POWER)) * float(deviation)
    limit = max(alone, key=lambda key: alone[key] if np.isfinite(alone[key]) else np.inf)
    return DetectableSize(
        name, parameter.name, parameter.unit, minutes, float(max(size, material)), limit, alone
    )


def _smallest(drive: Drive, key: str, model: NoiseModel, curve: _Curve, minutes: float) -> float:
    """Return the smallest difference from neutral that is accepted; NaN without one."""
    required = drive.required_non_centrality(model, curve.active[0], minutes)
    repetitions = drive.repetitions(minutes)
    reached = np.array([model.non_centrality(c, repetitions) for c in curve.columns[key].T])
    reached /= required
    above = np.flatnonzero(reached >= 1.0)
    if not above.size:
        return float("nan")
    k = int(above[0])
    if k == 0:
        # lambda is proportional to the squared size of a small effect, but not of a limit.
        inverse = curve.active[0].effect.parameters[0].inverse
        return float(curve.theta[0] / (1.0 if inverse else np.sqrt(reached[0])))
    pair = np.log(np.maximum(reached[k - 1 : k + 1], 1e-12))
    share = -pair[0] / (pair[1] - pair[0])
    ends = np.log(curve.theta[k - 1 : k + 1])
    return float(np.exp(ends[0] + share * (ends[1] - ends[0])))


def _lambda(drive: Drive, curve: _Curve, minutes: float, size: float) -> float:
    """Return the non-centrality at a size, from that of the nearest size that was tried."""
    if not np.isfinite(size):
        return float("nan")
    k = int(np.argmin(np.abs(np.log(curve.theta / size))))
    column = curve.columns[""][:, k] * (size / curve.theta[k])
    return drive.full.non_centrality(column, drive.repetitions(minutes))
