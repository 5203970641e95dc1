# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The signals behind a mismatch report, computed again from its models and its recordings.

Measured, simulated and corrected by `mismatch.deployment.predicted_signals`: open-loop
predictions 1 s ahead with the commands of the recording, on the whole recording.
"""

from __future__ import annotations

import html
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from adk_ros.bags.recording import RecordingOptions
from adk_ros.errors import DataError, UsageError
from adk_ros.exporting.column_table import ColumnTable
from adk_ros.files.pages.provenance import sha256_of
from adk_ros.importing.velocity_source import with_velocity_source
from adk_ros.mismatch.deployment.held_out import Evidence
from adk_ros.mismatch.deployment.predicted_signals import predicted_signals, unpredicted_signals
from adk_ros.mismatch.inference.signal_fit import SIGNAL_UNITS, SIGNALS
from adk_ros.mismatch.recording.from_bag import read_sensor_log
from adk_ros.mismatch.report.report_page import PAGE
from adk_ros.mismatch.report.result_files import CORRECTED_FILE, RESULT_FILE, SIMULATION_FILE
from adk_ros.numerics.arrays import FloatArray

_INPUT = re.compile(
    r"<tr><td>recording</td><td>(.*?)</td><td>\d+</td><td class=\"hash\">([0-9a-f]{64})</td></tr>"
)
_MAX_BYTES = 1 << 26

ROLES = ("measured", "simulated", "corrected", "residual_simulated", "residual_corrected")
"""Columns of each signal; residuals are measured minus predicted."""


class NamedRecordings(NamedTuple):
    """The bags of a report, and a line for each that has changed since."""

    paths: list[Path]
    warnings: list[str]


def is_report(path: Path) -> bool:
    """Return whether a path is a folder that `adk mismatch` has written."""
    return (path / RESULT_FILE).is_file()


def recordings_of(report: Path) -> NamedRecordings:
    """
    Return the bags that the page of a report names as its recordings.

    :raises UsageError: it names none, or one that does not exist.
    """
    page = report / PAGE
    try:
        text = page.read_bytes()[:_MAX_BYTES].decode("utf-8", errors="replace")
    except OSError:
        text = ""
    files = [(Path(html.unescape(name)), digest) for name, digest in _INPUT.findall(text)]
    if not files:
        raise UsageError(f"{report} does not name its recording: give --recording BAG")
    paths: dict[Path, None] = {}
    warnings = []
    for file, digest in files:
        is_in_folder = file.name == "metadata.yaml" or (file.parent / "metadata.yaml").is_file()
        paths[file.parent if is_in_folder else file] = None
        if not file.is_file():
            raise UsageError(
                f"{report} was made from {file}, which is not there: give --recording BAG"
            )
        if sha256_of(file) != digest:
            warnings.append(f"{file} has changed since {report} was written")
    return NamedRecordings(list(paths), warnings)


def report_signals(
    report: Path, recordings: Sequence[Path], options: RecordingOptions | None = None
) -> list[ColumnTable]:
    """
    Return the signals of each recording: per signal measured, simulated, corrected, residuals.

    Rows every 0.1 s; NaN where the car is too slow, or a signal cannot be judged.

    :raises UsageError: the report lacks a model, or a bag cannot be read.
    :raises DataError: a recording is too short for a prediction.
    """
    models = []
    for name in (SIMULATION_FILE, CORRECTED_FILE):
        file = report / name
        if not file.is_file():
            raise UsageError(f"{report} lacks {name}, from which its signals are computed")
        models.append(file.read_text(encoding="utf-8"))
    tables = []
    for path in recordings:
        chosen, _ = with_velocity_source(path, options or RecordingOptions())
        log = read_sensor_log(path, chosen, needs_imu=False)
        torque = log.command[:, 0]
        has_torque = bool(np.ptp(torque) > 0.0) and not log.torque_is_inferred
        hidden = unpredicted_signals(has_torque, bool(log.imu_s.size))
        found = predicted_signals(
            (models[0], models[1]), Evidence(log), path.name, not_judged=hidden
        )
        if found is None:
            raise DataError(f"{path}: is too short for a prediction of 1 s")
        stamps = log.start_ns + np.rint(found.time_s * 1e9).astype(np.int64)
        columns: dict[str, FloatArray] = {}
        units: dict[str, str] = {}
        for i, signal in enumerate(SIGNALS):
            measured, simulated = found.measured[i], found.simulation[i]
            corrected = found.corrected[i]
            values = (
                measured, simulated, corrected, measured - simulated, measured - corrected,
            )  # fmt: skip
            for role, column in zip(ROLES, values, strict=True):
                columns[f"{signal}_{role}"] = column
                units[f"{signal}_{role}"] = SIGNAL_UNITS[i]
        tables.append(ColumnTable(stamps, columns, units, log.start_ns))
    return tables
