# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Online least-squares methods that adapt the lifted linear model."""
