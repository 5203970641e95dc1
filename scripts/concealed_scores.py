# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Keep the scores of an interrupted `adk bench concealed --out OUT` in one file, or restore them.

    python scripts/concealed_scores.py keep OUT FILE
    python scripts/concealed_scores.py restore FILE OUT

With the scores restored, `--resume` goes on on another machine, at the same code: each score has
the hash of code and case. The reports of the cases are not kept.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from adk_ros.bench.mismatch.mismatch_bench import SCORED


def keep(out: Path, file: Path) -> int:
    """Write the scores of the cases in `out`, by name of the case; return their number."""
    scores = {
        path.parent.name: json.loads(path.read_text(encoding="utf-8"))
        for path in sorted(out.glob(f"*/{SCORED}"))
    }
    lines = [f"{json.dumps(name)}: {json.dumps(score)}" for name, score in scores.items()]
    file.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
    return len(scores)


def restore(file: Path, out: Path) -> int:
    """Write each score of a file to its folder in `out`, unless it is there; return how many."""
    scores = json.loads(file.read_text(encoding="utf-8"))
    written = 0
    for name, score in scores.items():
        path = out / name / SCORED
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(json.dumps(score, indent=1), encoding="utf-8")
            written += 1
    return written


def main() -> None:
    """Run one of the two."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("keep", "restore"))
    parser.add_argument("source", type=Path)
    parser.add_argument("target", type=Path)
    arguments = parser.parse_args()
    run = keep if arguments.what == "keep" else restore
    print(f"{run(arguments.source, arguments.target)} scores")


if __name__ == "__main__":
    main()
