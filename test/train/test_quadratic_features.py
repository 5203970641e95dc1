# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Quadratic forms by least squares: what they recover, where they stop."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from helpers.train import SMALL
from helpers.train import drive as drive_of

from adk_ros.model import artefact
from adk_ros.model.lifting.encoder import input_size
from adk_ros.train import network_fit as fit_module
from adk_ros.train import quadratic_features
from adk_ros.train.dataset import TRAIN, VALIDATION, split_records
from adk_ros.train.network import Encoder, Lift
from adk_ros.train.network_fit import fit
from adk_ros.train.quadratic_features import QuadraticFeatures, Rows, fit_quadratic, input_columns
from adk_ros.train.training_run import run_training

Array = np.ndarray


def inputs(x: Array, u: Array, row: int, history: int) -> Array:
    past = range(history + 1)
    return np.concatenate([*(x[row - j] for j in past), *(u[row - j] for j in past)])


def known(x: Array, u: Array, row: int) -> Array:
    """A law in the newest states and commands, quadratic in some of them."""
    now, before, last = x[row], x[row - 1], u[row - 1]
    return np.array(
        [
            0.3 * now[0] - 0.2 * now[1] * now[2] + 0.5 * u[row, 0],
            now[1] * before[0] + 0.1 * last[1] ** 2 - 0.4 + 0.3 * now[0] * u[row, 1],
            0.7 * before[2] - 0.6 * now[0] * last[0] + 0.2 * now[2] ** 2,
        ]
    )


def drive(n: int = 3000) -> tuple[Array, Array, Array]:
    random = np.random.default_rng(0)
    x, u = random.normal(size=(n, 3)), random.normal(size=(n, 2))
    target = np.full((n, 3), np.nan)
    for row in range(4, n):
        target[row] = known(x, u, row)
    return x, u, target


def forecast(forms: QuadraticFeatures, row: Array) -> Array:
    lift = Lift(Encoder(4, 4, 1, forms), torch.zeros(4), torch.ones(4))
    with torch.no_grad():
        lifted: Array = lift(torch.tensor(row[None], dtype=torch.float32))[0, 1:].numpy()
    return lifted


def test_a_quadratic_law_is_found() -> None:
    x, u, target = drive()
    target[100:120] = np.nan
    forms = fit_quadratic(x, u, target, np.arange(4, 2000), 4)
    for row in range(2000, 2050):
        given, used = inputs(x, u, row, 4), forms.reach > 0.0
        if (np.abs(given) < forms.reach)[used].all():
            made = forecast(forms, given)
            np.testing.assert_allclose(made, known(x, u, row), atol=1e-4)


def test_a_law_is_found_from_a_part_of_many_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(quadratic_features, "_MAX_ROWS", 500)
    x, u, target = drive()
    forms = fit_quadratic(x, u, target, np.arange(4, 2000), 4)
    for row in range(2000, 2040):
        expected = known(x, u, row)
        assert forecast(forms, inputs(x, u, row, 4)) == pytest.approx(expected, abs=0.01)
    # Its range is that of all rows.
    reach = np.abs(x[4:2000]).max(axis=0)
    assert forms.reach[:3] == pytest.approx(reach * np.array([1.5, 1.0, 1.5]), rel=1e-5)


def test_the_forms_do_not_grow_outside_of_the_data() -> None:
    x, u, target = drive()
    forms = fit_quadratic(x, u, target, np.arange(4, 2000), 4)
    direction = np.ones(input_size(4))
    far = [forecast(forms, scale * direction) for scale in (10.0, 20.0, 30.0)]
    # Only the linear part goes on: the second difference is nothing.
    np.testing.assert_allclose(far[2] - 2 * far[1] + far[0], 0.0, atol=1e-3)
    assert np.abs(far[0]).max() < 40.0


@pytest.mark.parametrize(("history", "columns"), [
    (0, [0, 1, 2]), (1, list(range(10))), (2, list(range(15))), (5, [*range(9), *range(18, 24)]),
])  # fmt: skip
def test_columns_are_three_states_and_three_commands(history: int, columns: list[int]) -> None:
    assert input_columns(history).tolist() == columns


def test_empty_quadratic_features_change_nothing() -> None:
    encoder = Encoder(2, 4, 3)
    assert encoder(torch.zeros(2, 15)).shape == (2, 3)


@pytest.mark.slow(seconds=120)
def test_training_with_them_is_nearer_to_smooth_data(tmp_path: Path) -> None:
    """On a drive without noise, against the same training without the forms."""
    of = [drive_of("handling", 300.0, clean=True).truth()]
    errors = []
    for quadratic in (False, True):
        settings = replace(SMALL, quadratic=quadratic)
        made = run_training(of, tmp_path / str(quadratic), settings)
        assert made.test is not None
        errors.append(made.test.scores["model"].rmse)
        stored = artefact.load(tmp_path / str(quadratic)).model
        assert stored.lifting.compiled is not None
        assert stored.n_z == 3 + (int(0.75 * SMALL.features) + 3 if quadratic else SMALL.features)
    assert np.log(errors[1] / errors[0]).mean() < -0.3


def test_forms_that_do_not_fit_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """Here they leave 0.06 of persistence's loss on the validation part."""
    monkeypatch.setattr(fit_module, "_QUADRATIC_ACCEPT_LOSS", 0.01)
    split = split_records([drive_of("handling", 120.0).truth()], "blocks")
    made = fit(split.of(TRAIN), split.of(VALIDATION), replace(SMALL, steps=10, quadratic=True))
    assert made.network.encoder.level.shape == (0,)
    assert made.network.encoder.b3.shape == (SMALL.features,)


def test_augmented_rows_are_weighted_by_their_accuracy() -> None:
    x, u, target = drive()
    noise = 0.2 * np.random.default_rng(1).normal(size=target.shape)
    rows = np.arange(4, 2000)
    wider = 2.0 * x
    right = np.array([known(wider, u, int(row)) for row in rows])
    states = [wider[rows - j] for j in range(3)]
    alone, helped, misled = (
        fit_quadratic(x, u, target + noise, rows, 4, made)
        for made in (
            None,
            Rows(rows, states, right, np.ones(len(x))),
            Rows(
                rows,
                states,
                right + 30.0 * np.random.default_rng(2).normal(size=right.shape),
                np.ones(len(x)),
            ),
        )
    )
    wrong = {}
    for name, forms in (("alone", alone), ("helped", helped), ("misled", misled)):
        made = [forecast(forms, inputs(x, u, row, 4)) for row in range(2000, 2400)]
        said = np.array([known(x, u, row) for row in range(2000, 2400)])
        wrong[name] = float(np.sqrt(np.mean((np.array(made) - said) ** 2)))
    assert wrong["helped"] < 0.7 * wrong["alone"]
    # Rows that the law does not meet where it was measured weigh next to nothing.
    assert wrong["misled"] < 1.1 * wrong["alone"]
