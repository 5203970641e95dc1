# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A feature that a search returns."""

from __future__ import annotations

from typing import NamedTuple


class Found(NamedTuple):
    """A feature in an equation, with its gain in loss less the penalty for the search."""

    equation: str
    name: str
    gain: float
