# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Closed loop of predictive controllers with several prediction models, on the simulated car."""
