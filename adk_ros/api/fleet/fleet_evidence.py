# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The evidence of a fleet in its dataset: where it is linearised, and what of it is kept."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from adk_ros.api.fleet.evidence_stage import EvidenceStage, evidence_row, write_point
from adk_ros.api.fleet.index_stage import file_hash
from adk_ros.fleet.dataset import FleetDataset
from adk_ros.fleet.plan import content_of, current_keys, distinct_rows, rows_of
from adk_ros.fleet.recordings import FleetRecording
from adk_ros.fleet.stage import StageVersion, version_of

if TYPE_CHECKING:
    from adk_ros.fleet.inference.evidence import Row
    from adk_ros.fleet.inference.fleet_estimate import FleetEstimate

_POINT, _DIGITS = "point", 16


class CurrentEvidence:
    """The evidence of a fleet in the dataset `out`, as a run uses it in its passes."""

    def __init__(self, out: Path) -> None:
        self._dataset = FleetDataset(out)
        self._version: StageVersion | None = None
        self._keys: set[str] = set()
        self._names: set[str] = set()

    def of(
        self, stage: EvidenceStage, recordings: Sequence[FleetRecording]
    ) -> tuple[list[Row], dict[str, str]]:
        """Return the evidence of recordings by a stage, and name -> why one has none."""
        version = self._version = version_of(stage)
        keys = current_keys(version, recordings, self._dataset.content_hashes())
        self._keys |= set(keys.values())
        self._names |= keys.keys()
        found = rows_of(keys, version.name, self._dataset)
        rows, left_out = distinct_rows(found, content_of)
        known = {str(row["recording"]) for row in found}
        left_out |= {x.name: "has no evidence" for x in recordings if x.name not in known}
        return [evidence_row(row["details"], str(row["recording"])) for row in rows], left_out

    def prune(self) -> None:
        """
        Remove the evidence of these recordings that this run has not used.

        That is what other code found, and what was linearised elsewhere than in this run, whose
        points a further run, with a drive more, meets again. That of other simulations stays.

        :raises UsageError: the folder cannot be written.
        """
        version = self._version
        if version is None:
            return

        def is_kept(row: Mapping[str, str]) -> bool:
            of_stage, _, _ = row["inputs_hash"].partition("-")
            superseded = (
                row["code_version"] != version.code_version or of_stage == version.inputs_hash
            )
            return (
                row["recording"] not in self._names or row["key"] in self._keys or not superseded
            )

        self._dataset.prune(version.name, is_kept)


def point_file(out: Path, estimate: FleetEstimate | None) -> str:
    """
    Write the estimate to linearise at and return its file, named by its content.

    Returns "" for an estimate without effects, at which the recordings are linearised already.
    """
    if estimate is None:
        return ""
    values = {name: estimate.point_of(name) for name in estimate.fleet.names}
    local = estimate.local_values()
    if not local and not any(values.values()):
        return ""
    scratch = out / ".point.json"
    write_point(scratch, values, local)
    path = out / f"{_POINT}-{file_hash(str(scratch))[:_DIGITS]}.json"
    scratch.replace(path)
    return str(path)


def remove_points(out: Path) -> None:
    """Remove the files of `point_file`; a run that goes on writes them again."""
    for path in out.glob(f"{_POINT}-{_DIGITS * '[0-9a-f]'}.json"):
        with suppress(OSError):
            path.unlink(missing_ok=True)
