# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Evidence of each recording about the effects, and its combination over a fleet."""
