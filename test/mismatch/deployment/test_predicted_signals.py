# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Signals predicted 1 s ahead, and their fit in percent."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from helpers.mismatch_drive import driven, simulated_car

from adk_ros.mismatch.deployment.held_out import Evidence
from adk_ros.mismatch.deployment.predicted_signals import predicted_signals, unpredicted_signals
from adk_ros.mismatch.deployment.surrogate_writer import surrogate_yaml
from adk_ros.mismatch.inference.signal_fit import SIGNALS, fit_percent

MODELS = (surrogate_yaml(simulated_car()), surrogate_yaml(simulated_car(drag_area=2.6)))


def test_fit_is_that_of_compare() -> None:
    y = np.array([1.0, 2.0, 3.0, 4.0])
    assert fit_percent(y, y) == 100.0
    assert fit_percent(y, np.full(4, y.mean())) == pytest.approx(0.0)
    assert fit_percent(y, -y) < 0.0
    assert fit_percent(y, np.array([1.0, 2.0, np.nan, 4.0])) == 100.0
    assert math.isnan(fit_percent(np.ones(4), y))
    assert math.isnan(fit_percent(y, np.full(4, np.nan)))


def test_a_correct_model_fits_up_to_the_noise() -> None:
    signals = predicted_signals(MODELS, Evidence(driven(drag_area=2.6), 40.0), "the end")
    assert signals is not None
    assert signals.time_s[0] > 40.0
    assert signals.measured.shape == (5, signals.time_s.size)
    for name, (before, after, perfect) in signals.fits().items():
        assert after == pytest.approx(perfect, abs=3.0), name
        if name in {"v_x", "a_x"}:
            assert before < after - 3.0


def test_signals_without_a_channel_are_not_evaluated() -> None:
    log = driven()
    blind = replace(log, imu_s=np.empty(0), imu=np.empty((0, 3)))
    hidden = unpredicted_signals(has_torque=False, has_imu=False)
    assert set(hidden) == {"v_x", "a_x", "a_y"}
    signals = predicted_signals(MODELS, Evidence(blind, 40.0), "the end", hidden)
    assert signals is not None
    evaluated = {name for name, fit in signals.fits().items() if math.isfinite(fit[0])}
    assert evaluated == set(SIGNALS) - set(hidden)


def test_data_that_are_too_short_give_none() -> None:
    assert predicted_signals(MODELS, Evidence(driven(), 59.5), "the end") is None
