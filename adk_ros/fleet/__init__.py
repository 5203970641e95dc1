# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From one recording to a fleet: evidence of many recordings, combined."""
