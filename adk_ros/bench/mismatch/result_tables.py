# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Result files of the benchmark: cases as Markdown and JSON, acceptance criteria as text."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from adk_ros.bench.mismatch.acceptance import Criterion
from adk_ros.bench.mismatch.baselines import ADK_MISMATCH, NAMING, STRONGEST
from adk_ros.bench.mismatch.breakdown import breakdown
from adk_ros.bench.mismatch.case_score import UNKNOWN, CaseResult
from adk_ros.bench.mismatch.factorial import results_by_factor
from adk_ros.bench.mismatch.reliability import (
    brier_score,
    reliability_table,
    write_reliability,
)
from adk_ros.bench.paper.criterion import CRITERIA_FILE, EARLIER_CRITERIA_FILE
from adk_ros.bench.paper.paper_tables import markdown_line
from adk_ros.numerics.finite import finite

TABLE, SCORES, BASELINES_FILE = "cases.md", "cases.json", "beside.md"
FACTORS_FILE, BREAKDOWN_FILE = "factors.md", "breakdown.md"
_HEADER = (
    "case",
    "correct",
    "F1 of names",
    "injected",
    "identified",
    "parameter errors",
    "in interval",
    "IoU",
    "held-out error removed",
    "wall time (s)",
    "CPU time (s)",
    "memory (MiB)",
)


def case_row(s: CaseResult) -> list[str]:
    """Return the table row of a case."""
    return [
        s.case,
        f"{s.right:.2f}",
        f"{s.f1:.2f}",
        s.label,
        s.failure or s.reported,
        ", ".join(f"{name} {100.0 * x:.1f} %" for name, x in s.errors.items()),
        f"{sum(s.covered.values())} of {len(s.covered)}" if s.covered else "",
        ", ".join(f"{x:.2f}" for x in s.iou.values()),
        ", ".join(f"{name} {100.0 * x:.0f} %" for name, x in s.removed.items()),
        f"{s.seconds:.0f}",
        f"{s.cpu_s:.0f}",
        f"{s.memory_mib:.0f}",
    ]


def markdown(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table."""
    return "".join(f"{markdown_line(row)}\n" for row in (header, ["---"] * len(header), *rows))


def cases_markdown(scores: Sequence[CaseResult]) -> str:
    """Return the table of all cases."""
    return markdown(_HEADER, [case_row(s) for s in scores])


def baseline_results(scores: Sequence[CaseResult]) -> tuple[list[str], list[list[str]]]:
    """
    Return header and rows of the comparison of methods, over all cases that they were run on.

    Named correctly: share of the cases with injected catalogue effects; no false alarm: share of
    the cases without a mismatch in which none is reported; removed: mean reduction of the held-out
    residual in the equation with the largest one, over all cases with a significant residual.
    """
    ran = [s for s in scores if s.baselines]
    methods = [row["method"] for row in ran[0].baselines] if ran else []
    rows = []
    for i, method in enumerate(methods):
        listed = [s.baselines[i] for s in ran if s.kind not in {"none", UNKNOWN}]
        clean = [s.baselines[i] for s in ran if s.kind == "none"]
        reductions = [
            row["removed"][row[STRONGEST]]
            for s in ran
            if s.kind != "none"
            for row in (s.baselines[i],)
            if row[STRONGEST]
        ]
        names = method in (ADK_MISMATCH, *NAMING)
        rows.append(
            [
                method,
                _percent([float(r["right"]) for r in listed]) if names else "names no effect",
                _percent([float(r["abstains"]) for r in clean]),
                _percent(reductions),
            ]
        )
    header = [
        "method",
        "named correctly",
        "no false alarm without a mismatch",
        "held-out residual removed",
    ]
    return header, rows


def _percent(values: Sequence[float]) -> str:
    return f"{100.0 * float(np.mean(values)):.0f} % of {len(values)}" if values else "no case"


def baselines_markdown(scores: Sequence[CaseResult]) -> str:
    """Return the comparison of methods, overall and by case; "" if none were run."""
    header, rows = baseline_results(scores)
    if not rows:
        return ""
    each = [
        [
            s.case, s.label, row["method"], row["names"] or "-",
            "yes" if row["abstains"] else "no",
            ", ".join(f"{name} {100.0 * x:.0f} %" for name, x in row["removed"].items()),
            row[STRONGEST] or "-",
        ]
        for s in scores for row in s.baselines
    ]  # fmt: skip
    columns = (
        "case", "injected", "method", "identified", "reports no mismatch", "removed",
        "strongest equation",
    )  # fmt: skip
    return f"{markdown(header, rows)}\n{markdown(columns, each)}"


def case_json(result: CaseResult) -> dict[str, Any]:
    """Return a case for JSON, under the keys of the first release; not finite values are null."""
    content = asdict(result)
    content["claims"] = [claim._asdict() for claim in result.claims]
    content["said"], content["beside"] = content.pop("reported"), content.pop("baselines")
    return dict(finite(content))


def as_json(scores: Sequence[CaseResult], criteria: Sequence[Criterion]) -> dict[str, Any]:
    """Return criteria, reliability and cases for JSON; values that are not finite become null."""
    claims = [claim for result in scores for claim in result.claims]
    reliability = {
        "brier_score": brier_score(claims),
        "bins": [b._asdict() for b in reliability_table(claims)],
    }
    return {
        "reliability": finite(reliability),
        "criteria": [asdict(criterion) for criterion in criteria],
        "cases": [case_json(s) for s in scores],
    }


def write_tables(scores: Sequence[CaseResult], criteria: Sequence[Criterion], out: Path) -> None:
    """
    Write cases, criteria and reliability of the claims, and `beside.md` if baselines ran.

    Cases: `cases.md`, `cases.json`; criteria: `criteria.txt`; results by simulator and noise:
    `factors.md`; what the criteria average over: `breakdown.md`; reliability: table and diagram.
    """
    out.mkdir(parents=True, exist_ok=True)
    text = json.dumps(as_json(scores, criteria), indent=1) + "\n"
    (out / SCORES).write_text(text, encoding="utf-8")
    (out / TABLE).write_text(cases_markdown(scores), encoding="utf-8")
    by_factor = markdown(*results_by_factor(scores))
    (out / FACTORS_FILE).write_text(by_factor, encoding="utf-8")
    lines = "".join(f"- {line}\n" for line in breakdown(scores))
    (out / BREAKDOWN_FILE).write_text(lines, encoding="utf-8")
    comparison = baselines_markdown(scores)
    if comparison:
        (out / BASELINES_FILE).write_text(comparison, encoding="utf-8")
    write_reliability([claim for result in scores for claim in result.claims], out)
    lines = "".join(f"{criterion}\n" for criterion in criteria)
    (out / CRITERIA_FILE).write_text(lines, encoding="utf-8")
    (out / EARLIER_CRITERIA_FILE).unlink(missing_ok=True)
