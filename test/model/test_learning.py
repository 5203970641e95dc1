# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the predictor learns from the drive, and what it must not learn from."""

import math
from dataclasses import replace

import numpy as np
import pytest
from helpers.model import (
    HISTORY,
    SCALING,
    fold,
    inputs,
    make_model,
    paper_model,
    sample,
    slalom,
    slow,
)

from adk_ros.model.adaptation.online_methods import METHODS, OnlineSettings
from adk_ros.model.estimation.observer_gains import ObserverGains
from adk_ros.model.predictor import Predictor
from adk_ros.signals.channels import UNLEARNABLE, Flag

CONSTANT = OnlineSettings("constant")


def test_learning_does_not_reach_back() -> None:
    """The prediction made at a tick is the same whatever the sample after it says."""
    samples = list(slalom(60))
    one, other = Predictor(make_model()), Predictor(make_model())
    for item in samples[:-1]:
        first, second = one.step(item), other.step(item)
    assert first is not None
    assert second is not None
    kept = second.horizon.copy()
    one.step(samples[-1])
    other.step(samples[-1]._replace(x=(20.0, 1.0, 0.5)))
    np.testing.assert_array_equal(first.horizon, kept)


def test_a_wrong_model_of_a_linear_car_is_put_right() -> None:
    """Data made by another theta: windowed least squares finds it, constant never does."""
    model = make_model(observer_gains=ObserverGains.none())
    truth = model.theta0.copy()
    truth[:3] += np.random.default_rng(5).normal(0.0, 0.3, truth[:3].shape)
    truth[:3, :3] -= 0.5 * np.eye(3)
    car = Predictor(replace(model, theta0=truth), CONSTANT, horizon_steps=0)
    fitting = Predictor(model, OnlineSettings("windowed", 300, 1e-3), horizon_steps=0)
    constant = Predictor(model, CONSTANT, horizon_steps=0)
    random, u = np.random.default_rng(0), inputs(600)
    x = np.array(SCALING.x_mean)
    wrong: dict[str, list[float]] = {"fitting": [], "constant": []}
    step = SCALING.x_scale * SCALING.step_scale
    for k in range(600):
        item = sample(k, x, u[k])
        made = car.step(item)
        for name, predictor in (("fitting", fitting), ("constant", constant)):
            prediction = predictor.step(item)
            if prediction is not None and np.isfinite(prediction.innovation).all():
                wrong[name].append(float(np.abs(prediction.innovation / step).max()))
        noise = 0.02 * step * random.normal(size=3)
        x = (made.x if made is not None else x) + noise
    assert np.median(wrong["constant"][-100:]) > 0.15
    assert max(wrong["fitting"][:3]) > 0.2
    # Down to the noise, of which the largest of three is what is looked at.
    assert np.median(wrong["fitting"][-100:]) < 1.7 * 0.02
    # And not by heart: rolled out under other commands it goes where the car goes.
    ahead = inputs(40, seed=9)
    off = np.abs(fitting.rollout(ahead) - car.rollout(ahead)) / SCALING.x_scale
    far = np.abs(constant.rollout(ahead) - car.rollout(ahead)) / SCALING.x_scale
    assert off.max() < 0.02
    assert far.max() > 0.2


SPOILT = [Flag(bit) for bit in (2, 4, 8, 16, 128)]


def test_spoilt_flags_are_those_that_must_not_be_learned() -> None:
    together = Flag.COASTING | Flag.LEVEL_CHANGE
    for flag in SPOILT:
        together |= flag
    assert together == UNLEARNABLE


@pytest.mark.parametrize("flag", SPOILT, ids=str)
@pytest.mark.parametrize("method", ["windowed", "rls", "ffrls", "swls"])
def test_samples_that_must_not_be_learned_never_are(flag: Flag, method: str) -> None:
    """However wrong they are, theta and covariance end up as if there had been others."""
    ends = []
    for wrong in (0.0, 5.0):
        predictor = Predictor(make_model(), OnlineSettings(method, 50, 1.0), horizon_steps=0)
        for k, item in enumerate(slalom(300)):
            spoilt = 100 <= k < 140 or k in (200, 203, 204)
            if spoilt:
                v_x, v_y, yaw_rate = (value + wrong * math.sin(k) for value in item.x)
                predictor.step(item._replace(x=(v_x, v_y, yaw_rate), flags=int(flag)))
            else:
                predictor.step(item)
        covariance = predictor._memory.covariance.copy()
        ends.append((predictor.online.theta, predictor.disturbance, covariance))
    for one, other in zip(*ends, strict=True):
        np.testing.assert_array_equal(one, other)


def test_learning_goes_on_when_the_past_is_clean_again() -> None:
    """Pairs are of two lifts, and each lift has a past: `history` more samples are passed over."""
    predictor = Predictor(make_model(), horizon_steps=0)
    counts = []
    for k, item in enumerate(slalom(60)):
        before = predictor.online.theta.copy()
        predictor.step(item._replace(flags=int(Flag.COMMAND_STALE)) if k == 30 else item)
        counts.append(bool((predictor.online.theta != before).any()))
    assert not any(counts[: HISTORY + 1])
    assert all(counts[HISTORY + 1 : 30])
    assert not any(counts[30 : 30 + HISTORY + 2])
    assert all(counts[30 + HISTORY + 2 :])


def test_no_imu_is_no_hindrance() -> None:
    predictor = Predictor(make_model(), horizon_steps=0)
    fold(predictor, [s._replace(flags=s.flags | int(Flag.NO_IMU)) for s in slalom(50)])
    assert np.abs(predictor.online.theta - predictor.model.theta0).max() > 1e-3


def test_a_constant_disturbance_is_found() -> None:
    """The increments are off by a constant: the disturbance gets there, as an acceleration."""
    model = make_model(observer_gains=slow(0.05, 0.99))
    predictor, car = Predictor(model, CONSTANT, 20), Predictor(model, CONSTANT, 0)
    push = np.array([0.4, -0.2, 0.1])
    u, x = inputs(300), np.array(SCALING.x_mean)
    for k in range(300):
        item = sample(k, x, u[k])
        made = predictor.step(item)
        car.step(item)
        car._memory.disturbance[:] = 0.0
        x = (car.rollout(u[k : k + 1])[0] if k >= HISTORY else x) + push * 0.025
        if k == 20:
            assert made is not None
            early = np.abs(made.innovation)
    assert made is not None
    np.testing.assert_allclose(predictor.disturbance, push, rtol=1e-3)
    assert (np.abs(made.innovation) < 1e-3 * early).all()
    # It decays over the horizon: less than `push` for ever, more than none.
    ahead = predictor.rollout(u[:20])
    predictor._memory.disturbance[:] = 0.0
    moved = (ahead - predictor.rollout(u[:20]))[-1]
    assert (np.abs(moved) < np.abs(push * 0.5)).all()
    assert (np.sign(moved) == np.sign(push)).all()


def test_gain_zero_switches_the_disturbance_off() -> None:
    predictor = Predictor(make_model(observer_gains=ObserverGains.none()))
    fold(predictor, slalom(50))
    assert predictor.disturbance.tolist() == [0.0, 0.0, 0.0]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("form", ["default", "paper"])
def test_every_method_in_every_form(method: str, form: str) -> None:
    online = OnlineSettings(method, 50, 1.0)
    model = make_model() if form == "default" else paper_model()
    predictor = Predictor(model, online, horizon_steps=10)
    made = [item for item in fold(predictor, slalom(400)) if item is not None]
    assert len(made) == 400 - model.history
    assert all(np.isfinite(item.horizon).all() for item in made)
    changed = np.abs(predictor.online.theta - model.theta0).max()
    assert (changed > 1e-4) == (method != "constant")
    assert predictor.settings is online
