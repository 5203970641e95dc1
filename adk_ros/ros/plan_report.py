# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the diagnostics say of planned commands and of requested rollouts."""

from __future__ import annotations

from collections import Counter

from adk_ros.model.planned_horizon import PlanStatus
from adk_ros.ros.core import Core
from adk_ros.signals.channels import INPUT_NAMES

_SILENT = (PlanStatus.NONE, PlanStatus.FOLLOWED, PlanStatus.NOT_PLANNED)


class PlanReport:
    """Findings since the previous report, and the values of the present."""

    def __init__(self, core: Core) -> None:
        self._pipeline = core.pipeline
        self._rollouts = core.rollouts
        self._reported: Counter[str] = Counter()
        self._reported_rollouts: Counter[str] = Counter()

    def warnings(self) -> list[str]:
        """Return a line per reason of refused messages, and per reason of plans not followed."""
        refused = self._pipeline.plan_decoder.refused
        lines = [
            f"{count} planned_command messages refused: {reason}"
            for reason, count in sorted((refused - self._reported).items())
        ]
        self._reported = Counter(refused)
        lines += [
            f"{count} roll_out requests refused: {reason}"
            for reason, count in sorted((self._rollouts.refused - self._reported_rollouts).items())
        ]
        self._reported_rollouts = Counter(self._rollouts.refused)
        channels: dict[PlanStatus, list[str]] = {}
        for name, status in zip(INPUT_NAMES, self._pipeline.planned.status, strict=True):
            if status not in _SILENT:
                channels.setdefault(status, []).append(name)
        return lines + [f"{' and '.join(c)} {s.value}" for s, c in channels.items()]

    def values(self) -> dict[str, object]:
        """Return the pairs; none before the first plan or request."""
        decoder, planned = self._pipeline.plan_decoder, self._pipeline.planned
        values: dict[str, object] = {}
        if self._rollouts.received:
            values["roll_out.received"] = self._rollouts.received
        for reason, count in sorted(self._rollouts.refused.items()):
            values[f"roll_out.refused: {reason}"] = count
        if not decoder.received:
            return values
        values["plan.received"] = decoder.received
        for reason, count in sorted(decoder.refused.items()):
            values[f"plan.refused: {reason}"] = count
        for name, status in zip(INPUT_NAMES, planned.status, strict=True):
            values[f"plan.{name}"] = status.value
        return values
