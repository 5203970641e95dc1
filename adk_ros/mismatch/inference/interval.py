# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Interval of a parameter."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Interval:
    """A parameter's value with its 90 % confidence interval."""

    value: float
    low: float
    high: float
    unit: str
