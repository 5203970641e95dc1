# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The corrected model: the surrogate with a hypothesis's tolerances, vehicle effects, features."""

from __future__ import annotations

from typing import Any

import numpy as np

from adk_ros.mismatch.deployment.surrogate_writer import surrogate_yaml
from adk_ros.mismatch.inference.feature_effect import catalogue_effects, feature_terms
from adk_ros.mismatch.inference.hypothesis import ActiveEffect, Hypothesis
from adk_ros.mismatch.inference.nuisances import N_FIXED_NUISANCES, TOLERANCE_PARAMETERS
from adk_ros.mismatch.library.effect import PLACE
from adk_ros.mismatch.library.parametric_features import is_transferable
from adk_ros.mismatch.library.surrogate_parameters import HIGH, LOW
from adk_ros.mismatch.surrogate.activation import segments_by_route
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.mismatch.surrogate.lap import Lap


def corrected_yaml(surrogate: SurrogateModel, h: Hypothesis, lap: Lap | None) -> str:
    """Return the text of the corrected model's file; sensor faults are not part of it."""
    n_weak = surrogate.weak_directions.shape[0]
    weak = h.nuisances[N_FIXED_NUISANCES : N_FIXED_NUISANCES + n_weak]
    parameters = np.clip(surrogate.parameters + weak @ surrogate.weak_directions, LOW, HIGH)
    tolerances = h.nuisances[: len(TOLERANCE_PARAMETERS)]
    terms = [
        {
            "effect": a.effect.name,
            "parameters": {name: float(f"{value:.8g}") for name, value in a.values().items()},
            "where": where,
        }
        for a in catalogue_effects(h.effects)
        if not a.effect.sensor
        for where in _activation_entries(a, lap)
    ]
    return surrogate_yaml(
        parameters,
        dict(zip(TOLERANCE_PARAMETERS, (float(x) for x in tolerances), strict=True)),
        terms,
        [term for term in feature_terms(h.effects) if is_transferable(term.feature)],
        surrogate,
    )


def _activation_entries(active: ActiveEffect, lap: Lap | None) -> list[dict[str, Any]]:
    """Return where an effect acts: one entry, or one for each route with segments."""
    activation = active.activation
    if activation.kind != PLACE or lap is None:
        out: dict[str, Any] = {"kind": activation.kind}
        if activation.onset_s is not None:
            out["onset_s"] = round(activation.onset_s, 3)
        return [out]
    segments = segments_by_route(activation.segments, len(lap.routes))
    return [
        {
            "kind": PLACE,
            "lap": round(route.length, 3),
            "stretches": [[round(a, 2), round(b, 2)] for a, b in stretches],
            "edge": activation.transition_length,
            "line": [
                [round(float(x), 4) for x in row]
                for row in np.column_stack([route.line_s, route.line])
            ],
        }
        for route, stretches in zip(lap.routes, segments, strict=True)
        if stretches
    ]
