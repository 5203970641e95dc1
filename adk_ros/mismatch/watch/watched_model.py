# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The surrogate model that a watch runs, from `simulation.yaml` or `corrected.yaml`."""

from __future__ import annotations

from dataclasses import replace

from adk_ros.mismatch.deployment.surrogate_file import NamedSurrogate
from adk_ros.mismatch.library.effect import PLACE
from adk_ros.mismatch.surrogate.feature_terms import FeatureTerm
from adk_ros.mismatch.surrogate.identification import SurrogateModel


def watched_surrogate(
    model: NamedSurrogate, simulation: NamedSurrogate | None = None
) -> tuple[SurrogateModel, list[str]]:
    """
    Return the surrogate with all terms that a file holds, and notes.

    `simulation`: the file with the model's error on the simulation, if `model` does not hold it,
    as a `corrected.yaml` does not. Terms at places are left out: the road of the drive is unknown.
    """
    content, notes = model.content, []
    known = simulation if content.identification is None and simulation is not None else model
    surrogate = known.content.surrogate()
    if known.content.identification is None:
        notes.append(
            f"{model.name} does not hold the model's error on the simulation: the watch learns "
            "its spread from the drive alone; name the simulation.yaml of the same report with "
            "--simulation"
        )
    places = sorted({term.effect for term in content.terms if term.where.kind == PLACE})
    if places:
        notes.append(f"{model.name}: effects at a place are left out: {', '.join(places)}")
    features = tuple(
        FeatureTerm(term.equation, term.feature, term.coefficient, 0.0)
        for term in (*content.extras.feature_terms, *content.feature_terms)
    )
    return (
        replace(
            surrogate,
            parameters=content.vector_with_terms(),
            road=content.road(),
            feature_terms=features,
        ),
        notes,
    )
