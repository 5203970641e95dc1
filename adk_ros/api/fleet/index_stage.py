# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Stage `index`: what a recording holds, whether it is usable, and findings of its checks."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from adk_ros.bags.recording import RecordingOptions
from adk_ros.fleet.stage import hash_of


@dataclass(frozen=True)
class IndexStage:
    """
    What `adk info` and `adk check` say.

    Rows by `kind`: `content` (duration), `usable` (text: for what or why not), `scope` (a row for
    each use: condition yes, reduced or no), `check` (each finding with its interval), `warning`.
    `vehicle`: vehicle file for the checks, "" for none. `options`: topics and sensor configuration
    of the checks.
    """

    vehicle: str = ""
    options: RecordingOptions = field(default_factory=RecordingOptions)
    name: str = "index"

    @property
    def inputs_hash(self) -> str:
        """Hash of the vehicle file, topics and sensor configuration."""
        return hash_of([file_hash(self.vehicle), asdict(self.options)])

    @property
    def shared_paths(self) -> tuple[str, ...]:
        """Vehicle file."""
        return (self.vehicle,) if self.vehicle else ()

    def run(self, path: Path, recording: str) -> list[dict[str, Any]]:
        """Return the rows of a recording."""
        from adk_ros.api.check import check_recording
        from adk_ros.api.info import bag_content, bag_verdict
        from adk_ros.calibration.scope import scope_of
        from adk_ros.errors import AdkError

        about = bag_content(path)
        rows: list[dict[str, Any]] = [
            {
                "kind": "content",
                "finding": "duration",
                "value": about["seconds"],
                "unit": "s",
                "details": {"messages": about["messages"], "topics": about["topics"]},
            }
        ]
        about["scope"] = []
        checks: list[dict[str, Any]] = []
        try:
            checked = check_recording(path, self.vehicle or None, options=self.options)
        except AdkError as error:
            checks = [{"kind": "warning", "finding": "not checked", "text": str(error)}]
        else:
            about["scope"] = [
                row.as_dict() for row in scope_of(checked.content, checked.length_scale)
            ]
            checks = [
                {
                    "kind": "check",
                    "finding": finding.name,
                    "condition": finding.verdict.value,
                    "value": finding.value,
                    "low": finding.low,
                    "high": finding.high,
                    "unit": finding.unit,
                    "text": finding.text,
                    "details": {"parameters": dict(finding.parameters), "remedy": finding.remedy},
                }
                for finding in checked.result.findings
            ]
        verdict = bag_verdict(about)
        is_usable = not verdict.startswith("not")
        rows.append({"kind": "usable", "finding": "yes" if is_usable else "no", "text": verdict})
        rows += [
            {
                "kind": "scope",
                "finding": row["name"],
                "condition": row["possible"],
                "text": f"{row['why']}; {row['needs']}".strip("; "),
            }
            for row in about["scope"]
        ]
        rows += checks
        rows += [
            {"kind": "warning", "finding": "recording", "text": text} for text in about["warnings"]
        ]
        return rows


def file_hash(source: str) -> str:
    """
    Return a hash of a file's or folder's content; of the name, if it is packaged; "" for "".

    :raises UsageError: it cannot be read.
    """
    from adk_ros.files.pages.provenance import input_files

    path = Path(source)
    if not source or not path.exists():
        return source
    return hash_of([Path(item.path).name, item.sha256] for item in input_files("input", path))
