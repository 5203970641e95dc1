# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a run over many cases leaves on disk: the cases as Markdown and JSON, the bars as text."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from adk_ros.bench.mismatch.acceptance import Criterion
from adk_ros.bench.mismatch.baselines import NAMING, OURS
from adk_ros.bench.mismatch.case_score import UNKNOWN, CaseResult
from adk_ros.bench.paper.paper_tables import markdown_line
from adk_ros.numerics.finite import finite

CRITERIA_FILE, TABLE, SCORES, BASELINES_FILE = "bars.txt", "cases.md", "cases.json", "beside.md"
_HEADER = (
    "case",
    "right",
    "set-F1",
    "label",
    "answer",
    "parameters off",
    "in interval",
    "IoU",
    "held-out error removed",
    "s",
    "s CPU",
    "MiB",
)


def case_row(s: CaseResult) -> list[str]:
    """Return what the table says of a case."""
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
    Return header and rows of the methods side by side, over all cases that they were run on.

    Named: share of the cases with something in the catalogue concealed that are named right;
    abstains: share of the clean ones in which nothing is found; removed: the mean share of the
    held-out residual in the equation that has most of it, for all cases that have any.
    """
    ran = [s for s in scores if s.baselines]
    methods = [row["method"] for row in ran[0].baselines] if ran else []
    rows = []
    for i, method in enumerate(methods):
        listed = [s.baselines[i] for s in ran if s.kind not in {"none", UNKNOWN}]
        clean = [s.baselines[i] for s in ran if s.kind == "none"]
        gone = [
            row["removed"][row["telling"]]
            for s in ran
            if s.kind != "none"
            for row in (s.baselines[i],)
            if row["telling"]
        ]
        names = method in (OURS, *NAMING)
        rows.append(
            [
                method,
                _percent([float(r["right"]) for r in listed]) if names else "names nothing",
                _percent([float(r["abstains"]) for r in clean]),
                _percent(gone),
            ]
        )
    return ["method", "named right", "abstains on clean", "held-out residual removed"], rows


def _percent(values: Sequence[float]) -> str:
    return f"{100.0 * float(np.mean(values)):.0f} % of {len(values)}" if values else "no case"


def baselines_markdown(scores: Sequence[CaseResult]) -> str:
    """Return the methods side by side, overall and by case; empty where none were run."""
    header, rows = baseline_results(scores)
    if not rows:
        return ""
    each = [
        [
            s.case, s.label, row["method"], row["names"] or "-",
            "yes" if row["abstains"] else "no",
            ", ".join(f"{name} {100.0 * x:.0f} %" for name, x in row["removed"].items()),
            row["telling"] or "-",
        ]
        for s in scores for row in s.baselines
    ]  # fmt: skip
    what = ("case", "label", "method", "names", "abstains", "removed", "telling equation")
    return f"{markdown(header, rows)}\n{markdown(what, each)}"


def as_json(scores: Sequence[CaseResult], bars: Sequence[Criterion]) -> dict[str, Any]:
    """Return bars and cases as JSON takes them: what is not finite is null."""
    return {"bars": [asdict(bar) for bar in bars], "cases": [finite(asdict(s)) for s in scores]}


def write_tables(scores: Sequence[CaseResult], bars: Sequence[Criterion], out: Path) -> None:
    """Write `cases.md`, `cases.json`, `bars.txt`, if peers ran `beside.md`, into a folder."""
    out.mkdir(parents=True, exist_ok=True)
    text = json.dumps(as_json(scores, bars), indent=1) + "\n"
    (out / SCORES).write_text(text, encoding="utf-8")
    (out / TABLE).write_text(cases_markdown(scores), encoding="utf-8")
    beside = baselines_markdown(scores)
    if beside:
        (out / BASELINES_FILE).write_text(beside, encoding="utf-8")
    (out / CRITERIA_FILE).write_text("".join(f"{bar}\n" for bar in bars), encoding="utf-8")
