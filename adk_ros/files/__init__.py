# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Read and write files of our own: validated YAML, folders written whole or not at all."""
