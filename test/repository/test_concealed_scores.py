# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scores of an interrupted list are the same after they have been kept and restored."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

from concealed_scores import keep, restore

from adk_ros.bench.mismatch.case_score import score_case
from adk_ros.bench.mismatch.mismatch_bench import SCORED


def written(out: Path, name: str) -> str:
    """Write a score as the benchmark does; return its text."""
    label = {"effects": [], "kind": "none", "strength": 1.0}
    score = asdict(score_case(name, label, {"verdict": "none", "effects": []}))
    text = json.dumps({"key": f"{name}_key", "label": label, "score": score}, indent=1)
    (out / name).mkdir(parents=True)
    (out / name / SCORED).write_text(text, encoding="utf-8")
    return text


def test_kept_and_restored_scores_are_the_same(tmp_path: Path) -> None:
    out, other, file = tmp_path / "out", tmp_path / "other", tmp_path / "scores.json"
    texts = {name: written(out, name) for name in ("clean_00", "payload_1")}
    (out / "unfinished").mkdir()
    assert keep(out, file) == 2
    # What has been computed since stays.
    later = written(other, "clean_00").replace("clean_00_key", "later")
    (other / "clean_00" / SCORED).write_text(later, encoding="utf-8")
    assert restore(file, other) == 1
    assert (other / "clean_00" / SCORED).read_text(encoding="utf-8") == later
    assert (other / "payload_1" / SCORED).read_text(encoding="utf-8") == texts["payload_1"]
