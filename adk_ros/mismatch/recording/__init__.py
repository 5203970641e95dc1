# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings as sensor logs, and the checks they must pass."""
