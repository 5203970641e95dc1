# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The analysis of a fleet in passes: evidence of each recording, estimate, and again at the estimate.

The passes that are not near the estimate yet are of representative recordings, where there are
many. After the first pass only those recordings are linearised again whose effects have moved, or
that pass near a place that has: elsewhere an effect at a place changes nothing. Claims are
compared with similar effects, each linearised at itself, before the estimate.

Where the evidence comes from is a function: of recordings in memory, or of a dataset.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from adk_ros.fleet.inference.alternating_claims import AlternatingClaims
from adk_ros.fleet.inference.competing_effects import remaining_loss
from adk_ros.fleet.inference.effect_comparisons import EffectComparisons
from adk_ros.fleet.inference.evidence import Row
from adk_ros.fleet.inference.fleet_candidates import identity
from adk_ros.fleet.inference.fleet_estimate import (
    ROUNDS,
    EvidenceAt,
    FleetEstimate,
    estimate_fleet,
)
from adk_ros.fleet.inference.fleet_evidence import FleetEvidence, RecordingTags
from adk_ros.fleet.inference.fleet_result import FleetResult
from adk_ros.fleet.inference.fleet_simulation import FleetSimulation
from adk_ros.fleet.inference.linearisation_point import has_moved, rounded_size
from adk_ros.fleet.inference.linearised_fleet import LinearisedFleet
from adk_ros.fleet.inference.nonlinear_candidates import NonlinearCandidates
from adk_ros.fleet.inference.place_data import Place
from adk_ros.fleet.inference.place_evidence import Cell
from adk_ros.fleet.inference.representative_recordings import representative_recordings
from adk_ros.fleet.inference.result_of_estimate import fleet_result

MAX_PASSES, USUAL_PASSES = 6, 3
"""
Linearisations: without effects, at a preliminary estimate, and until none moves. One more where
the early ones are of representative recordings.
"""
_EARLY_PASSES = 2
"""Passes after the first that are not near the estimate yet."""
_FIRST_STEP = 10.0
"""
Largest effect, in materiality thresholds, of the first step: it comes from derivatives without any
effect, which mistake two delays for a yaw inertia that is 60 % larger. By choice.
"""
_EARLY_ROUNDS = 2
"""Rounds of effects and places where a further pass follows."""
TagsOf = Callable[[Sequence[Row]], Mapping[str, RecordingTags]]
"""Rows of the recordings -> the tags of each by name."""
Progress = Callable[[float, str], None]
BeginPass = Callable[[int, int], None]
"""Called at the begin of each pass with its number, from 1 on, and how many there are at most."""


@dataclass(frozen=True)
class FleetAnalysis:
    """
    Estimate and result of a fleet.

    `failed`: recordings without evidence -> reason. `outdated`: recordings that take part with
    the evidence of an earlier pass, since they failed in a later one -> reason.
    """

    estimate: FleetEstimate
    result: FleetResult
    failed: Mapping[str, str]
    outdated: Mapping[str, str] = field(default_factory=dict)


def analyse_fleet(
    evidence_at: EvidenceAt,
    simulation: FleetSimulation,
    tags_of: TagsOf,
    progress: Progress | None = None,
    begin_pass: BeginPass | None = None,
) -> FleetAnalysis:
    """
    Analyse a fleet; recordings without evidence are left out, with the reason.

    One that fails in a later pass, at its time limit for example, keeps its evidence of an earlier
    one, and is not linearised again. The early passes of a large fleet are of representative
    recordings; the others are linearised at the estimate of these.

    :raises DataError: no recording has evidence.
    """
    begin = begin_pass or (lambda number, most: None)
    # How many recordings have evidence, and so whether there is one more, is not known yet.
    begin(1, MAX_PASSES + 1)
    fleet = _Passes(evidence_at, simulation, tags_of, progress)
    estimate = fleet.estimated(0)
    for turn in range(1, fleet.passes):
        further = fleet.with_nonlinear_candidates(estimate)
        if fleet.is_settled(further, turn):
            # What is only tried at its size is no claim.
            break
        begin(turn + 1, fleet.passes)
        estimate = fleet.estimated(turn, fleet.linearised_at(further, turn))
        if turn == _EARLY_PASSES:
            estimate = fleet.widened(estimate)
    result = fleet_result(estimate, fleet.loss_ratios, progress, fleet.linearised.outdated)
    result = replace(result, unsettled=len(fleet.unsettled(estimate)))
    return FleetAnalysis(estimate, result, fleet.linearised.failed, fleet.linearised.outdated)


class _Passes:
    """
    State of an analysis over its passes.

    `active`: recordings that take part; `late`: those of them that the early passes left out.
    """

    def __init__(
        self,
        evidence_at: EvidenceAt,
        simulation: FleetSimulation,
        tags_of: TagsOf,
        progress: Progress | None,
    ) -> None:
        self._evidence_at, self._progress = evidence_at, progress
        self._simulation = simulation.evidence.to_row()
        self.linearised = LinearisedFleet(evidence_at)
        self.linearised.update(None, None)
        self._tags = tags_of(self.linearised.every_row())
        self.loss_ratios = self.linearised.loss_ratios()
        every = {name: self._tags.get(name, RecordingTags(name)) for name in self.loss_ratios}
        self._active = representative_recordings(every)
        self._late: frozenset[str] = frozenset()
        self.passes = MAX_PASSES if len(self._active) == len(every) else MAX_PASSES + 1
        self._places: tuple[Place, ...] = ()
        self._alternating = AlternatingClaims()
        self._comparisons, self._nonlinear = EffectComparisons(), NonlinearCandidates()

    def estimated(self, turn: int, at: FleetEstimate | None = None) -> FleetEstimate:
        """Return the estimate of the recordings that take part, linearised at an earlier one."""
        estimate = self._estimate(turn)
        is_first_of_all = turn == _EARLY_PASSES + 1 and self.passes > MAX_PASSES
        if at is not None and turn > _EARLY_PASSES and not is_first_of_all:
            left = remaining_loss(at, self.linearised.usable(self._active))
            claims = frozenset(identity(one.candidate) for one in at.claims)
            if self._alternating.settle(claims, left, estimate.identities):
                estimate = self._estimate(turn)
        return estimate

    def _estimate(self, turn: int) -> FleetEstimate:
        return estimate_fleet(
            [self._simulation, *self.linearised.every_row(self._active)],
            self._tags,
            self._progress,
            ROUNDS if turn >= _EARLY_PASSES else _EARLY_ROUNDS,
            self._places,
            is_at_estimate=turn >= _EARLY_PASSES,
            refused=self._alternating.refused,
            beside=self._comparisons.beside,
        )

    def widened(self, estimate: FleetEstimate) -> FleetEstimate:
        """Return the estimate for all recordings, which take part from now on."""
        every = frozenset(self.loss_ratios)
        self._late, self._active = every - self._active, every
        if not self._late:
            return estimate
        # What few of the representative recordings show may be plain in the others.
        self._nonlinear = NonlinearCandidates()
        rows = [self._simulation, *self.linearised.every_row()]
        return estimate.of_fleet(FleetEvidence.of(rows, self._tags))

    def with_nonlinear_candidates(self, estimate: FleetEstimate) -> FleetEstimate:
        """Return the estimate with what is to be tried at its size in the next pass."""
        if self._late:
            return estimate
        rows = self.linearised.usable(self._active)
        return self._nonlinear.added(estimate, rows, self._evidence_at)

    def is_settled(self, estimate: FleetEstimate, turn: int) -> bool:
        """Whether all recordings are linearised at an estimate that the next pass would be at."""
        moved = self.linearised.moved_to(estimate, self._active)
        cells = _moved_cells(self._places, estimate.places)
        return turn > _EARLY_PASSES and not (self._late or cells or moved)

    def unsettled(self, estimate: FleetEstimate) -> set[str]:
        """Return the recordings that the last estimate would linearise once more."""
        moved = self.linearised.moved_to(estimate, self._active)
        cells = _moved_cells(self._places, estimate.places)
        return moved | self.linearised.passing(cells, self._active)

    def _sampled(self, estimate: FleetEstimate) -> frozenset[str]:
        return self._comparisons.sampled(estimate, self.linearised.usable(self._active))

    def linearised_at(self, estimate: FleetEstimate, turn: int) -> FleetEstimate:
        """
        Linearise the recordings that have moved, and those that pass a place which has.

        Return where: at the estimate, with claims exchanged for similar effects.
        """
        cells = _moved_cells(self._places, estimate.places)
        passing = self.linearised.passing(cells, self._active - self._late)
        passing |= self.linearised.passing(cells | _cells_of(estimate.places), self._late)
        if cells:
            self._places = _linearised_at(self._places, estimate.places)
        # All recordings are linearised at the same places.
        farthest = _FIRST_STEP if turn == 1 else np.inf
        estimate = replace(estimate, places=self._places, farthest=farthest)
        due = self.linearised.moved_to(estimate, self._active) | passing
        # Claims that are exchanged move most recordings: those that decide come first.
        first: set[str] = set()
        while further := (due & self._sampled(estimate)) - first:
            # Where one fails, another one takes its place.
            self.linearised.update(estimate, further, passing)
            first |= further
        estimate = self._comparisons.exchanged(
            estimate,
            self.linearised.usable(self._active),
            self._evidence_at,
            is_near=turn >= _EARLY_PASSES,
        )
        due = (due - first) | self.linearised.moved_to(estimate, self._active)
        self.linearised.update(estimate, due, passing - first)
        self._late = frozenset()
        return estimate


def _cells_of(places: Sequence[Place]) -> set[Cell]:
    return {cell for place in places for cell in place.cells}


def _linearised_at(before: Sequence[Place], after: Sequence[Place]) -> tuple[Place, ...]:
    """
    Return the places `after`, with the sizes at which recordings are linearised, rounded.

    A place that has not moved keeps its size: recordings that pass it are not linearised again.
    """
    known = {(p.key, p.cells): p.size for p in before}
    out = []
    for place in after:
        size = known.get((place.key, place.cells), 0.0)
        if has_moved({"": size}, {"": place.size}):
            size = rounded_size(place.size)
        out.append(replace(place, size=size))
    return tuple(out)


def _moved_cells(before: Sequence[Place], after: Sequence[Place]) -> set[Cell]:
    """Return the cells in which the effects at places have moved."""
    sizes, sizes_after = ({(p.key, p.cells): p.size for p in places} for places in (before, after))
    return {
        cell
        for one in {*sizes, *sizes_after}
        if has_moved({"": sizes.get(one, 0.0)}, {"": sizes_after.get(one, 0.0)})
        for cell in one[1]
    }
