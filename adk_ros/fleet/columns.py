# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Columns of the dataset of results."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from adk_ros.errors import one_line

FINDING = {
    "finding": "string",
    "kind": "string",
    "channel": "string",
    "horizon_s": "float64",
    "condition": "string",
    "value": "float64",
    "low": "float64",
    "high": "float64",
    "unit": "string",
    "text": "string",
    "details": "string",
}
"""Columns that a stage may fill: what was found, with its 90 % interval; details are JSON."""

RESULT = {
    "recording": "string",
    "uri": "string",
    "content_hash": "string",
    "key": "string",
    "code_version": "string",
    "inputs_hash": "string",
    "model_hash": "string",
    "status": "string",
    "failure": "string",
    "reason": "string",
    "seconds": "float64",
    "memory_mib": "float64",
    "bytes": "int64",
    "written_s": "float64",
} | FINDING
"""
Columns of the results. `model_hash`: of the model or simulation that the row was made with, "" of
a stage without one; `inputs_hash`: of that with all further inputs. `status`: ok or failed, with
`failure` (engine.Failure) and `reason`; `seconds` and `memory_mib`: duration and peak memory of
the work; `bytes`: size of the recording; `written_s`: when, s since 1970.
"""

ADDED = frozenset({"model_hash"})
"""Columns of texts that files of earlier versions lack, where they read as empty."""

PRUNED_BY = ("recording", "key", "code_version", "inputs_hash")
"""Columns by which rows are removed."""

CONTENT = {"uri": "string", "version": "string", "content_hash": "string", "bytes": "int64"}
"""Columns of the content hashes."""

LISTING = {"recording": "string", "content_hash": "string", "key": "string"}
"""Columns of the listing of a stage: content and key of each recording at its last run."""


def checked_row(row: Mapping[str, Any]) -> dict[str, Any]:
    """
    Return a row of a stage as it is stored: details as JSON, texts of one line.

    :raises ValueError: it has a column that is not in `FINDING`, or a value of another type.
    """
    if unknown := sorted(set(row) - set(FINDING)):
        raise ValueError(f"column {', '.join(unknown)} is not among {', '.join(FINDING)}")
    stored: dict[str, Any] = {}
    for name, value in row.items():
        if value is None:
            continue
        if name == "details":
            stored[name] = value if isinstance(value, str) else json.dumps(value, sort_keys=True)
        elif FINDING[name] == "float64":
            stored[name] = float(value)
        elif isinstance(value, str):
            stored[name] = one_line(value) if name == "text" else value
        else:
            raise ValueError(f"column {name} is {type(value).__name__}, not text")
    return stored
