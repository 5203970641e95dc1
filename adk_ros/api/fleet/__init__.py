# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`adk fleet`: its stages, and what runs them on all recordings of a fleet."""
