# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a recording of the real car holds that the simulation of it leaves out."""
