# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Watch a car while it drives: which physics changed, since when, and how much."""
