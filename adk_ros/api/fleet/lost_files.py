# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Results whose file was removed: shards and reports of recordings."""

from __future__ import annotations

import json
from pathlib import Path

from adk_ros.fleet.dataset import FleetDataset
from adk_ros.fleet.run_lock import run_lock


def forget_lost_files(out: Path, stage: str, folder: Path, detail: str) -> None:
    """
    Remove the results of a stage whose file is missing, so that it is written again.

    :param folder: of the files. :param detail: the detail of a row that names its file.
    :raises UsageError: `out` is in use or cannot be written.
    """
    dataset = FleetDataset(out)
    lost = set()
    for row in dataset.rows(stage):
        name = json.loads(row["details"] or "{}").get(detail)
        if name is not None and not (folder / name).is_file():
            lost.add(row["key"])
    if lost:
        with run_lock(out):
            dataset.drop(stage, lost)
