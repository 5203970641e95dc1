# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The machine's answer, `mismatch.json`, and the folder that holds it with all the rest."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from adk_ros.files.output_folder import staged_folder
from adk_ros.mismatch.inference.result import IdentifiedEffect, MismatchResult
from adk_ros.mismatch.library.effect import PLACE, TIME
from adk_ros.mismatch.report.report_page import FIGURES, PAGE, write_page
from adk_ros.mismatch.report.summary import segment_texts, sentence, underfit_channels

SCHEMA = 1
RESULT_FILE, SIMULATION_FILE, CORRECTED_FILE = "mismatch.json", "simulation.yaml", "corrected.yaml"
HELD_OUT_FILE = "held_out.yaml"
"""The corrected model that the held-out errors are of: fitted to the recording's first part."""


def _number(value: float) -> float | None:
    return float(f"{value:.6g}") if math.isfinite(value) else None


def where_text(effect: IdentifiedEffect) -> str:
    """Return where an effect acts, in words."""
    if effect.kind == PLACE:
        return f"at a place: {', '.join(segment_texts(effect))} along the lap, every lap"
    if effect.kind == TIME:
        return f"from {effect.onset_s or 0.0:.1f} s on"
    return effect.effect.where


def as_dict(findings: MismatchResult) -> dict[str, Any]:
    """Return the answer as the contract has it."""
    effects = []
    for effect in findings.effects:
        effects.append(
            {
                "name": effect.effect.name,
                "confidence": effect.confidence,
                "alternatives": effect.alternatives,
                "parameters": {
                    name: {
                        "value": _number(x.value),
                        "low": _number(x.low),
                        "high": _number(x.high),
                        "unit": x.unit,
                    }
                    for name, x in effect.parameters.items()
                },
                "where": {
                    "kind": effect.kind,
                    "time_intervals_s": effect.time_intervals_s,
                    "text": where_text(effect),
                },
                "equations": list(effect.effect.equations),
                "rivals": [
                    {"name": rival.name, "behind": _number(rival.loss_difference)}
                    for rival in effect.competitors
                ],
            }
        )
    answer: dict[str, Any] = {
        "schema": SCHEMA,
        "verdict": findings.verdict,
        "effects": effects,
        "fit": {
            "horizon_s": findings.horizon_s,
            "held_out": True,
            "before": {name: _number(x) for name, x in findings.before.items()},
            "after": {name: _number(x) for name, x in findings.after.items()},
        },
        "identifiability": {"groups": findings.groups, "suggest": findings.suggestion},
        "sentence": sentence(findings),
        "notes": list(findings.notes),
        "stand_in_error": {name: _number(x) for name, x in findings.surrogate_error.items()},
    }
    missed = underfit_channels(findings)
    if missed:
        answer["caveat"] = (
            f"the stand-in misses the simulation's own recording in {missed}: what is smaller "
            "than that cannot be seen"
        )
    if findings.missing_channels:
        answer["scope"] = {
            "lacking": [lack.text for lack in findings.missing_channels],
            "not_judged": findings.not_judged,
        }
    if findings.unexplained is not None:
        rest = findings.unexplained
        answer["unexplained"] = {
            "equations": rest.equations,
            "share": rest.share,
            "text": rest.text,
            "expression": rest.expression,
        }
    return answer


def write_report(findings: MismatchResult, out: Path) -> None:
    """
    Write the answer, its page with figures and both models into the folder `out`: all or none.

    Raises `UsageError` where it cannot be written.
    """
    with staged_folder(out, (RESULT_FILE, PAGE), FIGURES) as staged:
        texts = {
            RESULT_FILE: json.dumps(as_dict(findings), indent=2) + "\n",
            SIMULATION_FILE: findings.simulation_yaml,
            CORRECTED_FILE: findings.corrected_yaml,
            HELD_OUT_FILE: findings.held_out_yaml or findings.corrected_yaml,
        }
        for name, text in texts.items():
            (staged / name).write_text(text, encoding="utf-8")
        write_page(findings, staged)
