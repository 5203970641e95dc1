# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Vehicle parameters, tyres and the equations of motion with 7 and 14 degrees of freedom."""
