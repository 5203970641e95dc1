# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Colours of figures: the palette of Okabe and Ito, which colour-blind readers can distinguish.

Reference: M. Okabe, K. Ito, "Color Universal Design", 2008. Figures add line styles and markers,
so that a print in grey can be read as well.
"""

BLACK, GREY = "#000000", "#767676"
ORANGE, SKY_BLUE, GREEN = "#E69F00", "#56B4E9", "#009E73"
YELLOW, BLUE, VERMILION, PURPLE = "#F0E442", "#0072B2", "#D55E00", "#CC79A7"

BEFORE, AFTER = VERMILION, BLUE
"""Residuals and errors before and after a correction."""
