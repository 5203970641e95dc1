# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Roll-outs of the recent past, and what they say of the model."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.model import Array, make_model, sample, slow

from adk_ros.model.adaptation.online_methods import OnlineSettings
from adk_ros.model.estimation.observer_gains import ObserverGains
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.predictor import Predictor
from adk_ros.model.uncertainty.conformal import ROLLOUT_STRIDE
from adk_ros.signals.channels import Flag

CHANGE = np.outer(np.arange(1.0, 81.0), [1e-3, 1e-5, 1e-5])
STILL = OnlineSettings("constant")


def model(**changes: object) -> KoopmanModel:
    given = {"mean_square_change": CHANGE, "online": STILL, "observer_gains": ObserverGains.none()}
    return make_model(**given | changes)


def drive(car: Predictor, states: Array, commands: Array, flags: dict[int, int]) -> None:
    for k, (x, u) in enumerate(zip(states, commands, strict=True)):
        car.step(sample(k, x, u, flags.get(k, 0)))


def commands(n: int, seed: int = 0) -> Array:
    random = np.random.default_rng(seed)
    t = np.arange(n)[:, None] * 0.025
    swing = np.sin(t * [1.0, 1.7]) + 0.2 * random.normal(size=(n, 2))
    result: Array = np.array([100.0, 0.0]) + np.array([300.0, 0.04]) * swing
    return result


def own_drive(of: KoopmanModel, u: Array) -> Array:
    """What the model itself says will happen, from rest in scaled units."""
    history = of.history
    x = np.tile(of.scaling.x_mean, (len(u), 1))
    car = Predictor(replace(of, mean_square_change=np.zeros((0, 3))), horizon_steps=1)
    assert car.rollout_monitor is None
    for k in range(len(u) - 1):
        made = car.step(sample(k, x[k], u[k]))
        if k >= history and made is not None:
            x[k + 1] = made.x
    return x


def test_correct_model_is_not_shrunk() -> None:
    of, u = model(), commands(1200)
    car = Predictor(of)
    drive(car, own_drive(of, u), u, {})
    assert car.rollout_monitor is not None
    # The scaled state is float32 within the encoder.
    np.testing.assert_allclose(car.rollout_monitor.shrinkage, 1.0, atol=1e-3)
    spread = np.sqrt(np.diagonal(car.horizon_covariance, axis1=1, axis2=2))
    before = np.sqrt(np.diagonal(of.horizon_covariance, axis1=1, axis2=2))
    assert (spread < 0.6 * before).all()


def test_wrong_model_is_shrunk(unshrunk: None) -> None:
    """It is told of commands that the car does not get, and the car stands still."""
    of, u = model(), commands(1200)
    car = Predictor(of)
    drive(car, np.tile(of.scaling.x_mean + 0.1, (1200, 1)), u, {})
    assert car.rollout_monitor is not None
    assert car.rollout_monitor.shrinkage[40:].max() < 0.5
    far = car.rollout(u[-80:])
    car.rollout_monitor.shrinkage[:] = 1.0
    plain = car.rollout(u[-80:])
    now = of.scaling.x_mean + 0.1
    assert (np.abs(far[79] - now) < 0.6 * np.abs(plain[79] - now)).all()


def test_monitored_rollouts_use_the_commands_given() -> None:
    """The covariance after one trial, against a roll-out made with hindsight."""
    of, u = model(observer_gains=slow(0.05, 0.97)), commands(200)
    random = np.random.default_rng(1)
    x = of.scaling.x_mean + np.cumsum(random.normal(0, [0.02, 0.01, 0.005], (200, 3)), axis=0)
    car = Predictor(of, horizon_steps=0)
    first = made = -1
    ahead = np.zeros((80, 3))
    sums: Array = np.zeros((4, 80, 3))
    for k in range(200):
        car.step(sample(k, x[k], u[k]))
        assert car.rollout_monitor is not None
        if first < 0 and (car.rollout_monitor.slots.age == 0).any():
            first, made = k, k
            car.rollout_monitor.shrinkage[:] = 1.0
            ahead = car.rollout(u[k : k + 80])
            sums = car.rollout_monitor.statistics.sums.copy()
        # One trial alone.
        if first >= 0:
            car.rollout_monitor._ticks = 1
        if k == first + 80:
            break
    assert made >= 0
    monitor = car.rollout_monitor
    assert monitor is not None
    scale = of.scaling.x_scale
    m, y = (ahead - x[first]) / scale, (x[first + 1 : first + 81] - x[first]) / scale
    for found, before, new in zip(
        monitor.statistics.sums, sums, (m * y, m * m, 1.0, y * y), strict=True
    ):
        np.testing.assert_allclose(found, 0.985 * before + new, rtol=1e-4, atol=1e-6)
    kept, moved, count, whole = monitor.statistics.sums
    share = kept / moved
    left = np.maximum(whole - share * kept, 0.0) / count
    chance = left / np.maximum((1.0 - share) ** 2 * moved, 1e-12)
    weight = count / (count + 3.0) * np.maximum(1.0 - chance, 0.0)
    trust = np.clip(1.0 - weight * (1.0 - share), 0.0, 1.0)
    np.testing.assert_allclose(monitor.shrinkage, trust, rtol=1e-6)


def test_rollout_starts_every_ten_ticks_and_lasts_its_horizon() -> None:
    of, u = model(), commands(400)
    car = Predictor(of)
    drive(car, own_drive(of, u), u, {})
    assert car.rollout_monitor is not None
    ages = sorted(car.rollout_monitor.slots.age.tolist())
    assert len(ages) == 80 // ROLLOUT_STRIDE
    assert set(np.diff(ages)) <= {ROLLOUT_STRIDE}


@pytest.mark.parametrize("flag", [Flag.FROZEN, Flag.COASTING, Flag.ODOMETRY_STALE])
def test_flagged_samples_do_not_update_shrinkage(flag: Flag) -> None:
    of, u = model(), commands(300)
    x = own_drive(of, u)
    x[150:] += 5.0
    car = Predictor(of, max_coast_steps=400)
    drive(car, x, u, {k: int(flag) for k in range(150, 300)})
    assert car.rollout_monitor is not None
    np.testing.assert_allclose(car.rollout_monitor.shrinkage, 1.0, atol=1e-3)


def test_reset_forgets() -> None:
    of, u = model(), commands(600)
    car = Predictor(of)
    drive(car, np.tile(of.scaling.x_mean + 0.1, (600, 1)), u, {})
    car.reset()
    assert car.rollout_monitor is not None
    assert (car.rollout_monitor.shrinkage == 1.0).all()
    np.testing.assert_allclose(car.horizon_covariance, of.horizon_covariance)
    assert (car.rollout_monitor.slots.age == -1).all()


def test_no_monitor_without_compiled_encoder_or_change_table() -> None:
    assert Predictor(model(compiled=False)).rollout_monitor is None
    assert Predictor(model(mean_square_change=np.zeros((0, 3)))).rollout_monitor is None
    of = model(mean_square_change=np.zeros((0, 3)))
    assert Predictor(of).horizon_covariance is of.horizon_covariance
