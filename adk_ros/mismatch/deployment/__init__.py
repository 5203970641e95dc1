# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The corrected simulation in use: its file, open-loop prediction, scenarios."""
