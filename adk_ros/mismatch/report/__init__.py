# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Results for people and programs: JSON, sentence, page with figures."""
