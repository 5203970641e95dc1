# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Identifiable physics as data: effects, features and surrogate parameters."""
