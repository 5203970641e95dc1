# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Work on whole bags: replay, rollouts, export."""
