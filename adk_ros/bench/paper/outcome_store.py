# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Outcomes of finished jobs in a folder, so that an interrupted run continues."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from shutil import rmtree
from typing import Any

import numpy as np

from adk_ros.bench.paper.online_effect import Reading
from adk_ros.bench.paper.scores import CaseScore
from adk_ros.bench.paper.training_jobs import Outcome, TrainingJob
from adk_ros.errors import UsageError
from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.signals.interval_scores import IntervalScore

_KEY = "run.txt"
_COUNTS = ("count", "diverged", "covered", "claimed")
"""Arrays of whole numbers; the others are of floats, which JSON keeps exactly."""


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
        content = json.loads(path.read_text(encoding="utf-8"))
        scores = [(test, name, _score(x)) for test, name, x in content.pop("scores")]
        readings = [Reading(**_arrays(x)) for x in content.pop("readings")]
        del content["job"]
        return Outcome(job, scores, readings, **content)

    def save(self, outcome: Outcome) -> None:
        """Keep an outcome; a process that is killed meanwhile leaves no half one."""
        path = self._path(outcome.job)
        scratch = path.with_suffix(".part")
        text = json.dumps(asdict(outcome), default=np.ndarray.tolist)
        scratch.write_text(text, encoding="utf-8")
        scratch.replace(path)

    def _path(self, job: TrainingJob) -> Path:
        parts = (job.kind, job.variant, str(job.seed), job.about)
        return self.folder / f"{'-'.join(x for x in parts if x)}.outcome"


def _score(content: dict[str, Any]) -> CaseScore:
    parts = {x: content.pop(x) for x in ("intervals", "held")}
    intervals, held = (
        None if part is None else IntervalScore(**_arrays(part)) for part in parts.values()
    )
    return CaseScore(**_arrays(content), intervals=intervals, held=held)


def _arrays(content: dict[str, Any]) -> dict[str, Any]:
    """Return fields with lists as arrays."""
    return {k: _array(k, v) if isinstance(v, list) else v for k, v in content.items()}


def _array(name: str, values: list[Any]) -> FloatArray | IntArray:
    if name in _COUNTS:
        return np.array(values, dtype=np.int64)
    return np.array(values, dtype=np.float64)
