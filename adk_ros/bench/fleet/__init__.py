# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Throughput, scaling and memory of `adk fleet`, and of the engines that it could use."""
