# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a stage process does with one recording, wherever its worker runs."""

from __future__ import annotations

import socket
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from adk_ros.errors import AdkError
from adk_ros.fleet.columns import checked_row
from adk_ros.fleet.recordings import (
    FleetRecording,
    check_unchanged,
    content_hash,
    local_recording,
)
from adk_ros.fleet.stage import Stage, StageOfContent, keeps_recordings
from adk_ros.fleet.stage_process import NotShared


def seen_folder(recording: FleetRecording) -> tuple[str, ...]:
    """Return the folder that a local recording lies in, if this machine sees it."""
    if "://" in recording.uri:
        return ()
    folder = Path(recording.uri).parent
    return (str(folder),) if folder.exists() else ()


def hash_of_recording(recording: FleetRecording, shared: Sequence[str]) -> str:
    """
    Return `content_hash` of a recording: what a stage process runs.

    :param shared: as `run_on_recording`, and raises as that.
    """
    _require(shared)
    return content_hash(recording)


def _require(shared: Sequence[str]) -> None:
    for each in shared:
        if not Path(each).exists():
            raise NotShared(
                f"a worker on {socket.gethostname()} does not see {each}: put it into a folder "
                "that all machines see under this path"
            )


def run_on_recording(
    stage: Stage, recording: FleetRecording, shared: Sequence[str] = (), content: str = ""
) -> list[dict[str, Any]]:
    """
    Return the rows of a stage on one recording: what a stage process runs.

    Texts name the recording by its URI, not by its copy on the disk, which is removed.

    :param shared: paths that the driver sees, and the worker has to see as well.
    :param content: hash of the content, "" if it is not known: what a stage has kept of it is not
        read again.
    :raises NotShared: it does not.
    :raises RecordingChanged: the recording has changed since it was listed.
    """
    _require(shared)
    if content and isinstance(stage, StageOfContent):
        stage = stage.of_content(content)
        kept = stage.run_kept(recording.name) if keeps_recordings(stage) else None
        if kept is not None:
            check_unchanged(recording)
            return [checked_row(row) for row in kept]
    with local_recording(recording) as path:

        def named(value: Any) -> Any:
            is_text = isinstance(value, str)
            return value.replace(str(path), recording.uri) if is_text else value

        try:
            rows = [checked_row(row) for row in stage.run(path, recording.name)]
        except Exception as error:
            # What was read of a file that is being written, moved or replaced says nothing of it.
            check_unchanged(recording)
            if isinstance(error, AdkError):
                error.args = (named(str(error)),)
            raise
        check_unchanged(recording)
        return [{key: named(value) for key, value in row.items()} for row in rows]
