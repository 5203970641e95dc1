# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Import libraries that only some formats need; they are not installed by default."""

from __future__ import annotations

import importlib
import io
import logging
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from typing import Any

from adk_ros.errors import UsageError


def optional_library(
    name: str, purpose: str, distribution: str = "", extra: str = "import"
) -> Any:
    """
    Return the imported module `name`.

    :param purpose: what it is for, in the message.
    :param extra: the optional dependencies of this package that include it; `make` has a target of
        that name, which installs them in a checkout.
    :raises UsageError: it is not installed; the message says which, and how to install it.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        missing = (error.name or name).split(".")[0]
        library = distribution if distribution and missing == name.split(".")[0] else missing
        raise UsageError(
            f"{purpose} needs {library}, which is not installed: pip install "
            f"'adk_ros[{extra}]', in a checkout 'make {extra}'"
        ) from None


@contextmanager
def quiet_library(name: str) -> Iterator[None]:
    """
    Keep a library from printing, logging and warning of what the caller reports in a line.

    Errors that it raises while it discards a half-read file are ignored as well.
    """
    logger, hook = logging.getLogger(name), sys.unraisablehook
    level = logger.level
    logger.setLevel(logging.CRITICAL + 1)
    sys.unraisablehook = lambda _: None
    try:
        with redirect_stdout(io.StringIO()), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        sys.unraisablehook = hook
        logger.setLevel(level)
