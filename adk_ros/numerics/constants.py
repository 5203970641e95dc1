# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Physical and statistical constants, each defined once."""

from __future__ import annotations

GRAVITY = 9.81
"""Gravitational acceleration, m/s²: the rounded value that the simulated cars and bags are made with."""
AIR_DENSITY = 1.225
"""Density of air, kg/m³: ISO 2533 standard atmosphere at sea level, 15 °C."""
QUANTILE_90 = 1.6448536269514722
"""Standard deviations on either side of the mean that hold 90 % of a normal distribution."""
