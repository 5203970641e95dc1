# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The turn to the other side in scripts/lateral_constant.py is no error of the predictor."""

from __future__ import annotations

import runpy
from pathlib import Path

import numpy as np
from helpers.model import make_model, slalom

from adk_ros.model.evaluation import sample_at
from adk_ros.model.predictor import Predictor
from adk_ros.signals.channels import Flag, Record
from adk_ros.signals.score import scorable_rows

ROOT = Path(__file__).resolve().parents[3]
TURN = 120


def turned() -> tuple[Record, Record]:
    """Return a drive, and the same mirrored from `TURN` on."""
    samples = list(slalom(240))
    x, u, a = (np.array([getattr(item, name) for item in samples]) for name in "xua")
    stamp_ns = np.array([item.stamp_ns for item in samples])
    zeros = np.zeros(len(x), dtype=np.int64)
    drive = Record(stamp_ns, x, u, a, zeros, x.copy(), zeros.copy())
    script = runpy.run_path(str(ROOT / "scripts" / "lateral_constant.py"), run_name="script")
    return drive, script["mirrored"](drive, TURN)


def test_the_motion_is_mirrored_from_a_row_on() -> None:
    drive, other = turned()
    sign = np.where(np.arange(240) < TURN, 1.0, -1.0)
    for name in ("x", "u", "a", "x_ref"):
        expected = getattr(drive, name).copy()
        expected[:, 1:] *= sign[:, None]
        np.testing.assert_array_equal(getattr(other, name), expected)
    assert other.flags[TURN] == Flag.LEVEL_CHANGE
    assert not np.delete(other.flags, TURN).any()
    # The rows before a scored one are all mirrored, or none.
    rows = scorable_rows(other, 8, 1)
    assert not np.isin(np.arange(TURN, TURN + 9), rows).any()
    assert TURN + 9 in rows


def test_no_prediction_is_compared_across_the_turn() -> None:
    _, other = turned()
    predictor = Predictor(make_model(), horizon_steps=40)
    for row in range(TURN):
        predictor.step(sample_at(other, row))
    ages = predictor._published._stored.age
    assert ages.max() > 0
    made = predictor.step(sample_at(other, TURN))
    assert made is not None
    np.testing.assert_array_equal(made.innovation, 0.0)
    # Of the stored horizons, at most one of this row is left.
    assert ages.max() <= 0
