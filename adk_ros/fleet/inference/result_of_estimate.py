# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The result of a fleet from its estimate: sizes in units of the parameters, ties, intervals."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

from adk_ros.fleet.inference.assessment import half_width
from adk_ros.fleet.inference.evidence import Column, Columns
from adk_ros.fleet.inference.fleet_estimate import FleetEstimate
from adk_ros.fleet.inference.fleet_model import Candidate, joint_vectors
from adk_ros.fleet.inference.fleet_result import (
    AND,
    Claim,
    FleetResult,
    NotClaimed,
    RecordingSummary,
    TrendPoint,
    VehicleEffect,
)
from adk_ros.fleet.inference.levels import is_trend
from adk_ros.fleet.inference.mixed_model import Term
from adk_ros.fleet.inference.onset_interval import onset_interval
from adk_ros.fleet.inference.place_claims import place_claims
from adk_ros.fleet.inference.size_units import (
    deviation_in_unit,
    interval_in_unit,
    size_in_unit,
)
from adk_ros.fleet.inference.ties import tied_pairs, ties_of, unclaimed
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import QUANTILE_90


def fleet_result(
    estimate: FleetEstimate,
    before: Mapping[str, float] | None = None,
    progress: Callable[[float, str], None] | None = None,
    outdated: Mapping[str, str] | None = None,
) -> FleetResult:
    """
    Return the result of an estimate, with ties and candidates that are not claimed.

    `before`: loss ratio of each recording without effects, from a first pass. `outdated`: name ->
    why a recording was not linearised at the estimate.
    """
    losses = estimate.loss_ratios if before is None else before
    report = progress or (lambda done, text: None)
    selection, model, fleet = estimate.selection, estimate.model, estimate.fleet
    selection = selection.with_all_candidates()
    claims = []
    for i, one in enumerate(estimate.claims):
        report(i / max(len(estimate.claims), 1), "comparing competing effects")
        ties = ties_of(selection, model, one)
        keys = [_tie_text(fleet.columns, t) for t in ties]
        for pair in tied_pairs(selection, model, one):
            keys.append(AND.join(sorted(_tie_text(fleet.columns, t) for t in pair)))
        claims.append(_claim(estimate, i, tuple(dict.fromkeys(keys))))
    at = joint_vectors(fleet, model)
    places, unclaimed_places = place_claims(estimate)
    return FleetResult(
        tuple(
            RecordingSummary(
                name,
                car,
                float(day),
                dict(tags),
                round(estimate.loss_ratios[name], 3),
                round(losses.get(name, estimate.loss_ratios[name]), 3),
                (outdated or {}).get(name, ""),
            )
            for name, car, day, tags in zip(
                fleet.names, fleet.cars, fleet.days, fleet.tags, strict=True
            )
        ),
        tuple(fleet.car_names),
        tuple(claims),
        tuple(places),
        (*_not_claimed(estimate), *unclaimed_places),
        tuple(_vehicles(estimate)),
        tuple(_trends(estimate, at)),
        tuple((*cell.centre, count) for cell, count in estimate.visits.items()),
        selection.rates.tests,
        0 if fleet.error is None else fleet.error.drives,
    )


def _tie_text(columns: Columns, candidate: Candidate) -> str:
    return f"{_column(columns, candidate.effect).effect.name} ({candidate.level.text})"


def _column(columns: Columns, effect: int) -> Column:
    """Return the column of an effect by its index."""
    return columns.column(columns.effects[effect])


def _claim(estimate: FleetEstimate, number: int, ties: tuple[str, ...]) -> Claim:
    one = estimate.claims[number]
    column = _column(estimate.fleet.columns, one.candidate.effect)
    level = one.candidate.level
    onset: tuple[float | None, float | None, float | None] = (None, None, None)
    if is_trend(level):
        onset = (level.onset, *onset_interval(estimate.fleet, estimate.model, number))
    low, high = interval_in_unit(column, *one.interval)
    between_recordings, between_cars = (
        deviation_in_unit(column, one.size, deviation) for deviation in one.components
    )
    return Claim(
        column.effect.name,
        column.parameter.name,
        column.parameter.unit,
        level.kind,
        level.text,
        level.car,
        level.tag,
        level.value,
        *onset,
        size_in_unit(column.parameter, one.size * column.materiality),
        low,
        high,
        one.evidence,
        one.p_value,
        between_recordings,
        between_cars,
        ties,
    )


def _not_claimed(estimate: FleetEstimate) -> list[NotClaimed]:
    out = []
    for one in unclaimed(estimate.selection.with_all_candidates(), estimate.model):
        found = one.assessment
        column = _column(estimate.fleet.columns, found.candidate.effect)
        low, high = interval_in_unit(column, *found.interval)
        out.append(
            NotClaimed(
                column.effect.name,
                column.parameter.name,
                column.parameter.unit,
                found.candidate.level.text,
                size_in_unit(column.parameter, found.size * column.materiality),
                low,
                high,
                one.reason,
                estimate.selection.is_claimable(found),
            )
        )
    return out


def _vehicles(estimate: FleetEstimate) -> list[VehicleEffect]:
    """Return the claimed parameters in each car, with the deviations of cars (partial pooling)."""
    model, fleet = estimate.model, estimate.fleet
    active = model.active()
    if not active:
        return []
    terms, mixed = model.terms(), model.mixed(fleet)
    found = mixed.estimate(terms, model.components_of(active), with_bias=True)
    covariance = found.covariance + found.bias
    # What a claim's variance has besides: the surrogate's error on other roads, inexact equations.
    deviations = np.array([claim.deviation for claim in estimate.claims])
    further = np.maximum(deviations**2 - np.diag(covariance), 0.0)
    acting = mixed.acting(terms)
    out = []
    for c, car in enumerate(fleet.car_names):
        of_car = np.array([name == car for name in fleet.cars])
        for i, effect in enumerate(active):
            column = _column(fleet.columns, effect)
            share = np.array(
                [t.design[of_car].mean() if t.effect == effect else 0.0 for t in terms]
            )
            acts = float(acting[of_car, i].mean())
            size = float(share @ found.sizes + acts * found.car_deviations[c, i])
            variance = float(share @ covariance @ share + acts**2 * found.car_variances[c, i])
            variance += float(share**2 @ further)
            claimed = any(
                t.candidate.effect == effect and t.candidate.design[of_car].any()
                for t in estimate.claims
            )
            freedom = min(
                (t.freedom for t, x in zip(estimate.claims, share, strict=True) if x != 0.0),
                default=math.inf,
            )
            half = half_width(freedom, float(np.sqrt(variance)))
            out.append(
                VehicleEffect(
                    car,
                    column.effect.name,
                    column.parameter.name,
                    column.parameter.unit,
                    size_in_unit(column.parameter, size * column.materiality),
                    *interval_in_unit(column, size - half, size + half),
                    size,
                    claimed,
                )
            )
    return out


def _trends(estimate: FleetEstimate, at: FloatArray) -> list[TrendPoint]:
    """Return the sizes by recording of parameters with trends, in the cars that these concern."""
    fleet, out = estimate.fleet, []
    cars: dict[int, set[str]] = {}
    for claim in estimate.claims:
        if is_trend(claim.candidate.level):
            cars.setdefault(claim.candidate.effect, set()).add(claim.candidate.level.car)
    for effect, concerned in cars.items():
        j = fleet.columns.first_effect + effect
        column = _column(fleet.columns, effect)
        terms: list[Term] = [c.candidate.term for c in estimate.claims]
        sizes = [c.size for c in estimate.claims]
        fitted = sum(
            (s * t.design for s, t in zip(sizes, terms, strict=True) if t.effect == effect),
            np.zeros(len(fleet.names)),
        )
        for r, name in enumerate(fleet.names):
            information = float(fleet.informations[r, j, j])
            if information <= 0.0 or not concerned & {"", fleet.cars[r]}:
                continue
            rest = at[r].copy()
            rest[j] = 0.0
            size = float(fleet.scores[r, j] - fleet.informations[r, j] @ rest) / information
            half = QUANTILE_90 / float(np.sqrt(information))
            out.append(
                TrendPoint(
                    column.effect.name,
                    column.parameter.name,
                    name,
                    fleet.cars[r],
                    float(fleet.days[r]),
                    size_in_unit(column.parameter, size * column.materiality),
                    *interval_in_unit(column, size - half, size + half),
                    size_in_unit(column.parameter, float(fitted[r]) * column.materiality),
                )
            )
    return out
