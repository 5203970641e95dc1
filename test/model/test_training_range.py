# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The range of the training data: stored, and what a sample says that lies beyond it."""

import json
import math

import numpy as np
from helpers.model import sample
from helpers.train import record

from adk_ros.model.training_range import QUANTITIES, TrainingRange

KNOWN = TrainingRange(
    np.array([0.0, -1.0, -0.5, -500.0, -0.1, -4.0]), np.array([30.0, 1.0, 0.5, 500.0, 0.1, 4.0])
)


def test_it_comes_back_from_json() -> None:
    known = TrainingRange.of([record()])
    stored = json.loads(json.dumps(known.as_json()))
    again = TrainingRange.from_json(stored)
    assert again is not None
    np.testing.assert_array_equal(again.low, known.low)
    np.testing.assert_array_equal(again.high, known.high)
    assert TrainingRange.from_json(None) is None
    # A model of an earlier version knows no lateral acceleration.
    del stored["lateral_acceleration"]
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
