# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The range of the training data: stored, and what a sample says that lies beyond it."""

import json
import math
from dataclasses import replace

import numpy as np
from helpers.model import sample
from helpers.train import record

from adk_ros.model.training_range import QUANTITIES, TrainingRange

KNOWN = TrainingRange(
    np.array([0.0, -1.0, -0.5, -500.0, -0.1, -4.0, -0.05]),
    np.array([30.0, 1.0, 0.5, 500.0, 0.1, 4.0, 0.05]),
)


def test_it_comes_back_from_json() -> None:
    known = TrainingRange.of([record()])
    stored = json.loads(json.dumps(known.as_json()))
    again = TrainingRange.from_json(stored)
    assert again is not None
    np.testing.assert_array_equal(again.low, known.low)
    np.testing.assert_array_equal(again.high, known.high)
    assert TrainingRange.from_json(None) is None
    # A model of an earlier version knows no lateral acceleration and no sideslip.
    del stored["lateral_acceleration"], stored["sideslip"]
    earlier = TrainingRange.from_json(stored)
    assert earlier is not None
    assert math.isinf(earlier.high[-1])
    assert "lateral" not in earlier.text
    assert earlier.beyond(sample(0, [record().x[:, 0].mean(), 0.0, 0.0], [0.0, 0.0])) == []


def test_a_sample_within_it_says_nothing() -> None:
    assert KNOWN.beyond(sample(0, [20.0, 0.2, 0.1], [100.0, 0.02])) == []
    # Within a tenth of the range around it.
    assert KNOWN.beyond(sample(0, [32.9, 0.0, 0.0], [0.0, 0.0])) == []
    # What is not measured is not beyond.
    assert KNOWN.beyond(sample(0, [math.nan] * 3, [0.0, 0.0])) == []


def test_a_sample_beyond_it_names_the_quantities() -> None:
    assert KNOWN.beyond(sample(0, [44.1, 0.0, 0.2], [0.0, -0.2])) == [
        "v_x 44.1 m/s (trained on 0 to 30)",
        "delta -0.2 rad (trained on -0.1 to 0.1)",
        "lateral acceleration 8.82 m/s² (trained on -4 to 4)",
    ]
    assert len(KNOWN.text.split(", ")) == len(QUANTITIES)


def test_sideslip_counts_while_the_car_moves() -> None:
    assert KNOWN.beyond(sample(0, [10.0, 0.9, 0.0], [0.0, 0.0])) == [
        "sideslip 0.0898 rad (trained on -0.05 to 0.05)"
    ]
    # Backwards as well; below a tenth of the largest speed it is noise.
    assert len(KNOWN.beyond(sample(0, [-1.0, 0.9, 0.0], [0.0, 0.0]))) == 0
    assert KNOWN.beyond(sample(0, [2.9, 0.9, 0.0], [0.0, 0.0])) == []
    still = replace(record(), x=np.zeros_like(record().x))
    parked = TrainingRange.of([still])
    assert parked.low[-1] == -math.inf
    assert parked.beyond(sample(0, [0.0, 0.0, 0.0], [0.0, 0.0])) == []


def test_the_distance_is_in_widths_of_the_range() -> None:
    states = np.array(
        [[20.0, 0.2, 0.1], [33.0, 0.0, 0.0], [20.0, 0.0, 0.4], [math.nan] * 3, [10.0, 1.0, 0.0]]
    )
    distance = KNOWN.distance(states, [0.0, 0.0])
    # v_x 3 of 30 m/s, a_y 4 of 8 m/s², sideslip 0.0497 of 0.1 rad.
    slip = (math.atan2(1.0, 10.0) - 0.05) / 0.1
    np.testing.assert_allclose(distance, [0.0, 0.1, 0.5, 0.0, slip])
    # The command counts at all steps.
    np.testing.assert_allclose(KNOWN.distance(states[:2], [0.0, 0.2]), [0.5, 0.5])
    planned = np.array([[0.0, 0.0], [0.0, 0.2]])
    np.testing.assert_allclose(KNOWN.distance(states[:2], planned), [0.0, 0.5])
    unlimited = TrainingRange(np.full(7, -math.inf), np.full(7, math.inf))
    np.testing.assert_array_equal(unlimited.distance(states, [1e9, 1.0]), np.zeros(5))
