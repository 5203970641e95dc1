# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Published results of the paper: Tables 3 to 8, Max and RMSE in km/h, km/h, deg/s.

Quoted for comparison from Zhang, He, Chen, "Physics-Informed Adaptive Deep Koopman Operator
Modeling for Autonomous Vehicle Dynamics".
"""

from __future__ import annotations

import numpy as np

from adk_ros.bench.paper.cases import NOMINAL
from adk_ros.bench.paper.predictors import ALDK, DK, FFRLS, MF, RLS, SWLS
from adk_ros.numerics.arrays import FloatArray

PAPER_EPOCHS, PAPER_BATCH = 2000, 20
"""Training settings, in Table 2."""
TABLES = {
    3: (NOMINAL,),
    4: (NOMINAL,),
    5: ("mass_plus_160", "mass_minus_170"),
    6: ("inertia_plus_142", "inertia_minus_158"),
    7: ("mountain",),
    8: ("slalom",),
}
"""Tests in each table of the paper."""

TITLES = {
    3: "deep Koopman model with acceleration loss",
    4: "five approaches, nominal vehicle",
    5: "sprung mass changed",
    6: "yaw inertia changed",
    7: "mountain road",
    8: "slalom test road",
}

Entry = tuple[tuple[float, float], tuple[float, float], tuple[float, float]]
"""(Max, RMSE) of v_x, v_y, yaw rate."""

_FIVE: dict[str, dict[str, Entry]] = {
    NOMINAL: {
        MF: ((0.174, 0.038), (0.195, 0.075), (2.945, 1.195)),
        ALDK: ((1.839, 0.220), (0.053, 0.014), (1.157, 0.282)),
        RLS: ((1.846, 0.220), (0.056, 0.010), (0.960, 0.233)),
        FFRLS: ((4.827, 0.108), (0.371, 0.007), (8.731, 0.154)),
        SWLS: ((0.106, 0.011), (0.011, 0.001), (0.377, 0.025)),
    },
    "mass_plus_160": {
        MF: ((0.673, 0.045), (0.270, 0.077), (3.904, 1.263)),
        ALDK: ((2.594, 0.834), (0.442, 0.085), (3.873, 1.091)),
        RLS: ((2.556, 0.818), (0.433, 0.076), (4.037, 0.912)),
        FFRLS: ((1.705, 0.502), (0.308, 0.053), (3.103, 0.550)),
        SWLS: ((0.495, 0.088), (0.067, 0.006), (1.384, 0.122)),
    },
    "mass_minus_170": {
        MF: ((0.673, 0.051), (0.337, 0.074), (0.854, 0.178)),
        ALDK: ((2.586, 0.835), (0.446, 0.087), (3.708, 1.049)),
        RLS: ((2.557, 0.819), (0.436, 0.080), (3.866, 0.891)),
        FFRLS: ((12.13, 0.382), (0.505, 0.029), (49.67, 1.488)),
        SWLS: ((0.247, 0.043), (0.097, 0.021), (1.282, 0.231)),
    },
    "inertia_plus_142": {
        MF: ((0.673, 0.045), (0.291, 0.075), (3.657, 1.172)),
        ALDK: ((2.605, 0.835), (0.435, 0.082), (3.924, 1.086)),
        RLS: ((2.573, 0.822), (0.427, 0.074), (4.078, 0.916)),
        FFRLS: ((2.888, 0.594), (0.437, 0.072), (3.990, 0.636)),
        SWLS: ((0.263, 0.035), (0.064, 0.004), (1.345, 0.055)),
    },
    "inertia_minus_158": {
        MF: ((0.683, 0.032), (0.287, 0.072), (2.963, 1.085)),
        ALDK: ((2.603, 0.836), (0.432, 0.082), (3.916, 1.084)),
        RLS: ((2.570, 0.822), (0.423, 0.074), (4.072, 0.914)),
        FFRLS: ((2.868, 0.588), (0.413, 0.070), (3.948, 0.630)),
        SWLS: ((0.200, 0.038), (0.058, 0.005), (1.217, 0.070)),
    },
    "mountain": {
        MF: ((0.345, 0.146), (0.156, 0.098), (2.323, 1.150)),
        ALDK: ((4.813, 1.622), (0.118, 0.018), (0.507, 0.083)),
        RLS: ((5.831, 1.622), (0.112, 0.016), (0.497, 0.081)),
        FFRLS: ((2.749, 0.776), (0.105, 0.015), (0.495, 0.063)),
        SWLS: ((1.678, 0.044), (0.006, 0.001), (0.181, 0.007)),
    },
    "slalom": {
        MF: ((0.562, 0.027), (0.242, 0.052), (2.195, 0.448)),
        ALDK: ((11.12, 2.994), (0.143, 0.017), (0.540, 0.145)),
        RLS: ((9.072, 2.271), (0.139, 0.014), (0.592, 0.096)),
        FFRLS: ((8.026, 2.035), (0.129, 0.012), (0.495, 0.083)),
        SWLS: ((1.073, 0.173), (0.092, 0.009), (0.350, 0.080)),
    },
}
_TABLE_3: dict[str, Entry] = {
    DK: ((2.030, 0.620), (0.228, 0.090), (4.844, 1.552)),
    ALDK: ((1.840, 0.220), (0.053, 0.014), (1.157, 0.282)),
}

FIVE = (MF, ALDK, RLS, FFRLS, SWLS)
"""The five approaches of the paper, in its order."""
NOMINAL_EFFECT = (0.95, 0.91, 0.91)
"""RMSE reduction from ALDK to SWLS as stated in section 4.2.2; by Table 4 that of v_y is 93 %."""


def published(table: int, test: str) -> dict[str, Entry]:
    """Return the paper's figures for a test, by predictor."""
    return _TABLE_3 if table == 3 else _FIVE[test]


def printed(test: str, name: str, what: str = "rmse") -> FloatArray:
    """Return the paper's `rmse` or `max` (3,), km/h, km/h, deg/s; KeyError if it has none."""
    entry = _TABLE_3[name] if (test == NOMINAL and name == DK) else _FIVE[test][name]
    return np.array([pair[what == "rmse"] for pair in entry])


def effect(test: str) -> FloatArray:
    """Return the relative RMSE reduction from ALDK to SWLS in the paper, (3,)."""
    if test == NOMINAL:
        return np.array(NOMINAL_EFFECT)
    return np.asarray(1.0 - printed(test, SWLS) / printed(test, ALDK))
