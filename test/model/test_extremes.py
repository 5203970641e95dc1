# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whatever samples come, nothing that is handed out is anything but finite numbers."""

import functools
import math
from typing import Any

import numpy as np
import pytest
from helpers.model import SCALING, Array, make_model, paper_model, sample, slalom
from hypothesis import given, settings
from hypothesis import strategies as st

from adk_ros.model.adaptation.online_methods import METHODS, OnlineSettings
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.prediction import Prediction, Status
from adk_ros.model.predictor import Predictor
from adk_ros.signals.channels import Flag, Sample

ANY = st.one_of(
    st.floats(-150, 150),
    st.floats(allow_nan=True, allow_infinity=True),
    st.sampled_from([0.0, -0.0, 1e-300, 5e-324, 1e6, -1e9, 1e30, 1e155, 1.7e308, -1.7e308]),
)
FLAGS = st.sampled_from([0, 0, 0, 1, 2, 4, 8, 16, 32, 36, 64])


@st.composite
def drives(draw: Any) -> list[Sample]:
    """Quiet stretches with anything at all between them; the grid breaks now and then."""
    result, k = [], 0
    for _ in range(draw(st.integers(1, 6))):
        quiet = draw(st.integers(0, 12))
        result += [s._replace(stamp_ns=sample(k + i, s.x, s.u).stamp_ns) for i, s in
                   enumerate(slalom(quiet))]  # fmt: skip
        k += quiet
        for _ in range(draw(st.integers(0, 4))):
            x = tuple(draw(ANY) for _ in range(3))
            result.append(sample(k, x, (draw(ANY), draw(ANY)), draw(FLAGS)))
            k += draw(st.sampled_from([1, 1, 1, 1, 0, 2, 1000, -5]))
    return result


def check(made: Prediction | None, predictor: Predictor, steps: int) -> None:
    assert np.isfinite(predictor.online.theta).all()
    if made is None:
        assert predictor.status in (Status.WARMING_UP, Status.NO_STATE, Status.IMPLAUSIBLE)
        return
    assert made.horizon.shape == (steps, 3)
    assert np.isfinite(made.horizon).all()
    assert np.isfinite(made.x).all()
    assert np.isfinite(made.covariance).all()
    assert (made.covariance == made.covariance.T).all()
    finite = np.isfinite(made.innovation)
    assert finite.all() or not finite.any()
    # Predictions never leave fifty deviations of the data that the model was made on.
    far = np.abs((made.horizon - SCALING.x_mean) / SCALING.x_scale)
    assert far.max(initial=0.0) <= 50.0 + 1e-6


@functools.cache
def model_of(form: str) -> KoopmanModel:
    if form == "paper":
        return paper_model()
    return make_model(compiled=form != "torch")


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("form", ["default", "paper", "torch"])
@settings(max_examples=25)
@given(drives())
def test_anything_at_all(method: str, form: str, items: list[Sample]) -> None:
    predictor = Predictor(model_of(form), OnlineSettings(method, 10, 1.0), 15, max_coast_steps=6)
    with np.errstate(all="ignore"):
        for item in items:
            check(predictor.step(item), predictor, 15)
        # And when things are well again, so is it.
        k = 10**6
        good = [s._replace(stamp_ns=sample(k + i, s.x, s.u).stamp_ns) for i, s in
                enumerate(slalom(12))]  # fmt: skip
        for item in good:
            made = predictor.step(item)
            check(made, predictor, 15)
    assert made is not None
    assert made.status is Status.PREDICTED


def test_an_absurd_jump_is_not_learned() -> None:
    """One sample 500 m/s off: the fit and the covariance are what they would be without it."""
    theta = []
    for odd in (0.0, 500.0):
        predictor = Predictor(make_model(), OnlineSettings("windowed", 30, 1.0), horizon_steps=0)
        for k, item in enumerate(slalom(120)):
            x = (item.x[0] + (odd if k == 60 else 0.0), *item.x[1:])
            made = predictor.step(item._replace(x=x))
        assert made is not None
        theta.append(predictor.online.theta)
    # The sample's own past is in the lifts for two ticks more; after a window all is the same.
    assert np.abs(theta[0] - theta[1]).max() < 1e-9


@pytest.mark.parametrize("method", ["windowed", "ffrls", "swls"])
def test_ten_thousand_ticks_of_going_straight(method: str) -> None:
    """No excitation at all, which is what most of a drive on a motorway is."""
    settings_ = OnlineSettings(method, 50, 1.0)
    predictor = Predictor(make_model(), settings_, horizon_steps=5)
    random = np.random.default_rng(0)
    ticks = 3000 if method == "swls" else 10_000
    for k in range(ticks):
        x = SCALING.x_mean + 1e-4 * random.normal(size=3)
        made = predictor.step(sample(k, x, SCALING.u_mean))
        check(made, predictor, 5)
    assert made is not None
    assert np.abs(made.x - SCALING.x_mean).max() < 5e-3


def test_a_method_that_blows_up_is_withheld_and_starts_afresh() -> None:
    """Should theta itself be no number, nothing is handed out and the state begins anew."""
    predictor = Predictor(make_model(), horizon_steps=5)
    items = list(slalom(40))
    for item in items[:20]:
        predictor.step(item)
    predictor.online.theta[0, 0] = math.nan
    assert predictor.step(items[20]) is None
    assert predictor.status is Status.WARMING_UP
    made = [predictor.step(item) for item in items[21:]]
    assert [item is None for item in made] == [True] * 2 + [False] * 17


def test_an_unstable_model_that_coasts_for_ever() -> None:
    """Predictions stay within bounds and are withheld once no car can move like them."""
    model = make_model()
    model.theta0[:3, :3] += 0.5 * np.eye(3)
    predictor = Predictor(
        model, OnlineSettings("constant"), 3, max_coast_steps=10**6, withhold_implausible=True
    )
    for item in slalom(20):
        predictor.step(item)
    nothing = (math.nan,) * 3
    for k in range(20, 3000):
        made = predictor.step(sample(k, nothing, (500.0, 0.1), int(Flag.COASTING)))
        check(made, predictor, 3)
    assert made is None
    assert predictor.implausible > 0


def test_commands_that_swing_from_limit_to_limit() -> None:
    predictor = Predictor(make_model(), horizon_steps=20)
    limits: Array = np.array([[1e6, math.pi / 2], [-1e6, -math.pi / 2]])
    for k, item in enumerate(slalom(300)):
        check(predictor.step(item._replace(u=tuple(limits[k % 2]))), predictor, 20)
    made = [predictor.step(s._replace(stamp_ns=s.stamp_ns + 10**9 * 300)) for s in slalom(30)]
    assert made[-1] is not None


def test_implausible_predictions_are_withheld_and_end_the_adaptation_that_makes_them() -> None:
    predictor = Predictor(make_model(), horizon_steps=5, withhold_implausible=True)
    items = list(slalom(60))
    for item in items[:30]:
        predictor.step(item)
    predictor.online.theta[0, -1] += 500.0
    made = [predictor.step(item) for item in items[30:]]
    withheld = [item is None for item in made].index(False)
    assert 1 <= withheld <= 8
    assert predictor.implausible >= 1
    assert all(item is not None for item in made[withheld:])
