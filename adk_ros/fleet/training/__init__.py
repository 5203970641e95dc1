# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Training data of a fleet: shards on the disk, blocks of them, and which blocks are drawn."""
