# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Names of the files of a fleet's report: its page, and the result from which that is written."""

PAGE, DATA = "fleet.html", "fleet.json"
