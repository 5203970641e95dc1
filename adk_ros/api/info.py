# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`adk info`: what a bag contains, and what it allows."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from adk_ros.api.progress import Progress


def bag_content(path: Path) -> dict[str, Any]:
    """
    Return what `adk info --json` prints for a bag, without its scope.

    :raises UsageError: the bag does not exist or cannot be read.
    """
    from adk_ros.api.recording import velocity_source
    from adk_ros.bags import Bag
    from adk_ros.bags.recording import choose_topics
    from adk_ros.errors import AdkError
    from adk_ros.importing.absent_command import with_absent_command

    options, source = velocity_source(path, None)
    with Bag(path) as bag:
        used_as: dict[str, str | None] = {}
        try:
            topics = choose_topics(bag, with_absent_command(bag, options))
            used_as = {
                "imu": topics.imu,
                "odometry": topics.odometry,
                "command": topics.command,
            }
            verdict = "usable for training and replay"
            if topics.imu is None:
                verdict += " (no IMU: yaw rate from odometry)"
        except AdkError as error:
            verdict = f"not usable for training or replay: {error}"
        return {
            "kind": "bag",
            "path": str(path),
            "seconds": round(bag.duration_s, 3),
            "messages": bag.message_count,
            "topics": [
                {
                    "name": topic.name,
                    "type": topic.msgtype,
                    "count": topic.count,
                    "rate_hz": (
                        round(topic.count / bag.duration_s, 2) if bag.duration_s > 0 else None
                    ),
                }
                for topic in bag.topics
            ],
            "used_as": used_as,
            "verdict": verdict,
            "warnings": [*bag.warnings, source] if source else bag.warnings,
        }


class BagReading(NamedTuple):
    """
    What `adk info` says after reading a bag.

    `scope`: what it allows: name, possible (yes, reduced, no), why and needs; empty if no stream
    can be read, for the reason `unknown`. `warnings`: those of `adk train` and `adk replay`, but
    for the source of v_x; `refusal`: why they refuse it, else empty.
    """

    scope: list[dict[str, str]]
    unknown: str
    warnings: list[str]
    refusal: str


def read_bag(path: Path, progress: Progress | None = None) -> BagReading:
    """
    Read a bag once, for its scope and its warnings.

    :raises UsageError: the bag does not exist or cannot be read.
    """
    from adk_ros.api.progress import in_stage
    from adk_ros.api.recording import velocity_source
    from adk_ros.bags import Bag
    from adk_ros.bags.recording import read_recording
    from adk_ros.calibration.from_bag import StreamReader, read_streams
    from adk_ros.calibration.scope import scope_of
    from adk_ros.errors import AdkError
    from adk_ros.importing.absent_command import with_absent_command

    options, _ = velocity_source(path, None)
    report = in_stage(progress, f"reading {path.name}")
    streams, unknown = None, ""
    with Bag(path) as bag:
        options = with_absent_command(bag, options)
        try:
            streams = StreamReader(bag, options)
        except AdkError as error:
            unknown = str(error)
    warnings: list[str] = []
    refusal = ""
    try:
        warnings = read_recording(path, options, report, streams).warnings
    except AdkError as error:
        refusal = str(error)
    if streams is None:
        return BagReading([], unknown, warnings, refusal)
    try:
        # A refusal may come before the last message.
        content = read_streams(path, options, report) if refusal else streams.content()
    except AdkError as error:
        return BagReading([], str(error), warnings, refusal)
    scope = [row.as_dict() for row in scope_of(content)]
    return BagReading(scope, "", warnings, refusal)


def with_reading(about: dict[str, Any], found: BagReading) -> dict[str, Any]:
    """
    Return `bag_content` with what reading the bag adds: scope, warnings, a refusal as verdict.

    The scope is empty if no stream can be read. The reason is a warning, unless the verdict says
    it already.
    """
    out = about | {"scope": found.scope}
    if str(about["verdict"]).startswith("not"):
        return out
    warnings = [*about["warnings"], *found.warnings]
    if found.unknown:
        warnings.insert(0, f"what the recording allows is unknown: {found.unknown}")
    if found.refusal:
        out["verdict"] = f"not usable for training or replay: {found.refusal}"
    return out | {"warnings": list(dict.fromkeys(warnings))}


def bag_verdict(about: dict[str, Any]) -> str:
    """
    Return in a line whether a bag is usable, by its topics and by what its channels allow.

    States which states can only be predicted in reduced scope because a channel is missing.

    :param about: `bag_content` with the scope of `read_bag` as "scope".
    """
    verdict = str(about["verdict"])
    rows = [row for row in about["scope"] if row["name"].startswith("predict")]
    if verdict.startswith("not") or not rows:
        return verdict
    impossible = [row for row in rows if row["possible"] == "no"]
    if len(impossible) == len(rows):
        return f"not usable for training or replay: {impossible[0]['why']}"
    if impossible:
        verdict += f", not for {_names(impossible)}"
    return "; ".join([verdict, *_reduced(rows)])


def _reduced(rows: list[dict[str, str]]) -> Iterator[str]:
    """Yield a phrase per reason for which states can only be predicted in reduced scope."""
    from adk_ros.calibration.scope import TOO_SHORT

    by_reason: dict[str, list[dict[str, str]]] = {}
    for row in rows:
        reasons = [reason for reason in row["why"].split("; ") if reason != TOO_SHORT]
        if row["possible"] == "reduced" and reasons:
            by_reason.setdefault("; ".join(reasons), []).append(row)
    for reason, those in by_reason.items():
        yield f"{_names(those)} can only be predicted in reduced scope: {reason}"


def _names(rows: list[dict[str, str]]) -> str:
    """Return the states of rows that are called "predict ...", listed."""
    *first, last = (row["name"].removeprefix("predict ") for row in rows)
    return f"{', '.join(first)} and {last}" if first else last
