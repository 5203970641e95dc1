# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Surrogate model of the simulator: equations of motion, residuals, identification."""
