# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print which single effects of a list of `adk bench concealed --own` have a detectable size.

    python scripts/concealed_detectable.py OUT --seed 23 --strength 0.3

OUT is the folder of the list. Each case is generated again, and `adk detectable` states the size
for as much driving. The list does this itself for the weakest strength; for others it is a
question asked afterwards: are the effects that were missed below the size that is stated?
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path

from adk_ros.bench.mismatch.case_matrix import CasePlan, case_plans
from adk_ros.bench.mismatch.case_score import detectable
from adk_ros.bench.mismatch.mismatch_bench import SCORED, SIZES, detectable_sizes
from adk_ros.bench.mismatch.subprocesses import Subprocesses
from adk_ros.bench.vehicles.multibody import MULTI_BODY


def _is_detectable(plan: CasePlan, report: Path) -> bool | None:
    """Return whether the effect reaches its detectable size; the sizes are kept in the report."""
    with tempfile.TemporaryDirectory() as folder:
        case = plan.write(Path(folder))
        label = json.loads((case / "label.json").read_text(encoding="utf-8"))
        sizes = detectable_sizes(case, label, report / SIZES, Subprocesses())
    return detectable(label, sizes)


def main() -> None:
    """Print one line per case, and the share of right answers above and below."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--strength", type=float, default=0.3)
    given = parser.parse_args()
    right: dict[bool | None, list[float]] = {True: [], False: [], None: []}
    for plan in case_plans(given.seed):
        scored = given.out / plan.name / SCORED
        if plan.strength != given.strength or plan.plant == MULTI_BODY or not scored.exists():
            continue
        score = json.loads(scored.read_text(encoding="utf-8"))["score"]
        if score["kind"] != "single":
            continue
        reached = _is_detectable(plan, given.out / plan.name)
        right[reached].append(score["right"])
        size = {True: "detectable", False: "below", None: "no size"}[reached]
        print(
            f"{plan.name:36} {size:10} right {score['right']:g}  {score['reported']}", flush=True
        )
    for words, values in (
        ("of a detectable size", right[True]),
        ("below it", right[False]),
        ("without a size", right[None]),
    ):
        share = f"{sum(values) / len(values):.3f}" if values else "no share"
        print(f"{words}: {share} of {len(values)}")


if __name__ == "__main__":
    main()
