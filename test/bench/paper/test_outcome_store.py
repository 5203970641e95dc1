# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""An interrupted benchmark continues with the jobs that had not finished."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.paper import case_score

from adk_ros.bench.paper import paper_bench
from adk_ros.bench.paper.cases import CLEAN, NOISY, NOMINAL
from adk_ros.bench.paper.online_effect import Reading
from adk_ros.bench.paper.outcome_store import OutcomeStore
from adk_ros.bench.paper.paper_bench import run_paper
from adk_ros.bench.paper.training_jobs import BenchPlan, NoteProgress, Outcome, TrainingJob
from adk_ros.errors import UsageError
from adk_ros.signals.interval_scores import score_intervals

PLAN = BenchPlan(
    seeds=1, tests=(NOMINAL,), left_out=("aldk", "dk", "effect", "tuned", "floor"), peers=False
)


def outcome(job: TrainingJob) -> Outcome:
    return Outcome(job, scores=[(NOMINAL, job.kind, case_score(0.5))], notes={"a": "b"})


def test_an_outcome_is_as_it_was(tmp_path: Path) -> None:
    store = OutcomeStore.opened(tmp_path / "store", "key", resume=False)
    first, other = TrainingJob("naive", CLEAN), TrainingJob("naive", NOISY)
    assert store.load(first) is None
    rng = np.random.default_rng(1)
    measured = rng.normal(size=(30, 5, 3))
    measured[:, 4] = np.nan
    intervals = score_intervals(np.zeros_like(measured), np.ones_like(measured), measured)
    score = replace(case_score(1.0 / 3.0), intervals=intervals)
    reading = Reading(6, 30, 1e-8, True, "innovation", *rng.normal(size=(3, 3)))
    kept = Outcome(first, [(NOMINAL, "a", score)], [reading], {"a": "b"}, {"fitting": 1.5}, "no")
    store.save(kept)
    found = OutcomeStore.opened(tmp_path / "store", "key", resume=True).load(first)
    assert found is not None
    assert (found.job, found.notes, found.seconds, found.failed) == (
        first, kept.notes, kept.seconds, "no",
    )  # fmt: skip
    (again,), (read,) = found.scores, found.readings
    assert again[:2] == (NOMINAL, "a")
    for mine, theirs in ((again[2], score), (again[2].intervals, intervals), (read, reading)):
        for name, value in vars(theirs).items():
            if isinstance(value, np.ndarray):
                np.testing.assert_array_equal(getattr(mine, name), value)
                assert getattr(mine, name).dtype == value.dtype
    assert again[2].held is None
    assert store.load(other) is None


@pytest.mark.parametrize(("key", "resume"), [("other code", True), ("key", False)])
def test_outcomes_of_another_run_are_not_used(tmp_path: Path, key: str, resume: bool) -> None:
    job = TrainingJob("naive", CLEAN)
    OutcomeStore.opened(tmp_path / "store", "key", resume=False).save(outcome(job))
    assert OutcomeStore.opened(tmp_path / "store", key, resume).load(job) is None


def test_a_folder_of_something_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(UsageError, match="holds something else"):
        OutcomeStore.opened(tmp_path, "key", resume=False)
    assert (tmp_path / "thesis.tex").exists()


def test_finished_jobs_are_not_run_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ran: list[TrainingJob] = []

    def job(about: TrainingJob, plan: BenchPlan, folder: Path, tell: NoteProgress) -> Outcome:
        if len(ran) == 2:
            raise KeyboardInterrupt
        ran.append(about)
        return outcome(about)

    monkeypatch.setattr(paper_bench, "KINDS", dict.fromkeys(("simulate", "default", "naive"), job))
    store = OutcomeStore.opened(tmp_path / "store", "key", resume=False)
    with pytest.raises(KeyboardInterrupt):
        run_paper(PLAN, tmp_path, 0, store=store)
    before, ran[:] = list(ran), []
    again = OutcomeStore.opened(tmp_path / "store", "key", resume=True)
    with pytest.raises(KeyboardInterrupt):
        run_paper(PLAN, tmp_path, 0, store=again)
    assert not set(before) & set(ran)
    middle, ran[:] = list(ran), []
    result = run_paper(PLAN, tmp_path, 0, store=again)
    assert len({*before, *middle, *ran}) == len(before) + len(middle) + len(ran) == 5
    assert len(result.outcomes) == 5
