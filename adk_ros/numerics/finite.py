# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Values as JSON takes them."""

from __future__ import annotations

from typing import Any

import numpy as np


def finite(value: Any) -> Any:
    """Return a value of plain types, lists and mappings, with None for what is not finite."""
    if isinstance(value, dict):
        return {str(key): finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value
