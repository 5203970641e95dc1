# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Learned vehicle models of other authors, trained by their code, on recordings of a real car."""
