# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Import libraries that only some formats need; they are not installed by default."""

from __future__ import annotations

import importlib
from typing import Any

from adk_ros.errors import UsageError


def optional_library(name: str, purpose: str, distribution: str = "") -> Any:
    """
    Return the imported module `name`.

    :param purpose: what it is for, in the message.
    :raises UsageError: it is not installed; the message says which, and how to install it.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        missing = (error.name or name).split(".")[0]
        library = distribution if distribution and missing == name.split(".")[0] else missing
        raise UsageError(
            f"{purpose} needs {library}, which is not installed: pip install 'adk_ros[import]'"
        ) from None
