# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Runs `adk mismatch` on a folder of cases, each in a process of its own, and scores the answers.

A case is a folder with `simulation`, `recording`, `heldout`, `vehicle.yaml` and `label.json`. The
tool is given the first two and the vehicle; the label is read when the answer is there.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from adk_ros.bench.concealed.own_list import chosen
from adk_ros.bench.concealed.score import Score, score
from adk_ros.errors import UsageError
from adk_ros.mismatch.model_file import load_stand_in
from adk_ros.mismatch.open_loop import FIRST_START_S, errors_ahead
from adk_ros.mismatch.reading import read_evidence
from adk_ros.signals.channels import STATE_NAMES

HORIZON_S = 1.0

Progress = Callable[[float, float, str], None]


def find_cases(folder: Path) -> list[Path]:
    """
    Return the cases in a folder, by name.

    Raises `UsageError` where there is none.
    """
    if not folder.is_dir():
        raise UsageError(f"{folder} is no folder: give one that holds cases")
    cases = sorted(path.parent for path in folder.glob("*/label.json"))
    if not cases:
        raise UsageError(f"{folder} holds no case: a folder with label.json and its recordings")
    return cases


def run_case(case: Path, out: Path) -> Score:
    """Run the tool on one case and score its answer."""
    command = [
        sys.executable, "-m", "adk_ros.cli.main", "mismatch",
        "--simulation", str(case / "simulation"), "--recording", str(case / "recording"),
        "--vehicle", str(case / "vehicle.yaml"), "--out", str(out),
    ]  # fmt: skip
    one = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
    started = time.monotonic()
    with subprocess.Popen(
        command, env=os.environ | one, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stderr is not None
        said = process.stderr.read()
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    seconds = time.monotonic() - started
    label = json.loads((case / "label.json").read_text(encoding="utf-8"))
    if process.returncode != 0:
        result = score(case.name, label, {"verdict": "failed"})
        result.failure = said.strip().splitlines()[-1] if said.strip() else "it said nothing"
    else:
        answer = json.loads((out / "mismatch.json").read_text(encoding="utf-8"))
        result = score(case.name, label, answer)
        result.removed = removed(case / "heldout", out)
    result.seconds, result.cpu_s = seconds, usage.ru_utime + usage.ru_stime
    result.memory_mib = usage.ru_maxrss / 1024.0
    return result


def removed(heldout: Path, report: Path) -> dict[str, float]:
    """
    Return by channel the share of the held-out error 1 s ahead that the correction removes.

    What can be removed is what lies above the noise with which odometry reports that channel;
    channels in which the simulation is already there (within 1.5 times) are left out.
    """
    if not heldout.exists():
        return {}
    evidence = read_evidence(heldout, needs_imu=False)
    before, after = (
        errors_ahead(
            load_stand_in(report / name).content, evidence, HORIZON_S, FIRST_START_S
        )
        for name in ("simulation.yaml", "corrected.yaml")
    )
    floor = evidence.noise()[3:]
    return {
        name: float((before[i] - after[i]) / (before[i] - floor[i]))
        for i, name in enumerate(STATE_NAMES)
        if before[i] > 1.5 * floor[i]
    }


def run_all(folder: Path, out: Path, progress: Progress | None = None) -> list[Score]:
    """Run and score all cases of a folder; the reports go into `out`, one folder a case."""
    cases = find_cases(folder)
    results = []
    for i, case in enumerate(cases):
        if progress is not None:
            progress(i, len(cases), case.name)
        results.append(run_case(case, out / case.name))
    if progress is not None:
        progress(len(cases), len(cases), "")
    return results


def run_own(limit: int, out: Path, progress: Progress | None = None) -> list[Score]:
    """Make, run and score cases of our own, one after the other; their bags are not kept."""
    plans = chosen(limit)
    results = []
    for i, plan in enumerate(plans):
        if progress is not None:
            progress(i, len(plans), plan.name)
        with tempfile.TemporaryDirectory() as folder:
            results.append(run_case(plan.write(Path(folder)), out / plan.name))
    return results


def summary(scores: list[Score]) -> dict[str, float]:
    """Return the figures over all cases that the bars are about; NaN where there is no case."""

    def mean(values: list[float]) -> float:
        return float(np.mean(values)) if values else math.nan

    by_kind = {
        kind: [s for s in scores if s.kind == kind]
        for kind in ("none", "single", "pair", "triple", "unknown")
    }
    errors = [x for s in scores for x in s.errors.values()]
    covered = [float(x) for s in scores for x in s.covered.values()]
    iou = [x for s in scores for x in s.iou.values()]
    gone = [x for s in scores for x in s.removed.values() if s.kind not in {"none"}]
    return {
        "cases": len(scores),
        "false_alarms": float(sum(1.0 - s.right for s in by_kind["none"])),
        "clean_cases": len(by_kind["none"]),
        "singles_right": mean([s.right for s in by_kind["single"]]),
        "pairs_f1": mean([s.f1 for s in by_kind["pair"]]),
        "triples_f1": mean([s.f1 for s in by_kind["triple"]]),
        "unknown_right": mean([s.right for s in by_kind["unknown"]]),
        "parameter_error_median": float(np.median(errors)) if errors else math.nan,
        "interval_coverage": mean(covered),
        "iou_median": float(np.median(iou)) if iou else math.nan,
        "removed_median": float(np.median(gone)) if gone else math.nan,
        "seconds_median": float(np.median([s.seconds for s in scores])) if scores else math.nan,
        "cpu_s_median": float(np.median([s.cpu_s for s in scores])) if scores else math.nan,
        "memory_mib_max": max((s.memory_mib for s in scores), default=math.nan),
    }
