# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From network to model: the same predictions, tidy features, settings chosen from tables."""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np
import pytest
import torch
from helpers.train import SMALL, drive, record, small

from adk_ros.model import artefact
from adk_ros.model.adaptation.online_methods import OnlineSettings
from adk_ros.model.estimation.observer_gains import ObserverGains
from adk_ros.model.evaluation import sample_at
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.predictor import Predictor
from adk_ros.signals.channels import Record, Source
from adk_ros.signals.record import build_record
from adk_ros.train import assemble as assembly
from adk_ros.train import hyperparameters as module
from adk_ros.train.assemble import assemble
from adk_ros.train.dataset import TRAIN, VALIDATION, Split, sequences, split_records
from adk_ros.train.hyperparameters import horizon_covariance, select_hyperparameters
from adk_ros.train.network import as_tensor
from adk_ros.train.network_fit import FittedNetwork, fit

HISTORY = SMALL.history


@pytest.fixture(scope="module")
def split() -> Split:
    return split_records([record()])


@pytest.fixture(scope="module")
def trained(split: Split) -> FittedNetwork:
    """Not `small()`: that one's network has its features folded in already."""
    return fit(split.of(TRAIN), split.of(VALIDATION), replace(SMALL, steps=60))


@pytest.fixture(scope="module")
def model(trained: FittedNetwork, split: Split) -> KoopmanModel:
    part = sequences(split.of(TRAIN), HISTORY, 2, "training")
    return assemble(copy.deepcopy(trained), part, uses_imu=True).model


def encoder_rows(model: KoopmanModel, of: Record, rows: np.ndarray) -> np.ndarray:
    """The encoder's input by its definition: x_k ... x_(k-p), u_k ... u_(k-p), scaled."""
    x, u = model.scaling.scale_x(of.x), model.scaling.scale_u(of.u)
    past = [x[rows - i] for i in range(model.history + 1)]
    past += [u[rows - i] for i in range(model.history + 1)]
    return np.concatenate(past, axis=1).astype(np.float32)


def good_rows(of: Record, ahead: int = 20) -> np.ndarray:
    return sequences([of], HISTORY, ahead, "some").rows


def test_features_have_zero_mean_and_unit_deviation(model: KoopmanModel, split: Split) -> None:
    features = []
    for of in split.of(TRAIN):
        rows = good_rows(of, 2)
        features += [model.lifting(row).copy() for row in encoder_rows(model, of, rows[::3])]
    table = np.array(features)
    assert table.shape[1] == model.n_z - 3
    np.testing.assert_allclose(table.mean(axis=0), 0.0, atol=0.05)
    np.testing.assert_allclose(table.std(axis=0), 1.0, atol=0.05)


def test_folding_changes_no_prediction(trained: FittedNetwork, model: KoopmanModel) -> None:
    """The network before, in torch, against the model after, by the predictor."""
    of = record()
    rows = good_rows(of)[::200]
    column, past, step = rows[:, None], np.arange(HISTORY + 1), np.arange(20)
    x, u = trained.scaling.scale_x(of.x), trained.scaling.scale_u(of.u)
    network = trained.network.eval()
    with torch.no_grad():
        wanted = network.roll_out(
            as_tensor(x[column - past]),
            as_tensor(u[column - 1 - past[:-1]]),
            as_tensor(u[column + step]),
        ).numpy()
    wanted = trained.scaling.unscale_x(wanted)
    predictor = Predictor(model, OnlineSettings("constant"), horizon_steps=0)
    for number, row in enumerate(rows):
        predictor.reset()
        for k in range(row - HISTORY, row + 1):
            made = predictor.step(sample_at(of, k))
        assert made is not None
        predicted = predictor.rollout(of.u[row : row + 20])
        np.testing.assert_allclose(predicted, wanted[number], rtol=1e-4, atol=1e-4)


def test_the_rows_of_the_features_are_least_squares(model: KoopmanModel, split: Split) -> None:
    """The normal equations hold, with a ridge of 1: phi' (change - phi theta') = theta'."""
    normal, size, moved, left = 0.0, 0, 0.0, 0.0
    for of in split.of(TRAIN):
        rows = good_rows(of, 2)
        now = np.array([model.lifting(row).copy() for row in encoder_rows(model, of, rows)])
        then = np.array([model.lifting(row).copy() for row in encoder_rows(model, of, rows + 1)])
        x, u = model.scaling.scale_x(of.x[rows]), model.scaling.scale_u(of.u[rows])
        phi = np.concatenate([x, now, u, np.ones((rows.size, 1))], axis=1)
        change = (then - now).astype(np.float64)
        residual = change - phi @ model.theta0[3:].T
        normal, size = normal + phi.T @ residual, size + rows.size
        moved, left = moved + np.square(change).sum(), left + np.square(residual).sum()
    assert np.abs(normal - model.theta0[3:].T).max() / size < 1e-5
    assert left < 0.9 * moved


def test_the_offline_model_does_not_adapt(model: KoopmanModel) -> None:
    assert model.online.method == "constant"
    for name in ObserverGains.names():
        expected = getattr(ObserverGains.none(), name)
        np.testing.assert_array_equal(getattr(model.observer_gains, name), expected)
    assert (model.residual, model.affine, model.relift) == (True, True, True)
    assert model.uses_imu
    assert model.lifting.compiled is not None
    assert model.theta0.shape == (3 + SMALL.features, 3 + SMALL.features + 3)


def test_choices_come_from_the_tables_and_get_into_the_artefact() -> None:
    made = small().run.model
    stored = artefact.load(small().path).model
    assert stored.online == made.online
    assert made.online.window == module._WINDOW
    assert made.online.ridge in module._RIDGES
    assert made.online.method == "windowed"
    for name in ObserverGains.names():
        np.testing.assert_array_equal(
            getattr(stored.observer_gains, name), getattr(made.observer_gains, name)
        )
    np.testing.assert_array_equal(stored.mean_square_change, made.mean_square_change)
    np.testing.assert_array_equal(stored.horizon_covariance, made.horizon_covariance)
    np.testing.assert_array_equal(stored.theta0, made.theta0)
    for gain, decay, table in (
        (made.observer_gains.slow_gain, made.observer_gains.slow_decay, module._SLOW),
        (made.observer_gains.fast_gain, made.observer_gains.fast_decay, module._FAST),
    ):
        assert set(zip(gain.tolist(), decay.tolist(), strict=True)) <= set(table)
    assert set(made.observer_gains.observer_gain.tolist()) <= set(module._OBSERVERS)


def test_the_best_choice_is_taken(
    model: KoopmanModel, split: Split, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The ridge by the mean over all cells, gains channel by channel."""
    asked: list[KoopmanModel] = []

    def ratio(of: KoopmanModel, cases: object) -> np.ndarray:
        asked.append(of)
        number = len(asked) - 1
        if number < len(module._RIDGES):
            return np.full((2, 5, 3), -1.0 if number == 2 else -0.5)
        best = (1, 4, 0)
        number = (number - len(module._RIDGES)) % len(module._SLOW)
        return np.tile([-1.0 if of_c == number else -0.5 for of_c in best], (2, 5, 1))

    monkeypatch.setattr(module, "_FAST", module._FAST[: len(module._SLOW)])
    monkeypatch.setattr(module, "_CANDIDATES", 5 * len(module._SLOW) + len(module._RIDGES))
    monkeypatch.setattr(module, "_log_ratio", ratio)
    told: list[tuple[str, int, int]] = []
    chosen = select_hyperparameters(model, split, lambda *what: told.append(what))
    assert chosen.online.ridge == module._RIDGES[2]
    for gain, decay, table in (
        (chosen.observer_gains.slow_gain, chosen.observer_gains.slow_decay, module._SLOW),
        (chosen.observer_gains.fast_gain, chosen.observer_gains.fast_decay, module._FAST),
    ):
        wanted = [table[i] for i in (1, 4, 0)]
        assert list(zip(gain.tolist(), decay.tolist(), strict=True)) == wanted
    assert chosen.observer_gains.observer_gain.tolist() == [
        module._OBSERVERS[i] for i in (1, 4, 0)
    ]
    total, selecting = len(asked), "selecting hyperparameters"
    assert [done for stage, done, _ in told if stage == selecting] == list(range(total))
    assert {end for stage, _, end in told if stage == selecting} == {total}
    rest = [(done, end) for stage, done, end in told if stage != selecting]
    assert rest == sorted(rest)
    assert rest[-1][0] == rest[-1][1]


@pytest.mark.parametrize("best", range(5))
def test_theta_is_the_one_that_validation_likes(
    model: KoopmanModel, split: Split, monkeypatch: pytest.MonkeyPatch, best: int
) -> None:
    thetas = [model.theta0 + 0.01 * k for k in range(5)]

    def ratio(of: KoopmanModel, cases: object) -> np.ndarray:
        near = np.abs(of.theta0 - thetas[best]).max()
        return np.full((2, 5, 3), near - 1.0)

    monkeypatch.setattr(module, "_log_ratio", ratio)
    chosen = select_hyperparameters(model, split, None, thetas[1:])
    np.testing.assert_array_equal(chosen.theta0, thetas[best])


def test_refitted_lies_between_theta_and_least_squares() -> None:
    random = np.random.default_rng(0)
    phi, truth = random.normal(size=(500, 6)), random.normal(size=(3, 6))
    target = phi @ truth.T
    target[7] = np.nan
    theta = np.vstack([np.zeros((3, 6)), np.ones((2, 6))])
    made = assembly._refit_output_layer(theta, phi, target, np.ones(6, dtype=bool), np.zeros(6))
    off = [float(np.abs(each[:3] - truth).max()) for each in made]
    assert off == sorted(off, reverse=True)
    assert off[0] > 0.3 * np.abs(truth).max()
    assert off[-1] < 1e-4
    assert all((each[3:] == 1.0).all() for each in made)


def test_a_lost_cell_costs_more_than_others_gain(
    model: KoopmanModel, split: Split, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second choice is better on the mean, but behind the naive predictor in one cell."""
    lost = np.full((2, 5, 3), -0.8)
    lost[:, 0] = 0.5
    answers = [np.full((2, 5, 3), -0.4), lost]

    def ratio(of: KoopmanModel, cases: object) -> np.ndarray:
        return answers.pop(0) if answers else np.zeros((2, 5, 3))

    assert lost.mean() < -0.4
    monkeypatch.setattr(module, "_log_ratio", ratio)
    assert select_hyperparameters(model, split).online.ridge == module._RIDGES[0]


@pytest.mark.slow
def test_selection_improves_predictions_of_a_perturbed_car(
    model: KoopmanModel, split: Split
) -> None:
    cases = module._cases(split)
    assert len(cases) == 2
    (same, _), (other, _) = cases[0][0], cases[1][0]
    drawn = other.u - other.u.mean(axis=0)
    np.testing.assert_allclose(
        drawn.std(axis=0) / same.u.std(axis=0), 1.0 / module._PERTURBED_INPUT_GAIN
    )
    tuned = select_hyperparameters(model, split)
    before = module._log_ratio(model, cases)
    after = module._log_ratio(tuned, cases)
    assert after[1].mean() < before[1].mean() - 0.1
    assert after.mean() < before.mean()


def test_a_channel_that_one_recording_lacks_is_judged_by_the_others(
    model: KoopmanModel, split: Split
) -> None:
    (whole, scored) = module._cases(split)[0][0]
    without = replace(whole, x=whole.x * [1.0, 0.0, 1.0], x_ref=whole.x_ref * [1.0, 0.0, 1.0])
    alone = module._log_ratio(model, [[(whole, scored)]])
    both = module._log_ratio(model, [[(without, scored), (whole, scored)]])
    assert np.abs(alone[..., 1]).max() > 0.0
    # Another stride: the rows differ.
    np.testing.assert_allclose(both[..., 1], alone[..., 1], atol=0.2)
    assert not module._log_ratio(model, [[(without, scored)]])[..., 1].any()


def test_horizon_covariance_is_one() -> None:
    covariance = small().run.model.horizon_covariance
    assert covariance.shape == (80, 3, 3)
    np.testing.assert_allclose(covariance, covariance.transpose(0, 2, 1))
    assert (np.linalg.eigvalsh(covariance) > 0.0).all()
    spread = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    assert (spread[-1] > spread[0]).all()
    # Errors of a usable model: metres and radians a second, two seconds ahead.
    assert (spread[-1] < [3.0, 1.0, 0.5]).all()


def test_horizon_covariance_is_that_of_the_errors(model: KoopmanModel) -> None:
    """On a drive that is all validation, against errors computed here."""
    of = record().rows(slice(0, 800))
    everything = Split([of], [np.full(800, VALIDATION)], "blocks")
    covariance = horizon_covariance(model, everything, ahead=4)
    predictor = Predictor(model, horizon_steps=0)
    errors = []
    for row in range(len(of) - 4):
        made = predictor.step(sample_at(of, row))
        if made is not None and row >= 8 and (row - 8) % 8 == 0:
            errors.append(predictor.rollout(of.u[row : row + 4]) - of.x_ref[row + 1 : row + 5])
    table = np.array(errors)
    np.testing.assert_allclose(covariance, np.einsum("nhi,nhj->hij", table, table) / len(table))


def test_too_short_a_validation_still_yields_a_model(model: KoopmanModel) -> None:
    of = record().rows(slice(0, 800))
    parts = np.full(800, TRAIN)
    parts[400:460] = VALIDATION
    tuned = select_hyperparameters(model, Split([of], [parts], "blocks"))
    assert tuned.online.method == "windowed"
    assert tuned.horizon_covariance.shape == (80, 3, 3)
    assert (np.linalg.eigvalsh(tuned.horizon_covariance) > 0.0).all()


def test_a_frozen_sensor_in_the_training_data_does_not_spoil_the_model(split: Split) -> None:
    """While odometry repeats itself there is no state, though measurements on both sides."""
    readings, stuck = [], None
    start_ns = drive().stamp_ns[0]
    for reading in drive().readings:
        since_s = (reading.stamp_ns - start_ns) * 1e-9
        values = reading.values
        if reading.source is Source.ODOMETRY and 10.0 < since_s < 13.0:
            values = stuck = stuck or values
        readings.append(reading._replace(values=values))
    of = build_record(readings, "frozen")
    stateless = ~np.isfinite(of.x).all(axis=1)
    assert (stateless & np.isfinite(of.x_ref).all(axis=1)).sum() > 40
    parts = split_records([of])
    assert (parts.parts[0][stateless] == TRAIN).any()
    fitted = fit(parts.of(TRAIN), parts.of(VALIDATION), replace(SMALL, steps=20))
    joined = sequences(parts.of(TRAIN), HISTORY, 2, "training")
    assert np.isfinite(assemble(fitted, joined, uses_imu=True).model.theta0).all()
