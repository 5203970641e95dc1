# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Find the physics that a simulation lacks compared with a recording."""
