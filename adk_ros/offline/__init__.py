# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Processing of whole bags: replay, rollout, export of simulated recordings."""
