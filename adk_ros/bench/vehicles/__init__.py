# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Random vehicles of several simulators, one of which is of another project."""
