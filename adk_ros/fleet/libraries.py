# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The optional libraries of `adk fleet`."""

from __future__ import annotations

from typing import Any

from adk_ros.importing.optional_library import optional_library


def fleet_library(name: str) -> Any:
    """
    Return the imported module `name`.

    :raises UsageError: it is not installed; the message says how to install it.
    """
    return optional_library(name, "adk fleet", extra="fleet")
