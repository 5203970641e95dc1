# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Command line: one module per verb, which turns options into a call of `adk_ros.api`."""
