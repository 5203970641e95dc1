# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How often `adk mismatch` is right: cases with an injected effect, and their scores."""
