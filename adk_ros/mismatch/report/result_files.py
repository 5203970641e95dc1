# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Write the result folder: `mismatch.json`, models, page and figures."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from adk_ros.files.output_folder import staged_folder
from adk_ros.files.pages.provenance import Provenance
from adk_ros.mismatch.inference.confidence import Evidence
from adk_ros.mismatch.inference.downweighted_episodes import Downweighted
from adk_ros.mismatch.inference.result import (
    HeldOutResult,
    IdentifiedEffect,
    MismatchResult,
)
from adk_ros.mismatch.library.effect import PLACE, TIME
from adk_ros.mismatch.library.parametric_features import form_of
from adk_ros.mismatch.recording.measured_road import MeasuredRoad
from adk_ros.mismatch.report.agreement_table import agreement_dict
from adk_ros.mismatch.report.calibration_parameters import parameters_by_effect
from adk_ros.mismatch.report.calibration_table import calibrations_as_dict, category_as_dict
from adk_ros.mismatch.report.direct_table import direct_as_dicts
from adk_ros.mismatch.report.json_values import (
    json_competing_effects,
    json_number,
    json_parameters,
)
from adk_ros.mismatch.report.opening_json import opening_as_dict
from adk_ros.mismatch.report.recording_texts import onset_text, segment_texts
from adk_ros.mismatch.report.report_page import FIGURES, PAGE, write_page, write_scope_page
from adk_ros.mismatch.report.summary import (
    INCONCLUSIVE,
    is_unjudged,
    sentence,
    underfit_channels,
    verdict_text,
)
from adk_ros.mismatch.report.vocabulary import unit_text

SCHEMA = 2
"""Version of `mismatch.json`; 1: other names of `competing_effects` and `surrogate_error`."""
RESULT_FILE, SIMULATION_FILE, CORRECTED_FILE = "mismatch.json", "simulation.yaml", "corrected.yaml"
HELD_OUT_FILE = "held_out.yaml"
"""Corrected model fitted to the first part only; the held-out errors are computed with it."""


def where_text(effect: IdentifiedEffect) -> str:
    """Return where or when an effect is active, as text."""
    if effect.kind == PLACE:
        return f"local: {', '.join(segment_texts(effect))} along the lap, every lap"
    if effect.kind == TIME:
        return onset_text(effect)
    return unit_text(effect.effect.where)


def as_dict(result: MismatchResult) -> dict[str, Any]:
    """Return the content of `mismatch.json`; its schema is a public contract."""
    effects = []
    parameters = parameters_by_effect(result.effects, result.sensors)
    for effect in result.effects:
        effects.append(
            {
                "name": effect.effect.name,
                "confidence": json_number(effect.confidence),
                "posterior": {name: json_number(x) for name, x in effect.posterior.items()},
                "alternatives": effect.alternatives,
                "parameters": json_parameters(effect.parameters),
                "where": {
                    "kind": effect.kind,
                    "time_intervals_s": effect.time_intervals_s,
                    "text": where_text(effect),
                },
                "equations": list(effect.effect.equations),
                "competing_effects": json_competing_effects(effect.competitors),
                "evidence": _evidence(effect.evidence),
                **category_as_dict(effect, parameters),
            }
        )
    answer: dict[str, Any] = {
        "schema": SCHEMA,
        "verdict": result.verdict,
        "effects": effects,
        "fit": {
            "horizon_s": result.horizon_s,
            "held_out": True,
            "sizes_from": "all data",
            "before": {name: json_number(x) for name, x in result.before.items()},
            "after": {name: json_number(x) for name, x in result.after.items()},
        },
        "identifiability": {"groups": result.groups, "suggest": result.suggestion},
        "sentence": sentence(result),
        "notes": list(result.notes),
        "surrogate_error": {name: json_number(x) for name, x in result.surrogate_error.items()},
    }
    answer["selection"] = {
        "expected_loss": json_number(result.expected_loss),
        "surrogate_error": json_number(result.surrogate_error_dof),
        "surrogate_variance_share": json_number(result.surrogate_variance_share),
        "steps": [
            {
                "effects": list(step.names),
                "loss": json_number(step.loss),
                "gain": json_number(step.gain),
                "required": json_number(step.required),
            }
            for step in result.steps
        ],
    }
    answer["selection"]["criteria"] = {
        name: {
            "decisions": x.total,
            "changed_by_half": x.changed_by_half,
            "changed_by_double": x.changed_by_double,
        }
        for name, x in sorted(result.decisions.items())
    }
    if result.held_out is not None:
        answer["fit"] |= _held_out(result.held_out)
    if result.set_aside:
        answer["set_aside"] = result.set_aside
    if result.candidates:
        answer["candidates"] = [
            {
                "name": candidate.name,
                "parameters": json_parameters(candidate.parameters),
                "kind": candidate.kind,
                "share": candidate.share,
                "not_claimed_because": candidate.reason,
            }
            for candidate in result.candidates
        ]
    if result.direct:
        answer["direct"] = direct_as_dicts(result)
    answer |= opening_as_dict(result)
    answer |= calibrations_as_dict(result)
    if result.downweighted is not None:
        answer["downweighted"] = _downweighted(result.downweighted)
    if result.agreement is not None:
        answer["agreement"] = agreement_dict(result.agreement)
    underfit = underfit_channels(result)
    if underfit:
        answer["caveat"] = (
            f"the surrogate model does not fit the simulation in {underfit}; smaller differences "
            "cannot be found"
        )
    elif verdict_text(result) == INCONCLUSIVE:
        answer["caveat"] = (
            "inconclusive: the comparison without a surrogate model shows a difference that no "
            "effect of the catalogue explains"
        )
    answer["scope"] = {
        "lacking": [lack.text for lack in result.missing_channels],
        "not_judged": result.not_judged,
        "rows": [row.as_dict() for row in result.scope],
    }
    if result.road is not None:
        answer["measured_road"] = _measured_road(result.road)
    if result.unexplained is not None:
        unexplained = result.unexplained
        answer["unexplained"] = {
            "equations": unexplained.equations,
            "share": unexplained.share,
            "text": unexplained.text,
            "expression": unexplained.expression,
            "terms": [
                {
                    "equation": term.equation,
                    "feature": term.feature,
                    "form": form_of(term.feature),
                    "coefficient": json_number(term.coefficient),
                }
                for term in unexplained.terms
            ],
        }
        if unexplained.meaning:
            answer["unexplained"]["meaning"] = unexplained.meaning
    return answer


def _measured_road(road: MeasuredRoad) -> dict[str, dict[str, float | None]]:
    """Return range, RMS and uncertainty of each slope of the road, rad."""
    return {
        name: {
            "min": json_number(float(values.min())),
            "max": json_number(float(values.max())),
            "rms": json_number(float(np.sqrt(np.mean(values**2)))),
            "error": json_number(float(np.sqrt(np.mean(errors**2)))),
            "level_error": json_number(float(sigma)),
        }
        for name, values, errors, sigma in zip(
            road.entries, road.values, road.errors, road.level_sigma, strict=True
        )
    }


def _evidence(evidence: Evidence | None) -> dict[str, Any]:
    """Return by how much each alternative is worse on each block left out."""
    if evidence is None:
        return {}
    costs = np.broadcast_to(evidence.prior_costs, len(evidence.names))
    rows = zip(evidence.names, evidence.log_priors, costs, evidence.differences, strict=True)
    return {
        "surrogate_error": json_number(evidence.surrogate_error),
        "alternatives": [
            {
                "name": name,
                "log_prior": json_number(prior),
                "prior_cost": json_number(cost),
                "block_losses": [json_number(x) for x in row],
            }
            for name, prior, cost, row in rows
        ],
    }


def _held_out(errors: HeldOutResult) -> dict[str, Any]:
    """Return the errors on held-out data by horizon, and what was exported."""
    tables = {
        "before": errors.before,
        "after": errors.after,
        "persistence": errors.persistence,
        "expected": errors.expected,
        "ratio": errors.ratio,
    }
    if errors.rejected is not None:
        tables["rejected"] = errors.rejected
    return {
        "data": errors.source,
        "starts": errors.starts,
        "horizons": {
            f"{horizon:g}": {
                name: {state: json_number(values[i]) for state, values in table.items()}
                for name, table in tables.items()
            }
            for i, horizon in enumerate(errors.horizons_s)
        },
        "explained": errors.explained,
        "exported": errors.export,
        "raised": list(errors.raised),
        "tolerances_fitted": errors.tolerances_fitted,
    }


def _downweighted(hidden: Downweighted) -> dict[str, Any]:
    """Return when and where episodes are, and in which channel."""
    return {
        "seconds": hidden.seconds,
        "expected_seconds": json_number(hidden.expected),
        "share": json_number(hidden.share),
        "share_of_excess": json_number(hidden.share_of_excess),
        "material": hidden.is_material,
        "equations": list(hidden.equations),
        "episodes": [
            {
                key: json_number(value) if isinstance(value, float) else value
                for key, value in episode._asdict().items()
            }
            for episode in hidden.episodes
        ],
    }


def write_report(
    result: MismatchResult, out: Path, *, provenance: Provenance | None = None
) -> None:
    """
    Write result, page, figures and models into the folder `out`: all of them or none.

    :raises UsageError: `out` cannot be written.
    """
    with staged_folder(out, (RESULT_FILE, PAGE), FIGURES) as staged:
        texts = {
            RESULT_FILE: json.dumps(as_dict(result), indent=2) + "\n",
            SIMULATION_FILE: result.simulation_yaml,
            CORRECTED_FILE: result.corrected_yaml,
            HELD_OUT_FILE: result.held_out_yaml or result.corrected_yaml,
        }
        for name, text in texts.items():
            (staged / name).write_text(text, encoding="utf-8")
        write = write_scope_page if is_unjudged(result) else write_page
        write(result, staged, provenance=provenance)
