# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Results whose file was removed are computed again, all others kept."""

import json
from pathlib import Path
from typing import Any

from adk_ros.api.fleet.lost_files import forget_lost_files
from adk_ros.fleet.dataset import FleetDataset


def test_only_results_without_their_file_are_forgotten(tmp_path: Path) -> None:
    (tmp_path / "kept.npy").touch()
    row: dict[str, Any] = {"status": "ok", "kind": "block"}
    rows = [
        row | {"recording": "a", "key": "1", "details": json.dumps({"shard": "kept.npy"})},
        row | {"recording": "b", "key": "2", "details": json.dumps({"shard": "lost.npy"})},
        row | {"recording": "b", "key": "2", "details": json.dumps({"shard": "kept.npy"})},
        row | {"recording": "c", "key": "3", "details": json.dumps({"other": 1})},
        row | {"recording": "d", "key": "4", "details": None},
    ]
    dataset = FleetDataset(tmp_path)
    dataset.append("shards", rows)
    forget_lost_files(tmp_path, "shards", tmp_path, "shard")
    assert sorted(each["recording"] for each in dataset.rows("shards")) == ["a", "c", "d"]
