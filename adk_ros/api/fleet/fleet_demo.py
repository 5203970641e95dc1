# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The demonstration of `adk fleet`: a synthetic fleet, and its result against the truth."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from adk_ros.errors import DataError, UsageError
from adk_ros.fleet.inference.fleet_result import FleetResult

if TYPE_CHECKING:
    from adk_ros.fleet.demo.truth_comparison import TruthComparison


def write_demo_fleet(
    out: Path,
    seed: int,
    quick: bool,
    progress: Callable[[float, float, str], None] | None = None,
    workers: int = 1,
) -> None:
    """
    Simulate a fleet with known faults into the new folder `out`, in `workers` processes.

    An interrupted simulation of the same fleet continues.

    :raises UsageError: the folder exists, with another content.
    """
    from adk_ros.fleet.demo.fleet_folder import write_fleet
    from adk_ros.fleet.demo.fleet_plan import FULL_SIZE, QUICK_SIZE, plan_fleet

    def report(done: int, total: int) -> None:
        if progress is not None:
            progress(done, total, f"{done} of {total} drives")

    write_fleet(plan_fleet(seed, QUICK_SIZE if quick else FULL_SIZE), out, report, workers)


def read_truth(path: Path, seed: int, quick: bool) -> dict[str, Any]:
    """
    Return what is injected in a synthetic fleet, from its `truth.json`.

    :raises DataError: an earlier version of adk_ros has written it.
    :raises UsageError: it is of a fleet of another seed or size.
    """
    from adk_ros.fleet.demo.fleet_plan import FULL_SIZE, QUICK_SIZE

    truth: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    is_complete = (path.parent / "simulation_routes").is_dir()
    if "path" not in truth["place"] or "drives" not in truth or not is_complete:
        raise DataError(f"{path}: written by an earlier version: simulate into a new folder")
    size = QUICK_SIZE if quick else FULL_SIZE
    if (truth["seed"], truth["drives"]) != (seed, size.recordings):
        raise UsageError(
            f"{path.parent} has {truth['drives']} drives of seed {truth['seed']}, not "
            f"{size.recordings} of seed {seed}: give another folder, or its options"
        )
    return truth


def compared_with_truth(result: FleetResult, truth: dict[str, Any]) -> TruthComparison:
    """Compare the result of a synthetic fleet with what `read_truth` returns."""
    from adk_ros.fleet.demo.truth_comparison import compare_with_truth

    return compare_with_truth(result, truth)
