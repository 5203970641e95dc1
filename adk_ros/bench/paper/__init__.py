# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's tables: every predictor on every test, under one contract."""
