# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print what the criteria of `adk bench concealed --out OUT` average over, from its cases.

    python scripts/concealed_breakdown.py OUT
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from adk_ros.bench.mismatch.breakdown import breakdown
from adk_ros.bench.mismatch.case_score import CaseResult
from adk_ros.bench.mismatch.mismatch_bench import SCORED
from adk_ros.bench.mismatch.reliability import ScoredClaim


def main() -> None:
    """Print one sentence per figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    scores = []
    for path in sorted(parser.parse_args().out.glob(f"*/{SCORED}")):
        score = CaseResult(**json.loads(path.read_text(encoding="utf-8"))["score"])
        score.claims = [ScoredClaim(*claim) for claim in score.claims]
        scores.append(score)
    for line in breakdown(scores):
        print(line)


if __name__ == "__main__":
    main()
