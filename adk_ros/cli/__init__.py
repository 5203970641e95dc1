# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Command line: one module per verb, which turns options into a call of `adk_ros.api`."""

import os

# Before NumPy is loaded: threads of its linear algebra gain nothing on matrices of a few dozen
# rows, and where other work shares the cores they wait for each other most of the time.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
