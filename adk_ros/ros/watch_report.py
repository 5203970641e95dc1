# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The watch's diagnostics: level, message and values. Nothing here needs a node."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from adk_ros.mismatch.watch.change import WITHDRAWN
from adk_ros.mismatch.watch.stamp_filter import MAX_DEVIATION_S
from adk_ros.mismatch.watch.watch import CHANGED, LEARNING, WAITING, Watch
from adk_ros.ros.diagnostics import Level

STALE_S = 1.0
"""s without a message of a stream after which the diagnostics say so: as the predictor."""


class WatchInputs(NamedTuple):
    """
    Counts and ages of the inputs, by name; `refused` by reason.

    `strays`: messages left out for their stamps; `fresh_strays`: inputs with such ones since the
    last report.
    """

    received: Mapping[str, int]
    age_s: Mapping[str, float]
    refused: Mapping[str, int]
    strays: Mapping[str, int]
    fresh_strays: Sequence[str]


def watch_report(
    watch: Watch, inputs: WatchInputs, busy_share: float
) -> tuple[Level, str, list[tuple[str, str]]]:
    """Return level, message and values; `busy_share`: share of a core since the last report."""
    level, text = _message(watch, inputs)
    values: dict[str, object] = {
        "state": watch.state,
        "reference_share": round(watch.reference_share, 3),
        "statistic": round(watch.statistic, 1),
        "threshold": round(watch.threshold, 1),
        "likely": watch.likely or "none",
        "blocks_used": watch.blocks_used,
        "blocks_skipped": watch.blocks_skipped,
        "restarts": watch.restarts,
        "ignored_readings": watch.buffer.ignored,
        "cpu_percent": round(100.0 * busy_share, 1),
        "changes": watch.number,
    }
    for name, count in inputs.received.items():
        values[f"{name}.received"] = count
        values[f"{name}.age_s"] = round(inputs.age_s[name], 3)
        values[f"{name}.stray_stamps"] = inputs.strays.get(name, 0)
    for reason, count in sorted(inputs.refused.items()):
        values[f"refused: {reason}"] = count
    if watch.changes:
        last = watch.changes[-1]
        values["change.state"] = last.state
        values["change.verdict"] = last.verdict
        values["change.effect"] = last.best.effect.name
        values["change.alternatives"] = ", ".join(last.best.alternatives) or "none"
        values["change.onset_s"] = round(last.onset_s, 2)
        for name, x in last.best.parameters.items():
            values[f"change.{name}"] = f"{x.value:.4g} ({x.low:.4g} to {x.high:.4g}) {x.unit}"
    return level, text, [(key, str(value)) for key, value in values.items()]


def _message(watch: Watch, inputs: WatchInputs) -> tuple[Level, str]:
    silent = [name for name, age in inputs.age_s.items() if not age < STALE_S]
    never = [name for name in silent if math.isinf(inputs.age_s[name])]
    if never:
        return Level.ERROR, f"waiting for {', '.join(never)}"
    if silent:
        return Level.ERROR, f"no message of {', '.join(silent)} for {STALE_S:g} s"
    if inputs.fresh_strays:
        return Level.WARN, (
            f"{', '.join(inputs.fresh_strays)}: messages are left out, whose stamps differ from "
            f"the others by more than {MAX_DEVIATION_S:g} s: check the clocks of their senders"
        )
    if watch.changes and watch.changes[-1].state != WITHDRAWN:
        return Level.WARN, watch.changes[-1].sentence()
    if watch.state == WAITING:
        return Level.OK, "waiting for the car to move"
    if watch.state == LEARNING:
        return Level.OK, f"learning the car: {100.0 * watch.reference_share:.0f} %"
    if watch.state == CHANGED:
        return Level.WARN, "the car has changed: naming the change"
    return Level.OK, "no change"
