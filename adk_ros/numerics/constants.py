# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Physical and statistical constants, each defined once."""

from __future__ import annotations

GRAVITY = 9.81
"""Gravitational acceleration, m/s²: rounded, as in the simulated cars and sample bags."""
AIR_DENSITY = 1.225
"""Density of air, kg/m³: ISO 2533 standard atmosphere at sea level, 15 °C."""
QUANTILE_90 = 1.6448536269514722
"""Half-width of the central 90 % of a normal distribution, in standard deviations."""
