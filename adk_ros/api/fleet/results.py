# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The results of a fleet as data frames."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd

from adk_ros.errors import UsageError
from adk_ros.fleet.columns import LISTING, RESULT
from adk_ros.fleet.dataset import RESULTS, FleetDataset
from adk_ros.fleet.tags import TAGS_FILE, stored_tags

_CHOSEN_BY = ["recording", "content_hash", "key", "written_s"]
_SUMMARISED = [
    "recording", "content_hash", "status", "failure", "reason", "kind", "finding", "condition",
]  # fmt: skip


def fleet_stages(out: Path | str) -> list[str]:
    """
    Return the stages with results in a folder.

    :raises UsageError: there are none.
    """
    folders = sorted((Path(out) / RESULTS).glob("stage=*"))
    if not folders:
        raise UsageError(f"{out} has no results of 'adk fleet': run 'adk fleet index' first")
    return [folder.name.partition("=")[2] for folder in folders]


def fleet_frame(out: Path | str, stage: str) -> pd.DataFrame:
    """
    Return the results of a stage, one row per recording and finding.

    Of each recording those of its content and of the model or simulation at its last run; if that
    run has not come to it, the newest of this content.

    Columns: those of `fleet.columns.RESULT`, then vehicle, time_s and the tags of fleet.csv; a tag
    with the name of another column gets "_tag" after it.
    """
    frame = _current(out, stage, list(RESULT))
    if frame.empty:
        return frame
    path = Path(out) / TAGS_FILE
    taken = {*RESULT, "vehicle", "time_s"}
    rows: list[dict[str, Any]] = [
        {"recording": name, "vehicle": each.vehicle, "time_s": each.time_s}
        | {f"{tag}_tag" if tag in taken else tag: x for tag, x in each.conditions.items()}
        for name, each in stored_tags(path, list(frame["recording"].unique())).items()
    ]
    if not rows:
        return frame.assign(vehicle="", time_s=float("nan"))
    return frame.merge(pd.DataFrame(rows), on="recording", how="left")


def _current(out: Path | str, stage: str, columns: list[str]) -> pd.DataFrame:
    """Return columns of the rows of the recordings at their last run."""
    dataset = FleetDataset(Path(out))
    table = dataset.columns(stage, list(dict.fromkeys([*columns, *_CHOSEN_BY])))
    chosen = _is_current(table.select(_CHOSEN_BY).to_pandas(), dataset.listing(stage))
    frame: pd.DataFrame = table.select(columns).filter(chosen.to_numpy(dtype=bool)).to_pandas()
    return frame


def _is_current(frame: pd.DataFrame, listing: list[dict[str, str]]) -> pd.Series[bool]:
    """Return which rows are those of the recordings at their last run."""
    known = pd.DataFrame(listing, columns=list(LISTING)).set_index("recording")
    names = frame["recording"]
    content, key = names.map(known["content_hash"]), names.map(known["key"])
    # Datasets of earlier versions have no listing.
    is_content = content.isna() | (frame["content_hash"] == content)
    ordered = frame.assign(last=frame["key"] == key)[is_content].sort_values(["last", "written_s"])
    chosen = ordered.groupby("recording")["key"].last()
    return is_content & (frame["key"] == names.map(chosen))


def fleet_summary(out: Path | str) -> list[dict[str, Any]]:
    """
    Return for each stage: recordings, failures by kind, and how often each finding occurs.

    `contents`: recordings of different content; fewer where one was copied or has moved.

    `findings`: [kind, finding, number of recordings], the most frequent first; of checks, those
    with the verdict "finding".
    """
    summary = []
    for stage in fleet_stages(out):
        # Details, which are most of the data, are not read.
        frame = _current(out, stage, _SUMMARISED)
        once = frame.drop_duplicates("recording")
        failed = once[once["status"] == "failed"]
        shown = frame[frame["kind"].isin(["usable", "check", "verdict", "effect"])]
        shown = shown[(shown["kind"] != "check") | (shown["condition"] == "finding")]
        counts = shown.groupby(["kind", "finding"])["recording"].nunique()
        summary.append(
            {
                "stage": stage,
                "recordings": len(once),
                "contents": int(once["content_hash"].nunique()),
                "failed": failed["failure"].value_counts().to_dict(),
                "reasons": dict(zip(failed["recording"], failed["reason"], strict=True)),
                "findings": [
                    [kind, finding, int(count)]
                    for (kind, finding), count in counts.sort_values(ascending=False).items()
                ],
            }
        )
    return summary
