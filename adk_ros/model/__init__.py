# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Deep Koopman model, its predictor, and model folders on disk."""
