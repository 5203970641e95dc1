# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How the kernels of the mismatch tool are compiled."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

from adk_ros.compiled import compiler

F = TypeVar("F", bound=Callable[..., Any])

_compile = compiler(
    Path(__file__).parent, fastmath={"contract", "reassoc", "arcp", "nsz"}, error_model="numpy"
)


def kernel(function: F) -> F:
    """Compile `function` to machine code at its first call and keep the result on disk."""
    return cast(F, _compile(function))
