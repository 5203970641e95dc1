# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The benchmark report: a self-contained HTML page, with tables and figures as files."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from adk_ros.bench.paper.cases import AHEAD, DROPPED, FORCE_NOISE, HISTORY, NOISE, TRAINING_SHARE
from adk_ros.bench.paper.claims import RULE, Claim, counts
from adk_ros.bench.paper.claims_list import check_claims as judge_claims
from adk_ros.bench.paper.claims_list import compared_with
from adk_ros.bench.paper.criteria import brief, evaluate_paper_criteria
from adk_ros.bench.paper.criterion import (
    CRITERIA_FILE,
    EARLIER_CRITERIA_FILE,
    FAIL,
    PASS,
    Criterion,
)
from adk_ros.bench.paper.effect_text import effect_tables, effect_text
from adk_ros.bench.paper.failure_analysis import explain_failures
from adk_ros.bench.paper.headline import NOT_RUN, Headline, headline
from adk_ros.bench.paper.paper_bench import Result
from adk_ros.bench.paper.paper_figures import write_figures
from adk_ros.bench.paper.paper_results import PAPER_BATCH, PAPER_EPOCHS
from adk_ros.bench.paper.paper_tables import (
    Table,
    coverage_tables,
    horizon_tables,
    one_step_tables,
    recording_tables,
)
from adk_ros.bench.paper.predictors import ADK_ROS, ORACLE
from adk_ros.bench.paper.ratios import ratio_tables, summary_table
from adk_ros.bench.paper.scores import HORIZONS, UNITS, divergence_limits
from adk_ros.bench.paper.training_jobs import BenchPlan, read_series
from adk_ros.files.output_folder import staged_folder
from adk_ros.files.pages.page import embed, render_page
from adk_ros.files.pages.provenance import Provenance
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.score import REPORT_SCALE

PAGE = "report.html"


@dataclass(frozen=True)
class PaperReport:
    """The written page, and the criteria, claims and times on it."""

    page: Path
    criteria: list[Criterion]
    claims: list[Claim]
    times: Table


def write_report(
    result: Result,
    plan: BenchPlan,
    scratch: Path,
    out: Path,
    *,
    provenance: Provenance | None = None,
) -> PaperReport:
    """
    Write the page, `headline.md`, `tables/`, `figures/`, `claims.md`, `criteria.txt` and more.

    `scratch` is the folder with the predictions of the run. An earlier report in `out` is replaced
    when the new one is complete.
    """
    with staged_folder(out, (PAGE,), (EARLIER_CRITERIA_FILE,)) as staged:
        return replace(_write(result, plan, scratch, staged, provenance), page=out / PAGE)


def _write(
    result: Result, plan: BenchPlan, scratch: Path, out: Path, provenance: Provenance | None
) -> PaperReport:

    def series(test: str, name: str) -> tuple[FloatArray, ...]:
        return read_series(scratch, plan, test, name)

    board = result.board
    folders = {name: out / name for name in ("tables", "figures")}
    for folder in folders.values():
        folder.mkdir()
    top = headline(board, how_made(plan))
    groups = {
        "Ratios to the best naive predictor": [summary_table(board), *ratio_tables(board)],
        "One step ahead": one_step_tables(board),
        "Rollouts of 0.25 to 2 s": horizon_tables(board),
        "Coverage of the 90 % intervals": coverage_tables(board),
    }
    if result.recorded is not None:
        groups["Recordings of a real car"] = recording_tables(result.recorded)
    if result.readings:
        groups["Readings of the paper's effect"] = effect_tables(result.readings)
    for tables in groups.values():
        for table in tables:
            table.write(folders["tables"])
    top.write(out)
    board.write_csv(out / "scores.csv")
    figures = write_figures(board, series, folders["figures"])
    criteria = evaluate_paper_criteria(board, result.recorded, result.without)
    claims = judge_claims(board, series)
    times = times_table(result)
    (out / CRITERIA_FILE).write_text("".join(f"{criterion}\n" for criterion in criteria))
    (out / "claims.md").write_text(_claims_text(claims, effect_text(result.readings)))
    page = render_page(
        "adk_ros.bench.paper", "page.html.j2", provenance,
        lead=lead_text(top, criteria), criteria=criteria,
        claims=claims, rule=RULE, count=counts(claims),
        naive_comparisons=compared_with(board), readings=effect_text(result.readings),
        groups=groups, times=times,
        setting=setting_text(result, plan), notes=result.settings, headline=top,
        why=explain_failures(board, result.recorded, criteria), brief=brief,
        figures={title: embed(path, title) for title, path in figures.items()},
    )  # fmt: skip
    path = out / PAGE
    path.write_text(page, encoding="utf-8")
    return PaperReport(path, criteria, claims, times)


def lead_text(top: Headline, criteria: list[Criterion]) -> str:
    """Return the main result: where adk_ros has the lowest error, and the criteria it meets."""
    names = {row[0] for table in top.tables for row in table.rows if NOT_RUN not in row}
    lowest = sum(
        table.rows[row][0] == ADK_ROS for table in top.tables for row, column in table.best
    )
    verdicts = [item.verdict for item in criteria]
    passed, failed = verdicts.count(PASS), verdicts.count(FAIL)
    return (
        f"{ADK_ROS} has the lowest mean error of {len(names - {ORACLE})} predictors in {lowest} "
        f"of {len(top.tables) * len(HORIZONS)} columns (a horizon of a variant) below, and meets "
        f"{passed} of {passed + failed} acceptance criteria."
    )


def how_made(plan: BenchPlan) -> str:
    """Return the training effort of the run in one to three sentences."""
    seeds = f"mean of {plan.seeds} seeds" if plan.seeds > 1 else "one seed"
    text = (
        f"{ADK_ROS}: {plan.train.steps} training steps, {seeds}; DK and ALDK: {plan.paper_epochs} "
        f"epochs in batches of {plan.paper_batch} (the paper: {PAPER_EPOCHS} in batches of "
        f"{PAPER_BATCH})."
    )
    if plan.quick:
        text += " The option --quick shortened these trainings."
    if _shortened(plan):
        text += " The tests were shortened: a trial run, not a result."
    return text


def _shortened(plan: BenchPlan) -> bool:
    return plan.durations.train is not None or plan.durations.test is not None


def setting_text(result: Result, plan: BenchPlan) -> dict[str, Any]:
    """Return the settings of the run that the page states."""
    return {
        "quick": plan.quick,
        "seeds": plan.seeds,
        "tests": result.board.tests(),
        "variants": result.board.variants(),
        "epochs": plan.paper_epochs,
        "batch": plan.paper_batch,
        "steps": plan.train.steps,
        "stride_s": plan.stride * 0.025,
        "paper_epochs": PAPER_EPOCHS,
        "paper_batch": PAPER_BATCH,
        "noise": [
            f"{sigma:.2g} {unit}" for sigma, unit in zip(NOISE * REPORT_SCALE, UNITS, strict=True)
        ],
        "divergence_limits": divergence_limits(),
        "force_noise": FORCE_NOISE,
        "dropped": DROPPED,
        "share": TRAINING_SHARE,
        "history": HISTORY,
        "ahead_s": AHEAD * 0.025,
        "without": result.without,
        "minutes": result.seconds / 60.0,
        "shortened": _shortened(plan),
        "train_s": plan.durations.train,
        "test_s": plan.durations.test,
    }


def times_table(result: Result) -> Table:
    """Return the seconds by job and part; jobs run in parallel, so the sum exceeds the total."""
    parts = list(dict.fromkeys(part for o in result.outcomes for part in o.seconds))
    rows = [
        [o.job.name, *(f"{o.seconds[p]:.1f}" if p in o.seconds else "" for p in parts)]
        for o in result.outcomes
        if o.job.kind != "simulate"
    ]
    simulations = [o for o in result.outcomes if o.job.kind == "simulate"]
    simulated = {p: sum(o.seconds.get(p, 0.0) for o in simulations) for p in parts}
    rows.insert(
        0,
        [
            f"simulate {len(simulations)} recordings",
            *(f"{v:.1f}" if v else "" for v in simulated.values()),
        ],
    )
    sums = {p: sum(o.seconds.get(p, 0.0) for o in result.outcomes) for p in parts}
    rows.append(["all, one after the other", *(f"{v:.1f}" for v in sums.values())])
    title = f"Seconds by job; {result.seconds:.0f} s in all, jobs in parallel"
    return Table("times", title, ["job", *parts], rows, (len(rows) - 1,))


def _claims_text(claims: list[Claim], readings: list[str]) -> str:
    lines = ["# The paper's claims", "", RULE, "", counts(claims), ""]
    for claim in claims:
        lines.append(f"- **{claim.verdict}** ({claim.section}): {claim.text}")
        lines += [f"  - {item.outcome}: {item.text}" for item in claim.comparisons]
    if readings:
        lines += ["", "## Readings of the paper's effect", "", *(f"- {x}" for x in readings)]
    return "\n".join(lines) + "\n"
