# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Import tables, MDF4, CAN logs and bags of other messages as a bag, by a map of channels."""
