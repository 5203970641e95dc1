# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`adk_ros.export`: a bag or a mismatch report as a table, or as an MCAP file with layouts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from adk_ros.api.output import bag_files, check_output, remove_earlier_bag
from adk_ros.api.progress import Progress, in_stage
from adk_ros.bags.recording import RecordingOptions
from adk_ros.errors import UsageError

if TYPE_CHECKING:
    from adk_ros.exporting.column_table import ColumnTable


@dataclass(frozen=True)
class ExportResult:
    """
    What was exported.

    `out`: the file, or the bag folder. `layouts`: files for Foxglove and PlotJuggler, with MCAP.
    `columns`: column -> unit. `rows`: of the table; messages with MCAP. `warnings`: what looks
    wrong in the source.
    """

    out: Path
    layouts: tuple[Path, ...]
    columns: dict[str, str]
    rows: int
    warnings: list[str]

    def as_dict(self) -> dict[str, Any]:
        """Return what `adk export --json` prints."""
        return {
            "out": str(self.out),
            "layouts": [str(path) for path in self.layouts],
            "columns": self.columns,
            "rows": self.rows,
            "warnings": self.warnings,
        }


def export(
    source: Path | str,
    to: str,
    out: Path | str,
    *,
    recording: Sequence[Path | str] = (),
    options: RecordingOptions | None = None,
    force: bool = False,
    progress: Progress | None = None,
) -> ExportResult:
    """
    Write the channels of a bag, or the signals behind a mismatch report, in another format.

    Of a bag: IMU, odometry, command and the channels that `import_recording` stores, at the
    stamps of their messages. Of a report: each signal measured, simulated, corrected and the
    residuals of both, every 0.1 s, predicted 1 s ahead.

    :param source: bag, or folder written by `explain`.
    :param to: "csv", "parquet", "mat" or "mcap"; "mcap" also writes layouts of viewers.
    :param recording: bags of the report, if they are no longer where it was made from them.
    :param options: how to read the bags, see `recording_options`.
    :param force: replace an earlier result at `out`.
    :raises UsageError: an argument is wrong, or `out` exists.
    :raises DataError: the bag is unusable.

    Example::

        adk_ros.export("bags/town", "parquet", "town.parquet")
        adk_ros.export("report", "mcap", "signals")
    """
    from adk_ros.exporting.column_table import FORMATS
    from adk_ros.exporting.report_signals import is_report
    from adk_ros.exporting.viewer_file import layout_files

    path, target = Path(source), Path(out)
    if to not in FORMATS:
        raise UsageError(f"--to {to} is unknown: choose one of {', '.join(FORMATS)}")
    inputs = [path, *(Path(each) for each in recording)]
    check_output(target, force, bag_files(target) if to == "mcap" else None, *inputs)
    if to == "mcap":
        for layout in layout_files(target):
            check_output(layout, force, None)
    if is_report(path):
        return _export_report(path, to, target, [Path(x) for x in recording], options, progress)
    if recording:
        raise UsageError(f"{path} is no mismatch report: --recording is for reports only")
    return _export_bag(path, to, target, options, progress)


def _export_report(
    report: Path,
    to: str,
    out: Path,
    recordings: Sequence[Path],
    options: RecordingOptions | None,
    progress: Progress | None,
) -> ExportResult:
    from adk_ros.exporting.report_signals import recordings_of, report_signals
    from adk_ros.exporting.viewer_file import layout_files, write_layouts, write_signals

    warnings: list[str] = []
    if not recordings:
        recordings, warnings = recordings_of(report)
    in_stage(progress, "predicting")(0, 1, "")
    tables = report_signals(report, recordings, options)
    joined = _joined(tables)
    if to == "mcap":
        remove_earlier_bag(out)
        write_layouts(write_signals(tables, out), out)
        count = sum(int(np.isfinite(x).sum()) for x in joined.columns.values())
        return ExportResult(out, layout_files(out), dict(joined.units), count, warnings)
    _write_table({"signals": joined}, joined, to, out)
    return ExportResult(out, (), dict(joined.units), joined.stamp_ns.shape[0], warnings)


def _export_bag(
    bag: Path,
    to: str,
    out: Path,
    options: RecordingOptions | None,
    progress: Progress | None,
) -> ExportResult:
    from adk_ros.exporting.bag_channels import read_bag_channels
    from adk_ros.exporting.column_table import side_by_side
    from adk_ros.exporting.viewer_file import layout_files, plots_of_topics, write_layouts
    from adk_ros.importing.channels import CHANNELS
    from adk_ros.importing.recording_import import ImportedRecording, write_recording
    from adk_ros.importing.topics import topics_of

    found = read_bag_channels(bag, options, in_stage(progress, f"reading {bag.name}"))
    units = {name: channel.unit for name, channel in CHANNELS.items()}
    table = side_by_side(found.channels, units, found.start_ns)
    if to == "mcap":
        outcome = topics_of(found.channels, [])
        content = ImportedRecording(tuple(found.channels), outcome, (), ())
        remove_earlier_bag(out)
        write_recording(content, out, in_stage(progress, "writing"))
        write_layouts(plots_of_topics(outcome.topics), out)
        return ExportResult(
            out, layout_files(out), dict(table.units), content.message_count, found.warnings
        )
    groups = {
        name: side_by_side(channels, units, found.start_ns)
        for name, channels in found.streams.items()
    }
    _write_table(groups, table, to, out)
    return ExportResult(out, (), dict(table.units), table.stamp_ns.shape[0], found.warnings)


def _joined(tables: Sequence[ColumnTable]) -> ColumnTable:
    """Return the rows of several recordings below each other, in order of time."""
    from adk_ros.exporting.column_table import ColumnTable

    stamps = np.concatenate([table.stamp_ns for table in tables])
    order = np.argsort(stamps, kind="stable")
    columns = {
        name: np.concatenate([table.columns[name] for table in tables])[order]
        for name in tables[0].columns
    }
    start_ns = min(table.start_ns for table in tables)
    return ColumnTable(stamps[order], columns, tables[0].units, start_ns)


def _write_table(groups: dict[str, ColumnTable], table: ColumnTable, to: str, out: Path) -> None:
    from adk_ros.exporting.column_table import write_mat, write_table

    try:
        if to == "mat":
            write_mat(groups, out)
        else:
            write_table(table, to, out)
    except OSError as error:
        raise UsageError(f"{out} cannot be written: {error.strerror or error}") from None
