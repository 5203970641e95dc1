# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`adk_ros.import_recording` and `propose_map`: recordings of other formats as a bag."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from adk_ros.api.output import bag_files, check_output, remove_earlier_bag
from adk_ros.api.progress import Progress, in_stage
from adk_ros.api.tables import as_html
from adk_ros.errors import UsageError

if TYPE_CHECKING:
    from adk_ros.importing.map_text import Proposal
    from adk_ros.importing.recording_import import ImportedRecording


@dataclass(frozen=True)
class ImportResult:
    """
    An imported recording.

    `out`: the bag. `content`: the channels at the stamps of their sources, and the topics.
    """

    out: Path
    content: ImportedRecording

    @property
    def notes(self) -> list[str]:
        """What was lost, interpolated or assumed, one line each."""
        return list(self.content.notes)

    @property
    def not_imported(self) -> dict[str, str]:
        """Channels of the map that no message holds, with the reason."""
        return dict(self.content.outcome.left_out)

    @cached_property
    def channels(self) -> pd.DataFrame:
        """
        The imported channels, one row each.

        Index `channel`. Columns: `source` column in `table`; `unit`, `factor` and `offset` of the
        conversion; `rate_hz`, `count`; `min` and `max` in `si_unit`; `not_imported`, the reason.
        """
        return pd.DataFrame(self.content.rows()).set_index("channel")

    def as_dict(self) -> dict[str, Any]:
        """Return what `adk import --json` prints."""
        return {
            "out": str(self.out),
            "seconds": round(self.content.duration_s, 3),
            "messages": self.content.message_count,
            "topics": [
                {"name": topic.name, "type": topic.msgtype, "count": len(topic.stream)}
                for topic in self.content.outcome.topics
            ],
            "channels": self.content.rows(),
            "not_imported": self.not_imported,
            "columns_not_in_map": list(self.content.unused),
            "notes": self.notes,
        }

    def _repr_html_(self) -> str:
        return as_html(f"Imported {self.out}", self.channels)


def import_recording(
    files: Path | str | Sequence[Path | str],
    map: Path | str | dict[str, Any],
    out: Path | str,
    *,
    dbc: Sequence[Path | str] = (),
    force: bool = False,
    progress: Progress | None = None,
) -> ImportResult:
    """
    Write the channels of CSV, Parquet, MAT, MDF4, CAN or bag files as a bag.

    :param files: one file or several of the same drive, joined by their times.
    :param map: YAML file that says which column is which channel, or its content.
    :param out: bag to write.
    :param dbc: messages of CAN logs.
    :param force: replace an earlier bag at `out`.
    :raises UsageError: an argument, the map or a unit is wrong, or a library is not installed.
    :raises DataError: a file is empty or unreadable, or nothing in it can be written.

    Example::

        imported = adk_ros.import_recording("drive.csv", "map.yaml", "drive")
        imported.channels[["source", "rate_hz", "min", "max"]]
    """
    from adk_ros.importing.map_loading import checked_map, load_map
    from adk_ros.importing.recording_import import read_channels, write_recording

    paths = _paths(files)
    target = Path(out)
    given = [] if isinstance(map, dict) else [Path(map)]
    check_output(target, force, bag_files(target), *paths, *given, *(Path(each) for each in dbc))
    if isinstance(map, dict):
        name, content = "map", checked_map("map", map)
    else:
        name, content = Path(map).name, load_map(map)
    in_stage(progress, "reading")(0, 1, "")
    recording = read_channels(paths, content, name, [Path(each) for each in dbc])
    remove_earlier_bag(target)
    write_recording(recording, target, in_stage(progress, "writing"))
    return ImportResult(target, recording)


def propose_map(
    files: Path | str | Sequence[Path | str], *, dbc: Sequence[Path | str] = ()
) -> Proposal:
    """
    Propose a map for files, from the names of their columns and the statistics of their values.

    `.text` is the YAML text with the reason of each guess, `.uncertain` the lines to check.

    :param files: as in `import_recording`.
    :param dbc: as in `import_recording`.
    :raises UsageError: a file is missing.
    :raises DataError: a file cannot be read, or has no known channel.
    """
    from adk_ros.importing.proposal import propose

    return propose(_paths(files), [Path(each) for each in dbc])


def _paths(files: Path | str | Sequence[Path | str]) -> list[Path]:
    paths = [Path(files)] if isinstance(files, Path | str) else [Path(each) for each in files]
    if not paths:
        raise UsageError("name at least one file to import")
    repeated = [str(path) for i, path in enumerate(paths) if path in paths[:i]]
    if repeated:
        raise UsageError(f"{repeated[0]} is given twice")
    return paths
