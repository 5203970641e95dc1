# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scenarios: driver, sensors, and the simulation of a drive."""
