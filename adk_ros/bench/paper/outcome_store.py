# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Outcomes of finished jobs in a folder, so that an interrupted run continues.

They are pickles that this module wrote itself: the folder must be one that nobody else writes.
"""

from __future__ import annotations

import pickle
from dataclasses import dataclass
from pathlib import Path
from shutil import rmtree

from adk_ros.bench.paper.training_jobs import Outcome, TrainingJob
from adk_ros.errors import UsageError

_KEY = "run.txt"


@dataclass(frozen=True)
class OutcomeStore:
    """Outcomes in a folder."""

    folder: Path

    @classmethod
    def opened(cls, folder: Path, key: str, resume: bool) -> OutcomeStore:
        """
        Return the store in a folder; what another run, of another `key`, left there is removed.

        :param key: text on which all outcomes depend: code, drives and plan.
        :param resume: keep the outcomes of an earlier run of the same key.
        :raises UsageError: the folder holds something else.
        """
        written = folder / _KEY
        is_ours = written.is_file()
        if folder.exists() and any(folder.iterdir()) and not is_ours:
            raise UsageError(f"{folder} is needed for finished jobs and holds something else")
        if is_ours and not (resume and written.read_text(encoding="utf-8") == key):
            rmtree(folder)
        folder.mkdir(parents=True, exist_ok=True)
        written.write_text(key, encoding="utf-8")
        return cls(folder)

    def load(self, job: TrainingJob) -> Outcome | None:
        """Return the outcome of a job, None if it has not finished."""
        path = self._path(job)
        if not path.is_file():
            return None
        outcome = pickle.loads(path.read_bytes())
        return outcome if isinstance(outcome, Outcome) and outcome.job == job else None

    def save(self, outcome: Outcome) -> None:
        """Keep an outcome; a process that is killed meanwhile leaves no half one."""
        path = self._path(outcome.job)
        scratch = path.with_suffix(".part")
        scratch.write_bytes(pickle.dumps(outcome))
        scratch.replace(path)

    def _path(self, job: TrainingJob) -> Path:
        parts = (job.kind, job.variant, str(job.seed), job.about)
        return self.folder / f"{'-'.join(x for x in parts if x)}.outcome"
