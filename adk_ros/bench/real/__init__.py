# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Real recordings with injected faults of the sensors: which `adk check --reference` names."""
