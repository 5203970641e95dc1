# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Drives with injected differences between the recorded commands and the vehicle."""
