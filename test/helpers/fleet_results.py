# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Results of a fleet's stage without workers."""

from pathlib import Path

from adk_ros.fleet.columns import checked_row
from adk_ros.fleet.dataset import FleetDataset
from adk_ros.fleet.plan import plan
from adk_ros.fleet.recordings import content_hash, find_recordings
from adk_ros.fleet.run import result_rows
from adk_ros.fleet.stage import Stage, version_of
from adk_ros.fleet.stage_process import call


def filled(drives: Path, out: Path, stage: Stage) -> FleetDataset:
    """Write the results of a stage as a run does, in this process."""
    recordings = find_recordings([str(drives)])
    hashes = {(x.uri, x.version): content_hash(x) for x in recordings}
    dataset = FleetDataset(out)
    dataset.append_hashes(
        [
            {"uri": x.uri, "version": x.version, "content_hash": hashes[x.uri, x.version]}
            for x in recordings
        ]
    )
    version = version_of(stage)
    for work in plan(version, recordings, hashes, dataset).missing:
        reply = call(
            lambda path: [checked_row(row) for row in stage.run(path, path.name)],
            [drives / work.recordings[0].name],
        )
        dataset.append(stage.name, result_rows(version, work, reply))
    return dataset
