# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Calibration of sensors and steering from one recording: checks with evidence, and parameters."""
