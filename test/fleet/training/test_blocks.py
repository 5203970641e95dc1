# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Blocks of a recording and their driving conditions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.train import record

from adk_ros.fleet.training.blocks import blocks_of
from adk_ros.signals.channels import Flag


def test_blocks_cover_the_record_without_overlap() -> None:
    of = record("town", 75.0)
    blocks = blocks_of(of)
    assert [block.start for block in blocks] == [0, 1200, 2400]
    assert [block.stop for block in blocks] == [1200, 2400, len(of)]
    assert sum(b.learnable_s for b in blocks) == pytest.approx(of.learnable.sum() * 0.025)


@pytest.mark.parametrize(
    ("speed", "yaw_rate", "condition"),
    [
        (5.0, 0.0, "0 to 30 km/h"),
        (-5.0, 0.0, "0 to 30 km/h"),
        (10.0, 0.2, "30 to 60 km/h"),
        (10.0, 0.4, "30 to 60 km/h, hard cornering"),
        (20.0, -0.2, "60 to 90 km/h, hard cornering"),
        (40.0, 0.01, "above 90 km/h"),
    ],
)
def test_the_condition_is_speed_and_cornering(speed, yaw_rate, condition) -> None:
    of = record("town", 30.0)
    x = np.tile([speed, 0.0, yaw_rate], (len(of), 1))
    assert {block.condition for block in blocks_of(replace(of, x=x))} == {condition}


def test_a_block_without_learnable_rows_is_left_out() -> None:
    of = record("town", 60.0)
    flags = of.flags.copy()
    flags[:1200] = Flag.ODOMETRY_STALE
    assert [block.start for block in blocks_of(replace(of, flags=flags))] == [1200]
