# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The `adk` command with one criterion of `adk mismatch` multiplied by a factor.

`python -m adk_ros.cli.varied_command NAME=FACTOR mismatch ...`
"""

from __future__ import annotations

import sys

from adk_ros.cli.main import main
from adk_ros.mismatch.library.sensitivity import varied_constants

if __name__ == "__main__":
    name, _, factor = sys.argv.pop(1).partition("=")
    with varied_constants({name: float(factor)}):
        sys.exit(main())
