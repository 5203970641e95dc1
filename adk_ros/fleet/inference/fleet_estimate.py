# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The estimate of a fleet: effects, levels and places, and the joint vector of each recording.

Effects of all levels are selected first, then those at places given these; then once more, each
without what the other explains: a place that all recordings of one route pass would otherwise look
like an effect of its recordings.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from adk_ros.fleet.inference.assessment import Assessment
from adk_ros.fleet.inference.evidence import RECORDING, Row, column_of
from adk_ros.fleet.inference.exchange import exchanged
from adk_ros.fleet.inference.fleet_candidates import Identity, identity
from adk_ros.fleet.inference.fleet_evidence import FleetEvidence, RecordingTags
from adk_ros.fleet.inference.fleet_model import Candidate, FleetModel, joint_vectors
from adk_ros.fleet.inference.fleet_selection import Selection
from adk_ros.fleet.inference.linearisation_point import rounded_values
from adk_ros.fleet.inference.place_data import Place, PlaceData
from adk_ros.fleet.inference.place_evidence import Cell
from adk_ros.fleet.inference.places import select_places
from adk_ros.fleet.inference.recording_evidence import PlacedValue
from adk_ros.fleet.inference.simplification import explaining, simplified

ROUNDS = 3
"""Most rounds of effects and places; they end when the places stay. By choice."""
_REVISIONS = 3
"""Times that claims which explain nothing are dropped and others added; they end when all explain
something. By choice."""


@dataclass(frozen=True)
class FleetEstimate:
    """Evidence without the effects at places, the selection on it, its claims, and the places."""

    fleet: FleetEvidence
    selection: Selection
    model: FleetModel
    claims: tuple[Assessment, ...]
    places: tuple[Place, ...]
    loss_ratios: Mapping[str, float]
    """Loss of each recording where it was linearised, over that of a perfect model."""
    visits: Mapping[Cell, int]
    """Number of recordings that pass each cell of the map, of those that several pass."""
    farthest: float = np.inf
    """Largest effect at which a recording is linearised, in materiality thresholds."""

    @property
    def identities(self) -> frozenset[Identity]:
        """What the claims are about."""
        return frozenset(identity(c) for c in self.model.claimed)

    def of_fleet(self, fleet: FleetEvidence) -> FleetEstimate:
        """
        Return the estimate for these and further recordings, to be linearised at it.

        Loss ratios and visits are those of the recordings that it comes from. A ramp ends at the
        last of all recordings: its size becomes what it is then.
        """

        def designed(candidate: Candidate) -> Candidate:
            return replace(candidate, design=candidate.level.design(fleet))

        def widened(claim: Assessment) -> Assessment:
            candidate = designed(claim.candidate)
            row = int(np.argmax(claim.candidate.design))
            now = candidate.design[fleet.names.index(self.fleet.names[row])]
            factor = float(claim.candidate.design[row] / now)
            size, deviation = factor * claim.size, factor * claim.deviation
            return replace(claim, candidate=candidate, size=size, deviation=deviation)

        claims = tuple(widened(claim) for claim in self.claims)
        model = replace(self.model, claimed=tuple(designed(c) for c in self.model.claimed))
        selection = Selection(fleet, 0, None, self.selection.refused, self.selection.beside)
        return replace(self, fleet=fleet, selection=selection, model=model, claims=claims)

    def values_of(self, recording: str) -> dict[str, float]:
        """
        Return the effects in a recording: key -> difference of the fitted variable from neutral.

        Within the bounds of the parameters.
        """
        i = self.fleet.names.index(recording)
        totals: dict[str, float] = {}
        for claim in self.claims:
            key = self.fleet.columns.effects[claim.candidate.effect]
            share = float(claim.candidate.design[i])
            totals[key] = totals.get(key, 0.0) + share * claim.size
        out = {}
        for key, total in totals.items():
            column = self.fleet.columns.column(key)
            p = column.parameter
            low, high = (b - p.theta_neutral for b in p.bounds())
            kept = float(np.clip(total, -self.farthest, self.farthest))
            out[key] = float(np.clip(kept * column.materiality, low, high))
        return {key: value for key, value in out.items() if value != 0.0}

    def point_of(self, recording: str) -> dict[str, float]:
        """Return where to linearise a recording again: its effects, rounded."""
        return rounded_values(self.values_of(recording), self.fleet.columns)

    def local_values(self) -> list[PlacedValue]:
        """
        Return the effects at places, within their bounds, for a further linearisation.

        Places are those of full-size cars: recordings of scale models have no rows of places.
        """
        out = []
        for place in self.places:
            column = column_of(place.key)
            p = column.parameter
            low, high = (b - p.theta_neutral for b in p.bounds())
            value = float(np.clip(place.size * column.materiality, low, high))
            out.append(PlacedValue(place.key, place.cells, value))
        return out


EvidenceAt = Callable[
    [FleetEstimate | None, Collection[str] | None], tuple[list[Row], Mapping[str, str]]
]
"""
Estimate to linearise at, None for no effects, and names of the recordings to linearise, None for
all -> their rows, and name -> why a recording has none.
"""


def estimate_fleet(
    rows: Sequence[Row],
    tags: Mapping[str, RecordingTags],
    progress: Callable[[float, str], None] | None = None,
    rounds: int = ROUNDS,
    known_places: Sequence[Place] = (),
    is_at_estimate: bool = False,
    refused: frozenset[Identity] = frozenset(),
    beside: Mapping[Identity, Identity] | None = None,
) -> FleetEstimate:
    """
    Return the estimate of a fleet from its rows of evidence.

    `rounds` of effects and places; two where the recordings are linearised again afterwards.
    `known_places`: those of the estimate at which the recordings were linearised.
    `is_at_estimate`: they were linearised at one that is near. `refused`: claims not to examine;
    `beside`: those to examine next to another one only.
    :raises DataError: there is no evidence, or it does not belong together.
    """
    fleet = replace(FleetEvidence.of(rows, tags), is_at_estimate=is_at_estimate)
    of_recordings = {row["recording"]: row for row in rows if row["kind"] == RECORDING}
    dispersion = {name: float(row["dispersion"]) for name, row in of_recordings.items()}
    ratios = {name: float(row["loss_ratio"]) for name, row in of_recordings.items()}
    data = PlaceData(rows, fleet.names, dispersion)
    places = list(known_places)
    corrected = fleet
    for turn in range(rounds):
        selection = Selection(corrected, data.tests, progress, refused, beside)
        model = _selected(selection)
        at = joint_vectors(corrected, model) + fleet.origin
        found = select_places(data, at, selection.rates.of_place, known_places)
        if {(p.key, p.cells) for p in found} == {(p.key, p.cells) for p in places}:
            places = found
            break
        if turn + 1 < rounds:
            places = found
            removed = data.correction(places, known_places, fleet.scores.shape)
            saved = data.saved_loss(places, known_places, len(fleet.names), fleet.origin)
            corrected = replace(fleet, scores=fleet.scores - removed, excess=fleet.excess - saved)
    claims = tuple(selection.assessed(model))
    visits = {cell: len(v.recordings) for cell, v in data.cells.items()}
    return FleetEstimate(corrected, selection, model, claims, tuple(places), ratios, visits)


def _selected(selection: Selection) -> FleetModel:
    """Return the claims of a selection, exchanged and simplified, with what that leaves to add."""
    model = selection.select()
    likelier = exchanged(selection, model)
    changed, refused = simplified(selection, likelier)
    model = model if changed is model else selection.select(changed, refused)
    return explaining(selection, _revised(selection, model, refused))


def _revised(selection: Selection, model: FleetModel, refused: Collection[Identity]) -> FleetModel:
    """
    Return the model without claims that explain nothing, with what these have displaced.

    One of them that does explain something next to what is added returns, once.
    """
    refused = set(refused)
    readmitted: set[Identity] = set()
    for _ in range(_REVISIONS):
        kept = explaining(selection, model)
        if kept is model:
            break
        left = {identity(c) for c in kept.claimed}
        lost = {identity(c): c for c in model.claimed if identity(c) not in left}
        model = selection.select(kept, refused | lost.keys())
        # What explained nothing next to a pair that cancels may explain something without it.
        again = {
            known
            for known, claim in lost.items()
            if known not in readmitted
            and selection.explains(model, selection.assess(model, claim))
        }
        refused |= lost.keys() - again
        readmitted |= again
        if again:
            model = selection.select(model, refused)
    return model
