# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Channels, message decoding, alignment to the 25 ms grid, records and scores."""
