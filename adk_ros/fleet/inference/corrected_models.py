# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Corrected models of a fleet: the simulation's surrogate with the claimed effects of a level.

For all cars those that all cars share; for a car with claims also its own, with a trend at its
last recording; for a condition also those of the condition. Other cars have the model of all.
Sensor faults are no part of a vehicle. Places are listed in the result and not exported: a term at
a place needs the line of a lap.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from itertools import count

from adk_ros.fleet.inference.fleet_result import Claim, FleetResult
from adk_ros.fleet.inference.levels import CONDITION, SHARED
from adk_ros.mismatch.deployment.surrogate_writer import surrogate_yaml
from adk_ros.mismatch.library.catalogue import EFFECTS, effects_of
from adk_ros.mismatch.library.effect import Effect
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.mismatch.surrogate.substeps import scale_of

MODELS = "corrected_*.yaml"
"""Pattern of the files of corrected models."""


def corrected_models(result: FleetResult, surrogate: SurrogateModel) -> dict[str, str]:
    """Return file name -> text: of all cars, and of each car and each condition with claims."""
    shared = [c for c in result.claims if _in_all(c)]
    models = [("all", _text(shared, surrogate))]
    for car in result.cars:
        own = [c for c in result.claims if c.car == car]
        if own:
            models.append((car, _text([*shared, *own], surrogate)))
    conditions = {(c.tag, c.value) for c in result.claims if c.kind == CONDITION}
    for tag, value in sorted(conditions):
        own = [c for c in result.claims if (c.tag, c.value) == (tag, value)]
        models.append((f"{tag}_{value}", _text([*shared, *own], surrogate)))
    out: dict[str, str] = {}
    for of, text in models:
        out[_unused_name(of, out)] = text
    return out


def simulation_model(surrogate: SurrogateModel) -> str:
    """Return the text of the simulation's model, without any effect."""
    return surrogate_yaml(surrogate.parameters, terms=[], surrogate=surrogate)


def _in_all(claim: Claim) -> bool:
    """Whether a claim is about all cars and all conditions."""
    return claim.kind == SHARED or (not claim.car and claim.kind != CONDITION)


def _text(claims: list[Claim], surrogate: SurrogateModel) -> str:
    sums: dict[str, dict[str, float]] = {}
    for claim in claims:
        effect = EFFECTS[claim.effect]
        if effect.sensor:
            continue
        values = sums.setdefault(effect.name, {p.name: 0.0 for p in effect.parameters})
        values[claim.parameter] += _theta(claim)
    effects = effects_of(scale_of(surrogate.parameters))
    terms = [
        {
            "effect": name,
            "parameters": _values(effects[name], thetas),
            "where": {"kind": "always"},
        }
        for name, thetas in sums.items()
    ]
    return surrogate_yaml(surrogate.parameters, terms=terms, surrogate=surrogate)


def _theta(claim: Claim) -> float:
    """Return the difference of the fitted variable from neutral."""
    (p,) = (p for p in EFFECTS[claim.effect].parameters if p.name == claim.parameter)
    return p.theta(claim.size) - p.theta_neutral if p.inverse else claim.size


def _values(effect: Effect, thetas: Mapping[str, float]) -> dict[str, float]:
    """Return the parameters of an effect, within their bounds."""
    out = {}
    for p in effect.parameters:
        low, high = p.bounds()
        theta = min(max(p.theta_neutral + thetas[p.name], low), high)
        out[p.name] = float(f"{p.value(theta):.8g}")
    return out


def _unused_name(of: str, taken: Collection[str]) -> str:
    """Return a file name without separators that no other car or condition has."""
    safe = "".join(c if c.isalnum() or c in "._-" else "_" for c in of)
    names = (f"corrected_{safe}{f'_{i}' if i > 1 else ''}.yaml" for i in count(1))
    return next(name for name in names if name not in taken)
