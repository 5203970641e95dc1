# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What stage `replay` says of a model over all recordings: pooled errors, surprising minutes."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from adk_ros.api.fleet.replay_stage import MINUTES, ReplayStage
from adk_ros.fleet.dataset import FleetDataset
from adk_ros.fleet.plan import content_of, current_rows, distinct_rows
from adk_ros.fleet.recordings import FleetRecording
from adk_ros.fleet.stage import version_of
from adk_ros.fleet.tags import TAGS_FILE, Tags, stored_tags
from adk_ros.signals.channels import STATE_NAMES


@dataclass(frozen=True)
class PooledError:
    """
    RMSE of a channel at a horizon (s) over all rollouts of a driving condition, "" for all.

    `value` in `unit` (m/s or rad/s); `count` rollouts of `recordings`.
    """

    channel: str
    horizon_s: float
    condition: str
    value: float
    unit: str
    count: int
    recordings: int


@dataclass(frozen=True)
class SurprisingMinute:
    """
    A minute from `from_s` (s in the recording) with large innovations, most in `channel`.

    `value`: root mean of the squared innovation over its predicted variance.
    """

    recording: str
    from_s: float
    channel: str
    value: float


@dataclass(frozen=True)
class ReplaySummary:
    """
    Errors by condition, channel and horizon, and the minutes of the largest innovations.

    `errors_by_tag`: column of fleet.csv -> its value -> errors of the recordings with it, over all
    their driving conditions.
    """

    errors: tuple[PooledError, ...]
    surprises: tuple[SurprisingMinute, ...]
    errors_by_tag: Mapping[str, Mapping[str, tuple[PooledError, ...]]] = field(
        default_factory=dict
    )

    def as_dict(self) -> dict[str, Any]:
        """Return the summary for JSON."""
        return {
            "errors": [dict(vars(each)) for each in self.errors],
            "errors_by_tag": {
                tag: {value: [dict(vars(each)) for each in found] for value, found in by.items()}
                for tag, by in self.errors_by_tag.items()
            },
            "surprises": [dict(vars(each)) for each in self.surprises],
        }


def replay_summary(
    out: Path, stage: ReplayStage, recordings: Sequence[FleetRecording]
) -> ReplaySummary:
    """
    Return what a stage says of recordings as they are now, of each content once.

    Tags are those that are kept with the results.

    :raises UsageError: the table of the tags cannot be read.
    """
    kinds = {"kind": ["error", "surprise"]}
    found = current_rows(version_of(stage), recordings, FleetDataset(out), kinds)
    rows, _ = distinct_rows(found, content_of)
    errors = [row for row in rows if row["kind"] == "error"]
    tags = stored_tags(out / TAGS_FILE, [each.name for each in recordings])
    return ReplaySummary(
        _pooled(errors),
        _minutes(row for row in rows if row["kind"] == "surprise"),
        _pooled_by_tag(errors, tags),
    )


def _pooled_by_tag(
    rows: Iterable[Mapping[str, Any]], tags: Mapping[str, Tags]
) -> dict[str, dict[str, tuple[PooledError, ...]]]:
    """Return the errors over all driving conditions by tag and its value; "" is no value."""
    groups: dict[str, dict[str, list[Mapping[str, Any]]]] = {}
    for row in rows:
        if row["condition"] == "":
            for tag, value in tags.get(row["recording"], Tags()).conditions.items():
                if value:
                    groups.setdefault(tag, {}).setdefault(value, []).append(row)
    return {
        tag: {value: _pooled(groups[tag][value]) for value in sorted(groups[tag])}
        for tag in sorted(groups)
    }


def _pooled(rows: Iterable[Mapping[str, Any]]) -> tuple[PooledError, ...]:
    """Return the root of the mean of squares over all rollouts, by condition and channel."""
    groups: dict[tuple[str, int, float], list[tuple[int, float, str]]] = {}
    for row in rows:
        count = int(json.loads(row["details"])["count"])
        key = (row["condition"], STATE_NAMES.index(row["channel"]), row["horizon_s"])
        groups.setdefault(key, []).append((count, row["value"], row["unit"]))
    pooled = []
    for (condition, channel, horizon_s), each in sorted(groups.items()):
        total = sum(count for count, _, _ in each)
        square = sum(count * value**2 for count, value, _ in each) / total
        pooled.append(
            PooledError(
                STATE_NAMES[channel], horizon_s, condition, math.sqrt(square), each[0][2], total,
                len(each),
            )
        )  # fmt: skip
    return tuple(pooled)


def _minutes(rows: Iterable[Mapping[str, Any]]) -> tuple[SurprisingMinute, ...]:
    found = [
        SurprisingMinute(
            str(row["recording"]),
            float(json.loads(row["details"])["from_s"]),
            str(row["channel"]),
            float(row["value"]),
        )
        for row in rows
    ]
    return tuple(sorted(found, key=lambda each: (-each.value, each.recording))[:MINUTES])
