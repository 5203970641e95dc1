# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The person's answer: what was found as one sentence, and as a page with figures."""
