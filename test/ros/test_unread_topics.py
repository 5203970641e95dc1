# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Horizons and their covariances are filled and published only if somebody reads them."""

from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from adk_ros.model.prediction import Prediction, Status
from adk_ros.ros.predictor_node import PredictorNode


class Topic:
    def __init__(self, readers: int) -> None:
        self.is_read, self.sent = readers > 0, 0

    def send(self, _content: bytes) -> None:
        self.sent += 1


class Content:
    def __init__(self) -> None:
        self.filled = 0

    def fill(self, *_: object) -> bytes:
        self.filled += 1
        return b""


@pytest.mark.parametrize("horizon_readers", [0, 1])
@pytest.mark.parametrize("covariance_readers", [0, 2])
@pytest.mark.parametrize("stamped_readers", [0, 1])
@pytest.mark.parametrize("wanted", [True, False])
def test_only_what_is_read_is_filled(
    horizon_readers: int, covariance_readers: int, stamped_readers: int, wanted: bool
) -> None:
    debugged: list[bool] = []
    planned: list[bool] = []
    linearized: list[bool] = []
    node: Any = SimpleNamespace(
        _twist=Content(), _horizon=Content(), _covariance=Content(), _twist_out=Topic(0),
        _horizon_out=Topic(horizon_readers), _covariance_out=Topic(covariance_readers),
        _stamped=Content(), _stamped_out=Topic(stamped_readers), _publish_horizon=wanted,
        _trained=None,
        core=SimpleNamespace(
            pipeline=SimpleNamespace(predictor=None, last_sample=None),
            counters=SimpleNamespace(tick_us=[]),
        ),
        _debug=SimpleNamespace(publish=lambda *_: debugged.append(True)),
        _plans=SimpleNamespace(publish=lambda *_: planned.append(True)),
        _rollouts=SimpleNamespace(publish=lambda *_: linearized.append(True)),
    )  # fmt: skip
    node._publish_read_horizon = partial(PredictorNode._publish_read_horizon, node)
    made = Prediction(
        0, 25_000_000, np.zeros(3), np.eye(3), np.zeros((80, 3)), np.zeros((80, 3, 3)),
        np.zeros(3), Status.PREDICTED,
    )  # fmt: skip
    PredictorNode._publish(node, made)
    assert (node._twist.filled, node._twist_out.sent) == (1, 1)
    expected = int(wanted and horizon_readers > 0)
    assert (node._horizon.filled, node._horizon_out.sent) == (expected, expected)
    expected = int(wanted and covariance_readers > 0)
    assert (node._covariance.filled, node._covariance_out.sent) == (expected, expected)
    expected = int(wanted and stamped_readers > 0)
    assert (node._stamped.filled, node._stamped_out.sent) == (expected, expected)
    assert debugged
    assert bool(planned) is wanted
    assert bool(linearized) is wanted
