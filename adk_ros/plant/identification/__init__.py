# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Identify vehicle parameters from recordings by output error."""
