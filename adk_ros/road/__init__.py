# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Grade and bank of the road from specific force, velocity and yaw rate, with intervals."""
