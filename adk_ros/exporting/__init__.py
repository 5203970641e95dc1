# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Export bags and mismatch reports as tables, and as MCAP files with layouts for viewers."""
