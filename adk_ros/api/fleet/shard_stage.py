# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Stage `shards`: the samples of a recording as a shard, and the blocks that it has."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from adk_ros.bags.recording import RecordingOptions
from adk_ros.errors import DataError
from adk_ros.fleet.stage import hash_of

SHARDS = "shards"


@dataclass(frozen=True)
class ShardStage:
    """
    What `adk fleet train` reads recordings into.

    `folder`: where the shards are written, seen by all workers under this path. `options`: topics
    and sensor configuration. Rows: kind `block` with the driving condition, the learnable seconds
    as value and rows of the shard in details; `warning` for what the reader says.
    """

    folder: str
    options: RecordingOptions = field(default_factory=RecordingOptions)
    name: str = SHARDS

    @property
    def inputs_hash(self) -> str:
        """Hash of topics and sensor configuration."""
        return hash_of([asdict(self.options)])

    @property
    def shared_paths(self) -> tuple[str, ...]:
        """Folder of the shards."""
        return (self.folder,)

    def run(self, path: Path, recording: str) -> list[dict[str, Any]]:
        """Return the rows of a recording, and write its shard."""
        from adk_ros.api.recording import read_recording
        from adk_ros.fleet.training.blocks import blocks_of
        from adk_ros.fleet.training.shards import write_shard

        read = read_recording(path, self.options)
        if read.topics.command is None:
            # Its zeros would be learned as the commands of the other recordings' motion.
            raise DataError(
                f"{path.name}: no command: the model of a fleet is trained on commands; train a "
                "model of such recordings with adk train"
            )
        shard = write_shard(read.record, Path(self.folder))
        rows: list[dict[str, Any]] = [
            {
                "kind": "block",
                "finding": "training data",
                "condition": block.condition,
                "value": block.learnable_s,
                "unit": "s",
                "details": {
                    "shard": shard,
                    "start": block.start,
                    "stop": block.stop,
                    "estimated": read.record.estimated,
                },
            }
            for block in blocks_of(read.record)
        ]
        rows += [{"kind": "warning", "finding": SHARDS, "text": text} for text in read.warnings]
        return rows
