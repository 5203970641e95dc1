# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Cases to run, existing or to be generated, each with a key of its specification and the code.

A case is a folder with `simulation`, `recording`, `heldout`, `vehicle.yaml` and `label.json`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

from adk_ros.bench.mismatch.case_matrix import CasePlan
from adk_ros.errors import UsageError
from adk_ros.files.code_digest import code_digest

LABEL = "label.json"


class CaseJob(NamedTuple):
    """
    A case to run: `write(folder)` returns its path; `key` is a hash of its specification.

    `write_noise_free` does the same for the case without sensor noise, if it can be generated.
    `factors`: a criterion to multiply in the analysis, and by how much.
    """

    name: str
    key: str
    write: Callable[[Path], Path]
    write_noise_free: Callable[[Path], Path] | None = None
    factors: Mapping[str, float] | None = None


def find_cases(folder: Path) -> list[Path]:
    """
    Return the cases in a folder, sorted by name.

    :raises UsageError: there is none.
    """
    if not folder.is_dir():
        raise UsageError(f"{folder} is not a folder: give the folder of the cases")
    cases = sorted(path.parent for path in folder.glob(f"*/{LABEL}"))
    if not cases:
        raise UsageError(f"{folder} has no case: a subfolder with label.json and its recordings")
    return cases


def jobs_of(folder: Path) -> list[CaseJob]:
    """Return a job for each case of a folder."""
    return [
        CaseJob(
            case.name,
            _digest((case / LABEL).read_bytes() + code_digest().encode()),
            partial(_existing_case, case),
        )
        for case in find_cases(folder)
    ]


def _existing_case(case: Path, folder: Path) -> Path:
    """Return the path of an existing case, which is used in place."""
    return case


def plan_jobs(plans: Sequence[CasePlan]) -> list[CaseJob]:
    """Return jobs that generate their cases; their key also covers the code of the package."""
    code = code_digest()
    return [
        CaseJob(
            plan.name,
            _digest(f"{plan!r} {code}".encode()),
            plan.write,
            replace(plan, noise=0.0).write,
        )
        for plan in plans
    ]


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:16]
