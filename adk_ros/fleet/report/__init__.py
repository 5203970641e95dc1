# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The page of a fleet: vehicles, trends, places, and the corrected simulation."""
