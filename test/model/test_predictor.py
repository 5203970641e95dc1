# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One tick after the other: predictions, horizons, roll-outs, innovations and their covariance."""

import numpy as np
import pytest
from helpers.model import (
    FEATURES,
    HISTORY,
    SCALING,
    Array,
    fold,
    inputs,
    make_model,
    paper_model,
    sample,
    slalom,
)

from adk_ros.errors import UsageError
from adk_ros.model.adaptation.online_methods import OnlineSettings, WindowedRidge
from adk_ros.model.estimation.observer_gains import ObserverGains
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.prediction import Prediction, Status
from adk_ros.model.predictor import Predictor
from adk_ros.signals.channels import TICK_NS, Sample

CONSTANT = OnlineSettings("constant")


def by_hand(model: KoopmanModel, samples: list[Sample], steps: int) -> Array:
    """The docstring's equations with theta0 and no disturbance, from the last of `samples`."""
    scaling, p = model.scaling, model.history
    xs = [scaling.scale_x(np.array(s.x)) for s in reversed(samples)][: p + 1]
    u = scaling.scale_u(np.array(samples[-1].u))
    us = [scaling.scale_u(np.array(s.u)) for s in reversed(samples[:-1])][:p]
    result = []
    for _ in range(steps):
        commands = [u, *us[:p]] if p else []
        row = np.concatenate([*xs[: p + 1], *commands]).astype(np.float32)
        z = np.concatenate([xs[0], model.lifting(row)])
        phi = np.concatenate([z, u, [1.0] if model.affine else []])
        change = scaling.step_scale * (model.theta0[:3] @ phi)
        xs.insert(0, xs[0] + change if model.residual else change)
        us.insert(0, u)
        result.append(scaling.unscale_x(xs[0]))
    return np.array(result)


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("residual", [True, False])
@pytest.mark.parametrize("affine", [True, False])
@pytest.mark.parametrize("history", [0, 1, 4])
def test_prediction_by_hand(compiled: bool, residual: bool, affine: bool, history: int) -> None:
    model = make_model(
        compiled=compiled, residual=residual, affine=affine, history=history,
        observer_gains=ObserverGains.none(), online=CONSTANT,
    )  # fmt: skip
    predictor = Predictor(model, horizon_steps=30)
    # No horizon has been compared with what happened, so none is shrunk.
    samples = list(slalom(11))
    last = fold(predictor, samples)[-1]
    assert last is not None
    np.testing.assert_allclose(last.horizon, by_hand(model, samples, 30), rtol=2e-5, atol=2e-5)
    np.testing.assert_array_equal(last.x, last.horizon[0])
    assert last.origin_ns == samples[-1].stamp_ns
    assert last.stamp_ns == samples[-1].stamp_ns + TICK_NS
    assert last.status is predictor.status is Status.PREDICTED


@pytest.mark.parametrize("residual", [True, False])
def test_compiled_and_torchscript_rollouts_agree_while_adapting(residual: bool) -> None:
    """Two seconds ahead, at every tenth tick, with disturbance and windowed least squares."""
    horizons = []
    for compiled in (True, False):
        predictor = Predictor(make_model(compiled=compiled, residual=residual), horizon_steps=0)
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


def test_covariance_is_that_of_the_innovations() -> None:
    """White noise of known size on a car that stands still."""
    model = make_model(
        theta0=np.zeros((3 + FEATURES, 3 + FEATURES + 3)), observer_gains=ObserverGains.none()
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


def test_initial_covariance() -> None:
    first = fold(Predictor(make_model()), slalom(HISTORY + 1))[-1]
    assert first is not None
    np.testing.assert_array_equal(first.covariance, np.diag([0.01, 0.004, 0.001]))
    bare = fold(Predictor(paper_model()), slalom(1))[-1]
    assert bare is not None
    np.testing.assert_allclose(np.diag(bare.covariance), SCALING.x_scale**2)


def test_roll_out_with_the_held_command_is_the_horizon(unshrunk: None) -> None:
    for model in (make_model(), make_model(compiled=False), paper_model()):
        predictor = Predictor(model, horizon_steps=50)
        samples = list(slalom(120))
        last = fold(predictor, samples)[-1]
        assert last is not None
        held = np.tile(samples[-1].u, (50, 1))
        np.testing.assert_array_equal(predictor.rollout(held), last.horizon)
        np.testing.assert_array_equal(predictor.rollout(held[:7]), last.horizon[:7])


def test_rollout_does_not_change_the_predictor() -> None:
    for model in (make_model(), make_model(compiled=False), paper_model()):
        one, other = Predictor(model, horizon_steps=5), Predictor(model, horizon_steps=5)
        for item in slalom(80):
            made, plain = one.step(item), other.step(item)
            if made is not None and plain is not None:
                one.rollout(inputs(30, seed=4))
                np.testing.assert_array_equal(made.horizon, plain.horizon)
                np.testing.assert_array_equal(made.innovation, plain.innovation)


def test_roll_out_needs_a_state_and_finite_commands() -> None:
    predictor = Predictor(make_model())
    with pytest.raises(RuntimeError, match="no state to predict from"):
        predictor.rollout(np.zeros((5, 2)))
    fold(predictor, slalom(20))
    assert np.isnan(predictor.rollout(np.full((5, 2), np.nan))).all()
    assert predictor.rollout(np.zeros((0, 2))).shape == (0, 3)
    assert np.isfinite(predictor.rollout(np.zeros((5, 2)))).all()


def test_returned_arrays_may_be_written_to() -> None:
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
    assert isinstance(predictor.online, WindowedRidge)
    assert model.n_z == 3 + FEATURES


def test_the_lateral_constants_of_an_affine_model_are_nearly_free() -> None:
    method = Predictor(make_model()).online
    assert isinstance(method, WindowedRidge)
    ridge = method.offset_ridge
    assert set(np.delete(ridge, [1, 2])) == {method.ridge}
    assert set(ridge[[1, 2]]) == {0.01 * method.ridge}
    # Its last regressor is the steering.
    paper = Predictor(paper_model(), OnlineSettings("windowed")).online
    assert isinstance(paper, WindowedRidge)
    assert set(paper.offset_ridge) == {paper.ridge}
