# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Predictors on the tests of the paper, compared under one protocol."""
