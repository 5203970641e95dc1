# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Jacobians and gradients of rollouts against central finite differences."""

import numpy as np
import pytest
from helpers.model import SCALING, Array, make_model, paper_model, sample
from helpers.rollouts import MODELS, adapted, candidates

from adk_ros.errors import UsageError
from adk_ros.model.predictor import Predictor

STEPS = 25
NAMES = [name for name in MODELS if name != "TorchScript"]


def commands(scale: float = 0.5) -> Array:
    result: Array = SCALING.u_mean + scale * (candidates(1, STEPS)[0] - SCALING.u_mean)
    return result


@pytest.mark.parametrize("name", NAMES)
def test_the_jacobian_equals_finite_differences(name: str) -> None:
    """In units of the scaled states and commands, with those limits of motion that act."""
    predictor, u = adapted(MODELS[name]()), commands()
    jacobian = predictor.linearized(u).jacobian()
    differences = np.empty_like(jacobian)
    for j in range(STEPS):
        for c in range(2):
            step = np.zeros_like(u)
            step[j, c] = 1e-5 * SCALING.u_scale[c]
            ahead, behind = (predictor.linearized(u + sign * step) for sign in (1, -1))
            differences[:, :, j, c] = (ahead.predicted - behind.predicted) / (2 * step[j, c])
    unit = SCALING.u_scale / SCALING.x_scale[:, None, None]
    np.testing.assert_allclose(jacobian * unit, differences * unit, rtol=1e-6, atol=1e-8)
    assert np.abs(jacobian * unit).max() > 1e-3
    for j in range(STEPS):
        assert (jacobian[:j, :, j] == 0.0).all()


@pytest.mark.parametrize("name", NAMES)
def test_the_linear_model_reproduces_the_rollout(name: str) -> None:
    predictor, u = adapted(MODELS[name]()), commands()
    model = predictor.linearized(u)
    s = model.states[0]
    for j in range(STEPS):
        s = model.A[j] @ s + model.B[j] @ u[j] + model.c[j]
        np.testing.assert_allclose(s, model.states[j + 1], rtol=1e-9, atol=1e-9)
    # The rollout is float32 inside.
    np.testing.assert_allclose(model.predicted, predictor.rollout(u), rtol=2e-5, atol=2e-5)
    shift = model.predicted - model.output_gain * model.states[1:, :3]
    assert np.isfinite(shift).all()


@pytest.mark.parametrize("name", NAMES)
def test_state_jacobians_equal_finite_differences(name: str) -> None:
    """Two rollouts along other commands: their states differ by A, B to first order."""
    predictor, u = adapted(MODELS[name]()), commands()
    direction = np.random.default_rng(5).normal(size=u.shape) * SCALING.u_scale
    ahead, behind = (predictor.linearized(u + sign * 1e-5 * direction) for sign in (1, -1))
    slope = (ahead.states - behind.states) / 2e-5
    at = predictor.linearized(u)
    predicted = np.einsum("hij,hj->hi", at.A, slope[:-1])
    predicted += np.einsum("hij,hj->hi", at.B, direction)
    np.testing.assert_allclose(predicted, slope[1:], rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("name", NAMES)
def test_the_gradient_is_the_jacobian_applied_to_the_cost(name: str) -> None:
    predictor, u = adapted(MODELS[name]()), commands()
    by_state = np.random.default_rng(6).normal(size=(STEPS, 3))
    gradient = predictor.roll_out_gradient(u, by_state)
    expected = np.einsum("ic,icjd->jd", by_state, predictor.linearized(u).jacobian())
    np.testing.assert_allclose(gradient, expected, rtol=1e-9, atol=1e-12)
    # A step of the float32 rollout down the gradient lowers the cost by what it says.
    size = 1e-2 / np.linalg.norm(gradient * SCALING.u_scale)
    step = size * gradient * SCALING.u_scale**2
    ahead, behind = predictor.roll_out_many(np.array([u + step, u - step]))
    found = (by_state * (ahead - behind)).sum()
    assert found == pytest.approx(2 * (gradient * step).sum(), rel=0.05)


def test_saturated_steps_have_the_derivative_of_the_limit() -> None:
    """Each state moves by its largest change: no command counts, each state keeps its change."""
    predictor = adapted(make_model(motion_limits=np.array([1e-6, 1e-6, 1e-6, 1e3])))
    model = predictor.linearized(commands())
    np.testing.assert_array_equal(model.jacobian(), 0.0)
    np.testing.assert_array_equal(model.A[:, :3, :3], np.tile(np.eye(3), (STEPS, 1, 1)))


def test_the_lateral_limit_has_its_derivative() -> None:
    """The yaw rate follows the speed, |v_x r| = limit."""
    predictor, u = adapted(make_model(motion_limits=np.array([50.0, 50.0, 50.0, 0.5]))), commands()
    model = predictor.linearized(u)
    lateral = np.abs(model.states[1:, 0] * model.states[1:, 2])
    assert np.isclose(lateral, 0.5, rtol=1e-9).any() or (np.diff(lateral) <= 1e-9).any()
    direction = SCALING.u_scale * np.ones_like(u)
    ahead, behind = (predictor.linearized(u + sign * 1e-6 * direction) for sign in (1, -1))
    slope = (ahead.predicted - behind.predicted) / 2e-6
    found = np.einsum("icjd,jd->ic", model.jacobian(), direction)
    np.testing.assert_allclose(found, slope, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("name", ["monitored", "limits", "naive", "paper"])
def test_at_standstill_the_linear_model_is_finite(name: str) -> None:
    predictor = Predictor(MODELS[name](), horizon_steps=0)
    for k in range(30):
        predictor.step(sample(k, (0.0, 0.0, 0.0), (0.0, 0.0)))
    model = predictor.linearized(np.zeros((80, 2)))
    assert all(np.isfinite(array).all() for array in model)
    expected = predictor.rollout(np.zeros((80, 2)))
    np.testing.assert_allclose(model.predicted, expected, rtol=1e-4, atol=1e-4)


def test_unusable_requests_are_refused() -> None:
    predictor, u = adapted(make_model()), commands()
    with pytest.raises(UsageError, match=r"commands have shape \(1, 25, 2\): give \(h, 2\)"):
        predictor.linearized(u[None])
    with pytest.raises(UsageError, match=r"command \(0, 0\) is nan"):
        predictor.linearized(np.full((3, 2), np.nan))
    for wrong in (np.zeros((STEPS, 2)), np.full((STEPS, 3), np.inf)):
        with pytest.raises(UsageError, match=r"the gradient by the states has shape .*25, 3"):
            predictor.roll_out_gradient(u, wrong)
    with pytest.raises(UsageError, match="not a perceptron of the form that is compiled"):
        adapted(make_model(compiled=False)).linearized(u)
    with pytest.raises(UsageError, match="no state to predict from"):
        Predictor(paper_model()).linearized(u)
    predictor.online.theta[:, 0] = np.nan
    with pytest.raises(UsageError, match="this candidate leads to states that are not finite"):
        predictor.linearized(u)
    assert adapted(make_model()).linearized(np.zeros((0, 2))).jacobian().shape == (0, 3, 0, 2)
