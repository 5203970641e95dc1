# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Numbers that may not be finite, as JSON and as text."""

from __future__ import annotations

import math
from typing import Any

import numpy as np


def finite(value: Any) -> Any:
    """Return the value as plain Python types; NaN and infinity become None (JSON null)."""
    if isinstance(value, dict):
        return {str(key): finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value


def number_or_dash(value: float, form: str) -> str:
    """Return a number in a format such as ".2f", a dash for one that is not finite."""
    return f"{value:{form}}" if math.isfinite(value) else "-"
