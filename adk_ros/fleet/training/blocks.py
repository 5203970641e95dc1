# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Blocks of a recording, and the driving condition of each."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from adk_ros.numerics.arrays import BoolArray, FloatArray
from adk_ros.signals.channels import TICK_NS, Record

BLOCK_S = 30.0
"""
s; as the longest block of `train.dataset`. A sequence of the training takes 1.6 s of it: 5 % of
the starts of a block are lost at its end.
"""
_BLOCK_ROWS = round(BLOCK_S / (TICK_NS * 1e-9))
_SPEEDS_KMH = (0.0, 30.0, 60.0, 90.0, np.inf)
"""Limits of the speed classes: town, road, country road, motorway."""
HARD_M_S2 = 3.0
"""Lateral acceleration above which tyres leave their linear range on a dry road, m/s²: a driving
condition, nothing else depends on it."""
_HARD_SHARE = 0.1
"""A block is one of hard cornering if it corners hard for a tenth of its time. By choice."""


@dataclass(frozen=True)
class RecordBlock:
    """Rows `start` to `stop` of a record, its driving condition, and its learnable duration, s."""

    start: int
    stop: int
    condition: str
    learnable_s: float


def speed_classes(speed_m_s: FloatArray) -> dict[str, BoolArray]:
    """Return name of the class -> which of the absolute speeds (n,) are in it."""
    speed_kmh = 3.6 * np.abs(speed_m_s)
    classes = {}
    for low, high in pairwise(_SPEEDS_KMH):
        text = f"{low:.0f} to {high:.0f} km/h" if np.isfinite(high) else f"above {low:.0f} km/h"
        classes[text] = np.asarray((speed_kmh >= low) & (speed_kmh < high))
    return classes


def blocks_of(record: Record) -> list[RecordBlock]:
    """
    Return the blocks of a record that have learnable rows; the last one may be shorter.

    The condition: the class of the median speed, and whether the car corners hard.
    """
    blocks = []
    for start in range(0, len(record), _BLOCK_ROWS):
        stop = min(start + _BLOCK_ROWS, len(record))
        learnable = record.learnable[start:stop]
        x = record.x[start:stop][learnable]
        x = x[np.isfinite(x[:, [0, 2]]).all(axis=1)]
        if not len(x):
            continue
        speed = np.array([np.median(np.abs(x[:, 0]))])
        condition = next(name for name, inside in speed_classes(speed).items() if inside[0])
        if np.mean(np.abs(x[:, 0] * x[:, 2]) > HARD_M_S2) >= _HARD_SHARE:
            condition += ", hard cornering"
        seconds = float(learnable.sum()) * TICK_NS * 1e-9
        blocks.append(RecordBlock(start, stop, condition, seconds))
    return blocks
