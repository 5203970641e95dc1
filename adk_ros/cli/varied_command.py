# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The `adk` command with one criterion of `adk mismatch` multiplied by a factor, wherever it is used.

`python -m adk_ros.cli.varied_command NAME=FACTOR mismatch ...`
"""

from __future__ import annotations

import sys

from adk_ros.mismatch.library import criteria


def multiply(name: str, factor: float) -> None:
    """
    Multiply a criterion; modules that import it afterwards have the new value.

    Of a group of values by sensor, all are multiplied.

    :raises AttributeError: there is no such criterion.
    """
    value = getattr(criteria, name)
    if isinstance(value, dict):
        changed: object = {k: tuple(factor * x for x in v) for k, v in value.items()}
    else:
        changed = factor * value
    setattr(criteria, name, changed)


if __name__ == "__main__":
    criterion, _, given = sys.argv.pop(1).partition("=")
    multiply(criterion, float(given))
    from adk_ros.cli.main import main

    sys.exit(main())
