# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What all HTML pages share: base template, style, provenance, figure colours."""
