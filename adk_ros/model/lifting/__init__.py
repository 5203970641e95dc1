# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Encoder, scaling and compiled kernels that compute the lifted state."""
