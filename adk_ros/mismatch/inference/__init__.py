# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From residuals to a decision: likelihood, screening, selection, identifiability."""
