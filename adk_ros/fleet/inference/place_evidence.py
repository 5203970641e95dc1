# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Placeholder."""


def place_rows(name, likelihood, linear, values):
    return []
