# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Encoder, scaling and the compiled kernels that lift a sample into the Koopman space."""
