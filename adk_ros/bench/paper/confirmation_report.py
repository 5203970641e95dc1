# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Write what `adk bench confirm` found: criteria, tables, scores and the drives themselves."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

from adk_ros.bench.paper.cases import NOMINAL
from adk_ros.bench.paper.confirmation_criteria import by_horizon, confirmation_criteria
from adk_ros.bench.paper.criteria import brief
from adk_ros.bench.paper.criterion import Criterion
from adk_ros.bench.paper.other_simulators import DESCRIPTIONS
from adk_ros.bench.paper.paper_bench import Result
from adk_ros.bench.paper.paper_results import PAPER_EPOCHS
from adk_ros.bench.paper.paper_tables import Table, markdown_line
from adk_ros.bench.paper.predictors import ALDK
from adk_ros.bench.paper.ratios import ratio_tables, summary_table
from adk_ros.bench.paper.training_jobs import BenchPlan
from adk_ros.files.output_folder import staged_folder
from adk_ros.plant.scenario.scenario_file import Scenario

PAGE = "confirmation.md"


def write_confirmation(
    result: Result, plan: BenchPlan, scenarios: Path, out: Path, digest: str, seed: str
) -> list[Criterion]:
    """
    Write `confirmation.md`, `scores.csv` and the scenario files; return the criteria.

    :param scenarios: folder of the scenario files. :param digest: hash of the code.
    """
    criteria = [
        *confirmation_criteria(result.board, plan.stride, result.without),
        by_horizon(result.board),
    ]
    with staged_folder(out, (PAGE,)) as staged:
        shutil.copytree(scenarios, staged / "scenarios")
        result.board.write_csv(staged / "scores.csv")
        text = _page(result, plan, criteria, digest, seed)
        (staged / PAGE).write_text(text, encoding="utf-8")
    return criteria


def _page(
    result: Result, plan: BenchPlan, criteria: Sequence[Criterion], digest: str, seed: str
) -> str:
    lines = ["# Confirmation drives", ""]
    trained = f"{plan.seeds} trainings" + " with `--single-track`" * plan.train.single_track
    lines += [f"Code {digest[:16]}, seed `{seed}`, {trained}.", ""]
    if result.board.has(ALDK):
        lines += [
            f"The paper's method is trained for {plan.paper_epochs} epochs in batches of "
            f"{plan.paper_batch} (in the paper {PAPER_EPOCHS}).",
            "",
        ]
    if result.without:
        lines += [f"Without pykoop and pykoopman: {result.without}.", ""]
    lines += [markdown_line(["", "criterion", "figure"]), markdown_line(["---"] * 3)]
    lines += [markdown_line([item.verdict, item.name, brief(item.figure)]) for item in criteria]
    long = [item for item in criteria if brief(item.figure) != item.figure]
    if long:
        lines += ["", "### Combinations that a criterion misses"]
    for item in long:
        listed = item.figure.partition(": ")[2]
        lines += ["", f"**{item.name}**: {listed}."]
    tables = [drives_table(plan), summary_table(result.board), *ratio_tables(result.board)]
    lines += ["", *(table.markdown() for table in tables)]
    lines += [f"- {name}: {text}" for name, text in result.settings.items()]
    return "\n".join(lines) + "\n"


def drives_table(plan: BenchPlan) -> Table:
    """Return the table of the drives, with what differs from training."""
    rows = []
    for test in plan.tests:
        if (other := plan.drives.others.get(test)) is not None:
            rows.append([test, "-", "1.00", f"another simulator: {DESCRIPTIONS[other.plant]}"])
            continue
        scenario = plan.drives.scenario(test)
        speed = f"{3.6 * scenario.speed.top:.0f}"
        rows.append([test, speed, f"{scenario.mu:.2f}", "-" if test == NOMINAL else _of(scenario)])
    title = f"Drives; noise {plan.drives.noise_scale:.2f} times the usual"
    return Table("drives", title, ["test", "top speed (km/h)", "friction", "changes"], rows)


def _of(scenario: Scenario) -> str:
    parts = [f"{key} {_short(value)}" for key, value in scenario.vehicle_changes.items()]
    if scenario.steering is not None:
        # Less than was drawn where the car would have spun.
        parts.append(f"steering {scenario.steering.amplitude:.4f} rad")
    wind = scenario.wind
    if wind.x or wind.y:
        parts.append(f"wind {wind.x:.1f}, {wind.y:.1f} m/s, gusts {wind.gust:.1f}")
    return "; ".join(parts) or "none"


def _short(value: object) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key} {_short(item)}" for key, item in value.items())
    return f"{value:.4g}" if isinstance(value, float) else str(value)
