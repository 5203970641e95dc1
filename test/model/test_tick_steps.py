# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The tick in one kernel call does what it does in several, also where least squares fails."""

import numpy as np
import pytest
from helpers.model import make_model, slalom

from adk_ros.model.adaptation.online_methods import OnlineSettings, WindowedRidge
from adk_ros.model.predictor import Predictor
from adk_ros.model.tick_steps import CompiledTick, FusedTick, StepwiseTick

SETTINGS = OnlineSettings("windowed", window=20, ridge=1.0)


def predictor() -> Predictor:
    return Predictor(make_model(mean_square_change=np.ones((80, 3))), SETTINGS)


@pytest.mark.parametrize("fails", [False, True])
def test_the_fused_tick_equals_the_compiled_one(fails: bool) -> None:
    fused, compiled = predictor(), predictor()
    assert isinstance(fused._steps, FusedTick)
    assert compiled.rollout_monitor is not None
    compiled._steps = CompiledTick(
        compiled._steps._kept,  # type: ignore[attr-defined]
        compiled.rollout_monitor,
    )
    for k, item in enumerate(slalom(60)):
        if fails and k == 30:
            for one in (fused, compiled):
                assert isinstance(one.online, WindowedRidge)
                one.online._window.gram[0, 0] = -1e9
        results = fused.step(item), compiled.step(item)
        assert (results[0] is None) == (results[1] is None)
        if results[0] is not None and results[1] is not None:
            np.testing.assert_allclose(results[0].horizon, results[1].horizon, atol=1e-12)
            np.testing.assert_array_equal(results[0].covariance, results[1].covariance)
    assert fused.online.failures == compiled.online.failures == int(fails)


def test_models_without_compiled_encoder_take_single_steps() -> None:
    assert isinstance(Predictor(make_model(compiled=False))._steps, StepwiseTick)
    ffrls = Predictor(make_model(mean_square_change=np.ones((80, 3))), OnlineSettings("ffrls"))
    assert type(ffrls._steps) is CompiledTick
