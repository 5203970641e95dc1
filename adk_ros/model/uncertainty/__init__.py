# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rollouts, their online validation, their calibrated covariance, and the naive predictors."""
