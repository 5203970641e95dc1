# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's training: its networks, its losses, its scaling, and what comes of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from helpers.train import drive, record
from markupsafe import escape

from adk_ros.errors import DataError
from adk_ros.model import artefact
from adk_ros.model.evaluation import sample_at
from adk_ros.model.lifting.scaling import Scaling
from adk_ros.model.predictor import Predictor
from adk_ros.signals.channels import Flag
from adk_ros.train import paper_training
from adk_ros.train.assemble import AssembledModel
from adk_ros.train.network import PaperNetwork
from adk_ros.train.network_fit import Step
from adk_ros.train.paper_step import PaperSamples
from adk_ros.train.train_settings import PaperSettings
from adk_ros.train.training_report import _KINDS, write_report
from adk_ros.train.training_run import run_training

TINY = PaperSettings(hidden=8, features=4, epochs=1)


def forward(layers: torch.nn.Sequential, x: np.ndarray) -> np.ndarray:
    """Eq. (11), layer by layer, in numpy."""
    linear = [layer for layer in layers if isinstance(layer, torch.nn.Linear)]
    for number, layer in enumerate(linear):
        x = x @ layer.weight.detach().numpy().T + layer.bias.detach().numpy()
        if number < len(linear) - 1:
            x = np.maximum(x, 0.0)
    return x


@pytest.mark.parametrize("acceleration", [False, True])
def test_the_loss_is_the_papers(acceleration: bool) -> None:
    """Eqs. (12) to (14) and (25) to (28), by hand, on a batch of three."""
    torch.manual_seed(3)
    network = PaperNetwork(hidden=5, features=4)
    rng = np.random.default_rng(1)
    dt, scale, middle = 0.025, np.array([12.0, 0.6, 0.5]), np.array([16.0, 0.1, 0.0])
    x_k, x_next = (rng.uniform(-1.0, 1.0, (3, 3)) for _ in range(2))
    u_k, force = rng.uniform(-1.0, 1.0, (3, 2)), rng.normal(0.0, 2.0, (3, 2))

    phi_k, phi_next = forward(network.encoder, x_k), forward(network.encoder, x_next)
    a, b = network.a.weight.detach().numpy(), network.b.weight.detach().numpy()
    z_next = np.hstack([x_k, phi_k]) @ a.T + u_k @ b.T
    linear = np.mean((np.hstack([x_next, phi_next]) - z_next) ** 2)
    reconstruction = np.mean((x_k - forward(network.decoder, phi_k)) ** 2)
    prediction = np.mean((x_next - z_next[:, :3]) ** 2)
    wanted = linear + reconstruction + prediction
    v_k, v_predicted = (x * scale + middle for x in (x_k, z_next[:, :3]))
    si_next = x_next * scale + middle
    estimated = (v_predicted - v_k)[:, :2] / dt
    measured = np.column_stack(
        [force[:, 0] + si_next[:, 1] * si_next[:, 2], force[:, 1] - si_next[:, 0] * si_next[:, 2]]
    )
    reach = np.ptp(measured, axis=0)
    if acceleration:
        wanted += np.mean(((measured - estimated) / reach) ** 2)

    goal = paper_training._measured_change(si_next, force) / scale[:2]
    tensors = [torch.tensor(t, dtype=torch.float32) for t in (x_k, x_next, u_k, goal)]
    spread = tensors[3].amax(0) - tensors[3].amin(0)
    now, then, u, target = tensors
    samples = PaperSamples(now, then, u, target, spread, acceleration)
    loss = samples.loss(network, torch.arange(3))
    assert float(loss.detach()) == pytest.approx(wanted, rel=1e-5)


def test_the_measured_change_is_the_motions() -> None:
    """Eq. (27) on the plant's truth: specific force and turning give the change of velocity."""
    truth = drive(clean=True).truth()
    x, a = truth.x[1:-1], truth.a[1:-1]
    change = 0.5 * (truth.x[2:, :2] - truth.x[:-2, :2])
    left = paper_training._measured_change(x, a) - change
    assert np.sqrt(np.mean(left**2, axis=0) / np.mean(change**2, axis=0)) == pytest.approx(
        0.0, abs=0.05
    )
    assert np.all(paper_training._measured_change(x, np.full_like(a, np.nan)) == 0.0)


def test_networks_are_those_of_table_2() -> None:
    network = PaperNetwork()

    def sizes(layers: torch.nn.Sequential) -> list[int]:
        linear = [layer for layer in layers if isinstance(layer, torch.nn.Linear)]
        assert all(layer.bias is not None for layer in linear)
        return [linear[0].in_features, *(layer.out_features for layer in linear)]

    assert sizes(network.encoder) == [3, 128, 128, 128, 12]
    assert sizes(network.decoder) == [12, 128, 128, 128, 3]
    assert network.a.weight.shape == (15, 15)
    assert network.b.weight.shape == (15, 2)
    biases: list[torch.Tensor | None] = [network.a.bias, network.b.bias]
    assert biases == [None, None]
    settings = PaperSettings()
    assert (settings.learning_rate, settings.batch, settings.epochs) == (1e-3, 20, 2000)
    assert (settings.hidden, settings.features) == (128, 12)


def test_min_max_scaling_spans_minus_one_to_one() -> None:
    of = record()
    rows = of.learnable
    scaling = Scaling.min_max(of.x[rows], of.u[rows])
    for scaled in (scaling.scale_x(of.x[rows]), scaling.scale_u(of.u[rows])):
        np.testing.assert_allclose(scaled.min(axis=0), -1.0, atol=1e-12)
        np.testing.assert_allclose(scaled.max(axis=0), 1.0, atol=1e-12)
    np.testing.assert_array_equal(scaling.step_scale, 1.0)


@pytest.fixture(scope="module")
def trained() -> dict[bool, tuple[AssembledModel, list[Step]]]:
    """DK and ALDK after two epochs each."""
    results = {}
    for acceleration in (False, True):
        told: list[Step] = []
        settings = replace(TINY, acceleration=acceleration, epochs=2)
        results[acceleration] = paper_training.fit_paper([record()], settings, told.append), told
    return results


def test_dk_and_aldk_learn_and_differ(
    trained: dict[bool, tuple[AssembledModel, list[Step]]],
) -> None:
    for acceleration, (built, told) in trained.items():
        model = built.model
        # A running mean over a thousand steps, of fewer than five hundred.
        assert told[-1].loss < 0.85 * told[0].loss
        assert told[-1].step <= told[-1].steps < told[-1].step + 20
        assert model.theta0.shape == (7, 9)
        assert (model.residual, model.affine, model.relift) == (False, False, False)
        assert model.history == 0
        assert model.uses_imu is acceleration
        assert model.online.method == "swls"
    assert not np.array_equal(trained[False][0].model.theta0, trained[True][0].model.theta0)


def test_same_seed_same_model(trained: dict[bool, tuple[AssembledModel, list[Step]]]) -> None:
    settings = replace(TINY, acceleration=True, epochs=2)
    again = paper_training.fit_paper([record()], settings)
    np.testing.assert_array_equal(again.model.theta0, trained[True][0].model.theta0)
    assert again.program == trained[True][0].program
    other = paper_training.fit_paper([record()], replace(settings, seed=5, epochs=1))
    assert not np.array_equal(other.model.theta0, again.model.theta0)


def test_an_interrupted_training_continues(
    trained: dict[bool, tuple[AssembledModel, list[Step]]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    settings, path = replace(TINY, acceleration=True, epochs=2), tmp_path / "aldk.npz"
    monkeypatch.setattr(paper_training, "_CHECKPOINT_EVERY", 1)

    class Killed(Exception):
        pass

    def kill_in_the_second_epoch(step: Step) -> None:
        if step.step > 0.6 * step.steps:
            raise Killed

    with pytest.raises(Killed):
        paper_training.fit_paper([record()], settings, kill_in_the_second_epoch, path)
    whole, told = trained[True]
    resumed: list[Step] = []
    again = paper_training.fit_paper([record()], settings, resumed.append, path)
    np.testing.assert_array_equal(again.model.theta0, whole.model.theta0)
    assert again.program == whole.program
    assert 0.5 * told[-1].steps <= resumed[0].step < 0.6 * told[-1].steps
    # A finished one is not repeated; one with other settings does not start from it.
    nothing: list[Step] = []
    kept = paper_training.fit_paper([record()], settings, nothing.append, path)
    np.testing.assert_array_equal(kept.model.theta0, whole.model.theta0)
    assert not nothing
    paper_training.fit_paper([record()], replace(settings, seed=1), nothing.append, path)
    assert nothing[0].step == paper_training.STEPS_PER_REPORT


def test_a_batch_larger_than_the_data_is_refused() -> None:
    with pytest.raises(DataError, match=r"usable samples are fewer than a batch of 65536"):
        paper_training.fit_paper([record()], replace(TINY, batch=65536))


@pytest.mark.slow
@pytest.mark.parametrize(("acceleration", "kind"), [(False, "dk"), (True, "aldk")])
def test_the_artefact_predicts_with_swls(tmp_path: Path, acceleration: bool, kind: str) -> None:
    settings = replace(TINY, acceleration=acceleration)
    run = run_training([record("handling", 90.0)], tmp_path / "model", settings)
    assert run.facts["kind"] == kind
    assert run.trained is None
    assert run.test is not None
    loaded = artefact.load(tmp_path / "model")
    assert loaded.model.horizon_covariance.shape == (80, 3, 3)
    predictor = Predictor(loaded.model)
    assert predictor.settings.method == "swls"
    of = record("town", 60.0)
    theta = predictor.online.theta.copy()
    for row in range(400):
        made = predictor.step(sample_at(of, row))
        assert made is not None
        assert np.isfinite(made.x).all()
    assert np.abs(predictor.online.theta - theta).max() > 0.0
    page = write_report(run, tmp_path / "model").read_text()
    assert f"<dd>{escape(_KINDS[kind])}</dd>" in page
    assert not (tmp_path / "model" / "training.png").exists()


def test_aldk_without_an_imu_is_refused() -> None:
    without = [record("handling", 90.0, imu=False)]
    with pytest.raises(DataError) as caught:
        paper_training.fit_paper(without, replace(TINY, acceleration=True))
    assert str(caught.value) == (
        "ALDK needs accelerations and the bags have no usable IMU: give bags with a "
        "sensor_msgs/Imu topic, or train DK (--paper dk)"
    )
    model = paper_training.fit_paper(without, replace(TINY, acceleration=False)).model
    assert np.isfinite(model.theta0).all()


def test_too_little_data_is_refused() -> None:
    with pytest.raises(DataError, match="only 12 s of training data without gaps"):
        paper_training.fit_paper([record().rows(slice(0, 500))], TINY)


def test_samples_without_a_state_are_left_out() -> None:
    of = record()
    x, flags = of.x.copy(), of.flags.copy()
    x[1000:1040] = np.nan
    flags[1000:1040] = int(Flag.FROZEN | Flag.COASTING)
    model = paper_training.fit_paper([replace(of, x=x, flags=flags)], TINY).model
    assert np.isfinite(model.theta0).all()


def test_a_training_that_diverges_says_so() -> None:
    of = record()
    absurd = np.where(np.isfinite(of.a), 1e30, of.a)
    with pytest.raises(DataError, match="the training diverged"):
        paper_training.fit_paper([replace(of, a=absurd)], replace(TINY, learning_rate=1e30))
