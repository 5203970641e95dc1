# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Effects that only the loss at their size shows, as candidates of the next linearisation.

Power limits, friction and delays are not linear: without them their derivative is the secant to a
start value, by which a weaker limit seems to act where it does not. So a candidate may seem to
differ between recordings, and save no loss in the linear problem. A few recordings that are
explained worst are linearised with it; if that saves enough of their loss, all are linearised
there next, and the selection decides.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from adk_ros.fleet.inference.assessment import Assessment
from adk_ros.fleet.inference.competing_effects import Sample, fitted_in_place, parameter_of
from adk_ros.fleet.inference.evidence import Row
from adk_ros.fleet.inference.fleet_candidates import Identity, identity
from adk_ros.fleet.inference.fleet_estimate import EvidenceAt, FleetEstimate
from adk_ros.fleet.inference.fleet_model import Candidate, remaining_excess
from adk_ros.fleet.inference.levels import SHARED, Level
from adk_ros.mismatch.library.criteria import FAMILYWISE_ERROR_RATE
from adk_ros.numerics.arrays import FloatArray

_TRIED = 2
"""Candidates that are tried after each estimate, those of the most evidence. By choice."""


class NonlinearCandidates:
    """Candidates with start values that were tried in an analysis, once beside the same claims."""

    def __init__(self) -> None:
        self._tried: set[tuple[Identity, frozenset[Identity]]] = set()

    def added(
        self, estimate: FleetEstimate, rows: Mapping[str, Sequence[Row]], evidence_at: EvidenceAt
    ) -> FleetEstimate:
        """
        Return the estimate with the candidates among its claims that save loss at their size.

        Only the claims are changed, at which recordings are linearised. `rows`: of each recording.
        """
        excess = remaining_excess(estimate.fleet, estimate.model)
        claimed = estimate.identities
        for candidate in self._candidates(estimate, excess)[:_TRIED]:
            self._tried.add((identity(candidate.candidate), claimed))
            # Where much is unexplained: by its derivative, it may act where it does not.
            sample = Sample.of(estimate, candidate, rows, excess)
            least = sample.required(estimate) + sample.margin
            if not sample.names or sample.sum_of(estimate, excess) < least:
                continue
            before = sample.rows_at(estimate, evidence_at)
            if before is None:
                continue
            with_it = replace(estimate, claims=(*estimate.claims, candidate))
            last = len(estimate.claims)
            key = parameter_of(estimate, candidate)
            found, left = fitted_in_place(with_it, last, key, sample, evidence_at)
            if found is None:
                continue
            saved = sample.excess(estimate, before) - left
            if saved >= least:
                estimate = replace(with_it, claims=(*estimate.claims, found))
        return estimate

    def _candidates(self, estimate: FleetEstimate, excess: FloatArray) -> list[Assessment]:
        """Return what may be claimable at its size and is not without it, most evidence first."""
        selection, model, columns = estimate.selection, estimate.model, estimate.fleet.columns
        level = Level(SHARED)
        everywhere = [
            Candidate(effect, level, level.design(estimate.fleet))
            for effect in selection.observable
        ]
        claimed = estimate.identities
        known = claimed | {one for one, beside in self._tried if beside == claimed}
        found = [
            selection.assess(model, candidate)
            for candidate in everywhere
            if columns.column(columns.effects[candidate.effect]).parameter.starts
            and identity(candidate) not in known
            and selection.is_allowed(model, identity(candidate))
        ]
        found = [
            one
            for one in found
            if one.p_value < FAMILYWISE_ERROR_RATE
            and selection.is_material(one)
            and selection.is_possible(one)
            and not (selection.is_claimable(one) and selection.explains(model, one, excess))
        ]
        return sorted(found, key=lambda one: -one.evidence)
