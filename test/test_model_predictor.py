# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One tick after the other: what is predicted, what is learned, and what is not."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from model_tools import (
    FEATURES,
    HISTORY,
    SCALING,
    START_NS,
    Array,
    inputs,
    make_model,
    paper_model,
    sample,
    slalom,
)

from adk_ros.errors import UsageError
from adk_ros.model.online import METHODS, OnlineSettings, Windowed
from adk_ros.model.predictor import Model, Prediction, Predictor, Status
from adk_ros.signals.channels import TICK_NS, UNLEARNABLE, Flag, Sample

CONSTANT = OnlineSettings("constant")


def fold(predictor: Predictor, samples: Any) -> list[Prediction | None]:
    return [predictor.step(item) for item in samples]


def by_hand(model: Model, samples: list[Sample], steps: int) -> Array:
    """The docstring's equations with theta0 and no disturbance, from the last of `samples`."""
    scaling, p = model.scaling, model.history
    xs = [scaling.scale_x(np.array(s.x)) for s in reversed(samples)][: p + 1]
    u = scaling.scale_u(np.array(samples[-1].u))
    us = [scaling.scale_u(np.array(s.u)) for s in reversed(samples[:-1])][:p]
    result = []
    for _ in range(steps):
        row = np.concatenate([*xs[: p + 1], *us[:p]]).astype(np.float32)
        z = np.concatenate([xs[0], model.lifting(row)])
        phi = np.concatenate([z, u, [1.0] if model.affine else []])
        change = scaling.step_scale * (model.theta0[:3] @ phi)
        xs.insert(0, xs[0] + change if model.residual else change)
        us.insert(0, u)
        result.append(scaling.unscale_x(xs[0]))
    return np.array(result)


@pytest.mark.parametrize("twin", [True, False])
@pytest.mark.parametrize("residual", [True, False])
@pytest.mark.parametrize("affine", [True, False])
@pytest.mark.parametrize("history", [0, 1, 4])
def test_prediction_by_hand(twin: bool, residual: bool, affine: bool, history: int) -> None:
    model = make_model(
        twin=twin, residual=residual, affine=affine, history=history,
        disturbance_gain=np.zeros(3), online=CONSTANT,
    )  # fmt: skip
    predictor = Predictor(model, horizon_steps=30)
    samples = list(slalom(12))
    last = fold(predictor, samples)[-1]
    assert last is not None
    np.testing.assert_allclose(last.horizon, by_hand(model, samples, 30), rtol=2e-5, atol=2e-5)
    np.testing.assert_array_equal(last.x, last.horizon[0])
    assert last.origin_ns == samples[-1].stamp_ns
    assert last.stamp_ns == samples[-1].stamp_ns + TICK_NS
    assert last.status is predictor.status is Status.PREDICTED


@pytest.mark.parametrize("residual", [True, False])
def test_the_twin_and_torch_agree_while_adapting(residual: bool) -> None:
    """Two seconds ahead, at every tenth tick, with disturbance and windowed least squares."""
    horizons = []
    for twin in (True, False):
        predictor = Predictor(make_model(twin=twin, residual=residual), horizon_steps=0)
        found = []
        for k, item in enumerate(slalom(200)):
            predictor.horizon_steps = 80 if k % 10 == 9 else 0
            prediction = predictor.step(item)
            if predictor.horizon_steps and prediction is not None:
                found.append(prediction.horizon)
        horizons.append(np.array(found))
    np.testing.assert_allclose(horizons[0], horizons[1], rtol=1e-3, atol=1e-3)


def test_the_papers_form_by_hand() -> None:
    """Eq. (5): in the lifted space alone, z+ = A z + B u, lifted once."""
    model = paper_model(online=CONSTANT)
    samples = list(slalom(5))
    last = fold(Predictor(model, horizon_steps=40), samples)[-1]
    assert last is not None
    x = model.scaling.scale_x(np.array(samples[-1].x))
    u = model.scaling.scale_u(np.array(samples[-1].u))
    z = np.concatenate([x, model.lifting(x.astype(np.float32))])
    for step in range(40):
        z = model.theta0 @ np.concatenate([z, u])
        np.testing.assert_allclose(last.horizon[step], model.scaling.unscale_x(z[:3]), atol=1e-9)


@pytest.mark.parametrize("history", [0, 1, 5])
def test_warm_up(history: int) -> None:
    predictor = Predictor(make_model(history=history), horizon_steps=2)
    found = fold(predictor, list(slalom(history + 3)))
    assert [item is None for item in found] == [True] * history + [False] * 3
    first, second = found[history], found[history + 1]
    assert first is not None
    assert second is not None
    assert np.isnan(first.innovation).all()
    assert np.isfinite(second.innovation).all()
    predictor.reset()
    assert predictor.status is Status.WARMING_UP


def test_innovation_is_the_error_of_the_last_prediction() -> None:
    """Before the update with the same sample, whatever that then makes of the model."""
    predictor = Predictor(make_model(), OnlineSettings("windowed", 20, 1e-3), horizon_steps=0)
    before: Prediction | None = None
    for item in slalom(100):
        now = predictor.step(item)
        if before is not None and now is not None:
            np.testing.assert_array_equal(now.innovation, np.array(item.x) - before.x)
        before = now


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
    model = make_model(disturbance_gain=np.zeros(3))
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
    off = np.abs(fitting.roll_out(ahead) - car.roll_out(ahead)) / SCALING.x_scale
    far = np.abs(constant.roll_out(ahead) - car.roll_out(ahead)) / SCALING.x_scale
    assert off.max() < 0.02
    assert far.max() > 0.2


SPOILT = [Flag(bit) for bit in (2, 4, 8, 16)]


def test_spoilt_flags_are_those_that_must_not_be_learned() -> None:
    together = Flag.COASTING
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
                x = tuple(value + wrong * math.sin(k) for value in item.x)
                predictor.step(item._replace(x=x, flags=int(flag)))  # type: ignore[arg-type]
            else:
                predictor.step(item)
        ends.append((predictor.online.theta, predictor.disturbance, predictor._covariance))
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


@pytest.mark.parametrize("why", ["gap", "backwards", "the same again", "restart"])
def test_a_break_in_the_grid_resets(why: str) -> None:
    first, second = list(slalom(50)), list(slalom(80, seed=1))
    by_ns = {"gap": 60 * TICK_NS, "backwards": -TICK_NS * 9, "the same again": 49 * TICK_NS}
    by_ns["restart"] = 50 * TICK_NS
    flags = int(Flag.RESTART) if why == "restart" else 0
    moved = [s._replace(stamp_ns=s.stamp_ns + by_ns[why], flags=0) for s in second]
    moved[0] = moved[0]._replace(flags=flags)
    predictor, fresh = Predictor(make_model()), Predictor(make_model())
    fold(predictor, first)
    for item in moved:
        one, other = predictor.step(item), fresh.step(item)
        assert (one is None) == (other is None)
        if one is not None and other is not None:
            np.testing.assert_array_equal(one.horizon, other.horizon)
            np.testing.assert_array_equal(one.covariance, other.covariance)
            np.testing.assert_array_equal(one.innovation, other.innovation)


def coasting(k: int, u: Any) -> Sample:
    return sample(k, (math.nan,) * 3, u, int(Flag.COASTING | Flag.ODOMETRY_STALE))


@pytest.mark.parametrize("table", [True, False])
def test_coasting(table: bool) -> None:
    """Predictions go on from themselves, with growing covariance, and then not at all."""
    model = make_model() if table else make_model(horizon_covariance=np.zeros((0, 3, 3)))
    predictor = Predictor(model, horizon_steps=20, max_coast_steps=15)
    samples = list(slalom(60))
    last = fold(predictor, samples)[-1]
    assert last is not None
    free = predictor.roll_out(np.tile(samples[-1].u, (16, 1)))
    spread = [np.trace(last.covariance)]
    theta = predictor.online.theta.copy()
    for k in range(15):
        made = predictor.step(coasting(60 + k, samples[-1].u))
        assert made is not None
        assert made.status is predictor.status is Status.COASTING
        assert np.isnan(made.innovation).all()
        assert made.stamp_ns == START_NS + (61 + k) * TICK_NS
        if not k:
            np.testing.assert_allclose(made.x, free[1], atol=1e-2)
        spread.append(np.trace(made.covariance))
    assert (np.diff(spread) > 0.0).all()
    assert predictor.step(coasting(75, samples[-1].u)) is None
    assert predictor.status is Status.NO_STATE
    np.testing.assert_array_equal(predictor.online.theta, theta)
    with pytest.raises(RuntimeError, match="no state"):
        predictor.roll_out(np.zeros((3, 2)))
    # A state again: its past has to be gathered first; what was learned is kept.
    again = [predictor.step(sample(76 + k, samples[-1].x, samples[-1].u)) for k in range(3)]
    assert [item is None for item in again] == [True, True, False]
    np.testing.assert_array_equal(predictor.online.theta, theta)
    assert again[2] is not None
    assert np.isnan(again[2].innovation).all()


def test_a_state_back_in_time_goes_on_without_a_break() -> None:
    predictor = Predictor(make_model(), max_coast_steps=15)
    samples = list(slalom(80))
    for k, item in enumerate(samples):
        made = predictor.step(coasting(k, item.u) if 50 <= k < 60 else item)
        assert (made is None) == (k < HISTORY)
    assert made is not None
    assert made.status is Status.PREDICTED
    predicted = predictor.step(coasting(80, samples[-1].u))
    back = predictor.step(sample(81, samples[-1].x, samples[-1].u))
    assert predicted is not None
    assert back is not None
    np.testing.assert_allclose(back.innovation, np.array(samples[-1].x) - predicted.x)


def test_no_coasting_at_all() -> None:
    predictor = Predictor(make_model(), max_coast_steps=0)
    fold(predictor, slalom(20))
    assert predictor.step(coasting(20, (0.0, 0.0))) is None


def test_nothing_to_coast_from() -> None:
    predictor = Predictor(make_model())
    assert fold(predictor, [coasting(k, (0.0, 0.0)) for k in range(5)]) == [None] * 5
    assert predictor.status is Status.NO_STATE


@pytest.mark.parametrize("u", [(math.nan, 0.0), (0.0, math.inf)])
def test_no_command_no_prediction(u: tuple[float, float]) -> None:
    predictor = Predictor(make_model())
    samples = list(slalom(30))
    fold(predictor, samples[:20])
    assert predictor.step(samples[20]._replace(u=u)) is None
    assert predictor.status is Status.NO_STATE
    assert [item is None for item in fold(predictor, samples[21:])] == [True] * 2 + [False] * 7


def test_a_constant_disturbance_is_found() -> None:
    """The increments are off by a constant: the disturbance gets there, as an acceleration."""
    model = make_model(disturbance_gain=np.full(3, 0.05), disturbance_decay=np.full(3, 0.99))
    predictor, car = Predictor(model, CONSTANT, 20), Predictor(model, CONSTANT, 0)
    push = np.array([0.4, -0.2, 0.1])
    u, x = inputs(300), np.array(SCALING.x_mean)
    for k in range(300):
        item = sample(k, x, u[k])
        made = predictor.step(item)
        car.step(item)
        car._disturbance[:] = 0.0
        x = (car.roll_out(u[k : k + 1])[0] if k >= HISTORY else x) + push * 0.025
        if k == 20:
            assert made is not None
            early = np.abs(made.innovation)
    assert made is not None
    np.testing.assert_allclose(predictor.disturbance, push, rtol=1e-3)
    assert (np.abs(made.innovation) < 1e-3 * early).all()
    # It decays over the horizon: less than `push` for ever, more than none.
    ahead = predictor.roll_out(u[:20])
    predictor._disturbance[:] = 0.0
    moved = (ahead - predictor.roll_out(u[:20]))[-1]
    assert (np.abs(moved) < np.abs(push * 0.5)).all()
    assert (np.sign(moved) == np.sign(push)).all()


def test_gain_zero_switches_the_disturbance_off() -> None:
    predictor = Predictor(make_model(disturbance_gain=np.zeros(3)))
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


@pytest.mark.parametrize("history", [0, 3])
def test_covariance_is_symmetric_and_positive(history: int) -> None:
    predictor = Predictor(make_model(history=history), horizon_steps=0)
    for k, item in enumerate(slalom(500)):
        gone = 200 <= k < 230
        made = predictor.step(coasting(k, item.u) if gone else item)
        if made is not None:
            np.testing.assert_array_equal(made.covariance, made.covariance.T)
            assert np.linalg.eigvalsh(made.covariance).min() > 0.0


def test_covariance_is_that_of_the_innovations() -> None:
    """White noise of known size on a car that stands still."""
    model = make_model(
        theta0=np.zeros((3 + FEATURES, 3 + FEATURES + 3)), disturbance_gain=np.zeros(3)
    )
    predictor = Predictor(model, CONSTANT, horizon_steps=0)
    random, sigma = np.random.default_rng(0), np.array([0.02, 0.01, 0.005])
    found = []
    for k in range(3000):
        x = SCALING.x_mean + sigma * random.normal(size=3)
        made = predictor.step(sample(k, x, (0.0, 0.0)))
        if k > 500 and made is not None:
            found.append(np.diag(made.covariance))
    # The difference of two readings: twice the variance of one.
    np.testing.assert_allclose(np.mean(found, axis=0), 2.0 * sigma**2, rtol=0.1)


def test_covariance_before_anything_is_known() -> None:
    first = fold(Predictor(make_model()), slalom(HISTORY + 1))[-1]
    assert first is not None
    np.testing.assert_array_equal(first.covariance, np.diag([0.01, 0.004, 0.001]))
    bare = fold(Predictor(paper_model()), slalom(1))[-1]
    assert bare is not None
    np.testing.assert_allclose(np.diag(bare.covariance), SCALING.x_scale**2)


def test_roll_out_with_the_held_command_is_the_horizon() -> None:
    for model in (make_model(), make_model(twin=False), paper_model()):
        predictor = Predictor(model, horizon_steps=50)
        samples = list(slalom(120))
        last = fold(predictor, samples)[-1]
        assert last is not None
        held = np.tile(samples[-1].u, (50, 1))
        np.testing.assert_array_equal(predictor.roll_out(held), last.horizon)
        np.testing.assert_array_equal(predictor.roll_out(held[:7]), last.horizon[:7])


def test_roll_out_changes_nothing() -> None:
    for model in (make_model(), make_model(twin=False), paper_model()):
        one, other = Predictor(model, horizon_steps=5), Predictor(model, horizon_steps=5)
        for item in slalom(80):
            made, plain = one.step(item), other.step(item)
            if made is not None and plain is not None:
                one.roll_out(inputs(30, seed=4))
                np.testing.assert_array_equal(made.horizon, plain.horizon)
                np.testing.assert_array_equal(made.innovation, plain.innovation)


def test_roll_out_needs_a_state_and_finite_commands() -> None:
    predictor = Predictor(make_model())
    with pytest.raises(RuntimeError, match="no state to predict from"):
        predictor.roll_out(np.zeros((5, 2)))
    fold(predictor, slalom(20))
    assert np.isnan(predictor.roll_out(np.full((5, 2), np.nan))).all()
    assert predictor.roll_out(np.zeros((0, 2))).shape == (0, 3)
    assert np.isfinite(predictor.roll_out(np.zeros((5, 2)))).all()


def test_what_is_handed_out_may_be_written_to() -> None:
    """A consumer that turns m/s into km/h in place must not move the predictor."""
    one, other = Predictor(make_model(), horizon_steps=5), Predictor(make_model(), horizon_steps=5)
    for item in slalom(60):
        made, plain = one.step(item), other.step(item)
        if made is not None and plain is not None:
            np.testing.assert_array_equal(made.innovation, plain.innovation)
            np.testing.assert_array_equal(made.covariance, plain.covariance)
            made.x[:] = made.horizon[:] = 1e9
            made.covariance[:] = -1.0


@pytest.mark.parametrize("steps", [0, 1, 80, 400])
def test_length_of_the_horizon(steps: int) -> None:
    predictor = Predictor(make_model(), horizon_steps=steps)
    reference = Predictor(make_model(), horizon_steps=1)
    for item in slalom(40):
        made, plain = predictor.step(item), reference.step(item)
        if made is not None and plain is not None:
            assert made.horizon.shape == (steps, 3)
            np.testing.assert_array_equal(made.x, plain.x)


@pytest.mark.parametrize("steps", [-1, 401])
def test_horizon_out_of_range(steps: int) -> None:
    with pytest.raises(UsageError, match=f"horizon is {steps} steps of 25 ms: choose 0 to 400"):
        Predictor(make_model(), horizon_steps=steps)


def test_the_same_samples_give_the_same_to_the_last_bit() -> None:
    model = make_model()
    runs = [fold(Predictor(model), slalom(300)) for _ in range(2)]
    reused = Predictor(model)
    fold(reused, slalom(100, seed=7))
    reused.reset()
    runs.append(fold(reused, slalom(300)))
    for one, *others in zip(*runs, strict=True):
        for other in others:
            assert (one is None) == (other is None)
            if one is not None and other is not None:
                np.testing.assert_array_equal(one.horizon, other.horizon)
                np.testing.assert_array_equal(one.covariance, other.covariance)


def test_models_are_not_changed_by_running_them() -> None:
    model = make_model()
    kept = model.theta0.copy(), model.horizon_covariance.copy()
    fold(Predictor(model), slalom(200))
    np.testing.assert_array_equal(model.theta0, kept[0])
    np.testing.assert_array_equal(model.horizon_covariance, kept[1])


def test_the_models_own_settings_are_the_default() -> None:
    model = make_model(online=OnlineSettings("windowed", 77, 5.0))
    predictor = Predictor(model)
    assert predictor.settings == model.online
    assert isinstance(predictor.online, Windowed)
    assert model.n_z == 3 + FEATURES
    torch.manual_seed(0)
