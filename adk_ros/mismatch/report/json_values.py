# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Numbers and parameters as `mismatch.json` holds them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from adk_ros.mismatch.inference.identifiability import CompetingEffect
from adk_ros.mismatch.inference.result import Interval
from adk_ros.mismatch.report.tie_rows import MAX_SHOWN


def json_number(value: float | None) -> float | None:
    """Return six digits; null for what is unknown, not finite, or a limit never reached."""
    if value is None or not math.isfinite(value) or abs(value) >= MAX_SHOWN:
        return None
    return float(f"{value:.6g}")


def json_interval(x: Interval) -> dict[str, float | None]:
    """Return value and limits."""
    return {"value": json_number(x.value), "low": json_number(x.low), "high": json_number(x.high)}


def json_parameters(parameters: Mapping[str, Interval]) -> dict[str, Any]:
    """Return value, limits and unit of each parameter."""
    return {name: {**json_interval(x), "unit": x.unit} for name, x in parameters.items()}


def json_competing_effects(competitors: Sequence[CompetingEffect]) -> list[dict[str, Any]]:
    """Return name and loss difference of each effect that was fitted in the place of another."""
    return [
        {"name": competitor.name, "loss_difference": json_number(competitor.loss_difference)}
        for competitor in competitors
    ]
