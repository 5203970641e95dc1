# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The default training: that it learns, is the same each time, survives a kill, and stops."""

from __future__ import annotations

import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from helpers.train import SMALL, made_record, record, small

from adk_ros.errors import DataError, UsageError
from adk_ros.signals.channels import Record
from adk_ros.train import checkpoint, network_fit
from adk_ros.train.dataset import TRAIN, VALIDATION, split_records
from adk_ros.train.network import Network
from adk_ros.train.network_fit import FittedNetwork, Step, choose_device
from adk_ros.train.train_settings import PaperSettings, TrainSettings

SHORT = replace(SMALL, steps=40, batch=32, validate_every=10)


class Killed(Exception):
    """Stands for the signal that ends a training."""


def parts(of: Record | None = None) -> tuple[list[Record], list[Record]]:
    split = split_records([of or record()])
    return split.of(TRAIN), split.of(VALIDATION)


def state(trained: FittedNetwork) -> dict[str, np.ndarray]:
    return {name: value.numpy() for name, value in trained.network.state_dict().items()}


def assert_same(a: FittedNetwork, b: FittedNetwork) -> None:
    np.testing.assert_array_equal(np.array(a.curve), np.array(b.curve))
    assert (a.best_step, a.stopped_early) == (b.best_step, b.stopped_early)
    for name, value in state(a).items():
        np.testing.assert_array_equal(value, state(b)[name], err_msg=name)


@pytest.fixture(scope="module")
def whole() -> FittedNetwork:
    """A short training that nothing disturbed."""
    return network_fit.fit(*parts(), SHORT)


def kill_at(step: int):
    def on_step(now: Step) -> None:
        if now.step == step:
            raise Killed

    return on_step


@pytest.fixture
def often(monkeypatch: pytest.MonkeyPatch) -> None:
    """A checkpoint every 10 steps."""
    monkeypatch.setattr(network_fit, "_CHECKPOINT_EVERY", 10)


@pytest.mark.slow
def test_it_learns_far_more_than_persistence_knows() -> None:
    trained = small().run.trained
    assert trained is not None
    losses = np.array(trained.curve)
    # Losses in units of persistence's: 1 is to have learned nothing.
    assert losses[-1, 1] < 0.4
    assert losses[:, 2].min() < 0.6


def test_the_state_kept_is_that_of_the_best_validation(whole: FittedNetwork) -> None:
    losses = {step: validation for step, _, validation in whole.curve}
    assert losses[whole.best_step] == min(losses.values())
    assert list(losses) == [10, 20, 30, 40]
    assert not whole.stopped_early


def test_same_seed_same_network_other_seed_another(whole: FittedNetwork) -> None:
    assert_same(whole, network_fit.fit(*parts(), SHORT))
    other = network_fit.fit(*parts(), replace(SHORT, seed=1))
    assert not np.array_equal(state(whole)["encoder.w1"], state(other)["encoder.w1"])


def test_progress_reports(whole: FittedNetwork) -> None:
    told: list[Step] = []
    assert_same(whole, network_fit.fit(*parts(), SHORT, told.append))
    assert [step.step for step in told] == list(range(1, 41))
    assert {step.steps for step in told} == {40}
    rates = np.array([step.learning_rate for step in told])
    assert rates.max() == pytest.approx(SHORT.learning_rate, rel=0.05)
    assert np.all(np.diff(rates[:4]) > 0.0)
    assert np.all(np.diff(rates[5:]) < 0.0)
    assert rates[-1] < 0.01 * SHORT.learning_rate
    assert np.isnan([step.validation for step in told[:9]]).all()
    assert np.isfinite([step.validation for step in told[9:]]).all()
    assert np.isfinite([step.loss for step in told]).all()


@pytest.mark.parametrize("killed_at", [[25], [10, 11, 21, 39], [40]])
def test_resumed_training_equals_an_uninterrupted_one(
    whole: FittedNetwork, often: None, tmp_path: Path, killed_at: list[int]
) -> None:
    path = tmp_path / "kept.npz"
    for step in killed_at:
        with pytest.raises(Killed):
            network_fit.fit(*parts(), SHORT, kill_at(step), path)
    told: list[Step] = []
    assert_same(whole, network_fit.fit(*parts(), SHORT, told.append, path))
    # It went on from the last checkpoint, written after the step before the kill at the latest.
    assert told[0].step == (killed_at[-1] - 1) // 10 * 10 + 1


def test_killed_when_it_had_decided_to_stop_it_stops_there_again(
    often: None, tmp_path: Path
) -> None:
    settings = replace(SHORT, learning_rate=1e-12, short_share=0.0, patience=2, steps=200)
    undisturbed = network_fit.fit(*parts(), settings)
    assert undisturbed.stopped_early
    assert [step for step, _, _ in undisturbed.curve] == [10, 20, 30]
    path = tmp_path / "kept.npz"
    network_fit.fit(*parts(), settings, None, path)
    assert_same(undisturbed, network_fit.fit(*parts(), settings, None, path))


def test_no_early_stop_in_the_first_stage() -> None:
    settings = replace(SHORT, learning_rate=1e-12, short_share=0.75, patience=1, steps=80)
    trained = network_fit.fit(*parts(), settings)
    assert trained.stopped_early
    assert trained.curve[-1][0] == 70
    assert trained.best_step == 10


def test_what_was_fitted_before_the_training_is_a_candidate(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A training that makes it worse must not replace it; nor count before the last stage."""
    values = iter([0.1, 0.1, *[0.2 + 0.01 * k for k in range(40)]])
    monkeypatch.setattr(network_fit._Trainer, "validate", lambda _: next(values))
    settings = replace(SHORT, short_share=0.5, patience=2, steps=120, quadratic=True)
    trained = network_fit.fit(*parts(), settings)
    assert trained.best_step == 0
    # In the second stage, which begins at 60, two validations without improvement.
    assert trained.stopped_early
    assert trained.curve[-1][0] == 80
    # One that improves, though it is worse still, goes on.
    values = iter([0.1, 0.1, *[0.3 - 0.001 * k for k in range(40)]])
    trained = network_fit.fit(*parts(), settings)
    assert not trained.stopped_early
    assert trained.best_step == 0


def test_a_checkpoint_of_another_training_is_ignored(
    whole: FittedNetwork, often: None, tmp_path: Path
) -> None:
    path = tmp_path / "kept.npz"
    others = [
        (replace(SHORT, seed=1), parts()),
        (replace(SHORT, noise=0.5), parts()),
        (SHORT, parts(record("handling", 90.0))),
    ]
    for settings, data in others:
        with pytest.raises(Killed):
            network_fit.fit(*data, settings, kill_at(25), path)
        told: list[Step] = []
        assert_same(whole, network_fit.fit(*parts(), SHORT, told.append, path))
        assert told[0].step == 1
        path.unlink()


def test_the_fingerprint_tells_all_that_matters(monkeypatch: pytest.MonkeyPatch) -> None:
    base = record("handling", 90.0)
    keys = {checkpoint.fingerprint(SHORT, [base])}
    for name in ("x", "u", "x_ref", "flags", "episode"):
        changed = getattr(base, name).copy()
        changed[1234] += 1
        keys.add(checkpoint.fingerprint(SHORT, [replace(base, **{name: changed})]))
    keys.add(checkpoint.fingerprint(SHORT, [base, base]))
    keys.add(checkpoint.fingerprint(replace(SHORT, batch=33), [base]))
    assert len(keys) == 8
    assert checkpoint.fingerprint(SHORT, [replace(base, name="moved")]) in keys
    monkeypatch.setattr(checkpoint, "code_digest", lambda: "other code")
    assert checkpoint.fingerprint(SHORT, [base]) not in keys


@pytest.fixture
def kept(often: None, tmp_path: Path) -> Path:
    """A checkpoint as a killed training leaves it."""
    path = tmp_path / "kept.npz"
    with pytest.raises(Killed):
        network_fit.fit(*parts(), SHORT, kill_at(25), path)
    return path


def test_a_checkpoint_is_plain_arrays(kept: Path) -> None:
    assert list(kept.parent.iterdir()) == [kept]
    with zipfile.ZipFile(kept) as archive:
        assert all(name.endswith(".npy") for name in archive.namelist())
        heads = [archive.read(name)[:128] for name in archive.namelist()]
    assert all(head.startswith(b"\x93NUMPY") for head in heads)
    # An array of objects would be pickled behind its header.
    assert not any(b"'descr': '|O'" in head for head in heads)
    with np.load(kept, allow_pickle=False) as stored:
        assert int(stored["step"]) == 20
        assert all(np.isfinite(stored[name]).all() for name in stored.files if name != "key")


def test_a_damaged_checkpoint_is_none(kept: Path) -> None:
    network = Network(SHORT.history, SHORT.hidden, SHORT.features, np.ones(3))
    before = {name: value.clone() for name, value in network.state_dict().items()}
    optimiser = torch.optim.AdamW(network.parameters())
    with np.load(kept) as stored:
        key = str(stored["key"])
    content = kept.read_bytes()
    middle = len(content) // 2
    damaged = [content[:n] for n in (0, 1, 4, 1000, middle, len(content) - 1)]
    damaged += [b"\x00" * 1000, b"\x80\x04N."]
    damaged += [content[:middle] + b"?" * 50 + content[middle + 50 :]]
    for number, part in enumerate(damaged):
        kept.write_bytes(part)
        assert checkpoint.load(kept, key, network, optimiser) is None, number
    kept.unlink()
    assert checkpoint.load(kept, key, network, optimiser) is None
    for name, value in network.state_dict().items():
        assert torch.equal(value, before[name])


def test_a_training_that_diverges_says_so() -> None:
    base = record()
    wild = np.random.default_rng(0).choice([1e-30, 1e30], base.x_ref.shape)
    with pytest.raises(DataError) as caught:
        network_fit.fit(*parts(replace(base, x_ref=wild)), SHORT)
    assert str(caught.value).startswith("the training diverged: lower --learning-rate")
    assert "\n" not in str(caught.value)


def test_too_little_data_is_said_in_one_line() -> None:
    held = [record().rows(slice(0, 300))]
    with pytest.raises(DataError) as caught:
        network_fit.fit([record().rows(slice(0, 600))], held, SHORT)
    assert str(caught.value) == (
        "only 14 s of training data without gaps, at least 20 s are needed: give more or longer "
        "recordings"
    )
    with pytest.raises(DataError, match="no training sequence"):
        network_fit.fit([record().rows(slice(0, 10))], held, SHORT)
    with pytest.raises(DataError, match="no validation sequence"):
        network_fit.fit([record()], [record().rows(slice(0, 10))], SHORT)


def test_a_channel_that_never_changes_is_no_fault() -> None:
    """A car on a straight: nothing to learn of its turning, and nothing to divide by."""
    base = record()
    x, u = base.x.copy(), base.u.copy()
    x[:, 1:], u[:, 1] = 0.0, 0.0
    straight = made_record(x, u)
    trained = network_fit.fit(*parts(straight), SHORT)
    assert all(np.isfinite(value).all() for value in state(trained).values())
    assert np.isfinite(np.array(trained.curve)).all()


def test_a_lateral_velocity_that_is_not_measured_weighs_nothing() -> None:
    x, x_ref = record().x.copy(), record().x_ref.copy()
    x[:, 1] = x_ref[:, 1] = 0.0
    trained = network_fit.fit(*parts(replace(record(), x=x, x_ref=x_ref)), SHORT)
    assert trained.scaling.x_scale[1] == 1.0
    assert trained.scaling.step_scale[1] == 1.0
    # In units of persistence's error.
    assert np.array(trained.curve)[:, 1:].max() < 100.0


def test_devices(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert choose_device("auto").type == "cpu"
    assert choose_device("cpu").type == "cpu"
    with pytest.raises(UsageError, match="torch finds no GPU: use --device auto"):
        choose_device("cuda")
    with pytest.raises(UsageError, match="torch finds no GPU"):
        network_fit.fit(*parts(), replace(SHORT, device="cuda"))
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    assert choose_device("auto").type == "cuda"
    assert choose_device("cuda").type == "cuda"
    assert choose_device("cpu").type == "cpu"


def test_auto_without_a_gpu_trains_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    settings = replace(SHORT, device="auto", steps=10)
    same = network_fit.fit(*parts(), replace(settings, device="cpu"))
    assert_same(same, network_fit.fit(*parts(), settings))


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"steps": 9}, "steps is 9: choose 10 to 10000000"),
        ({"history": 41}, "history is 41: choose 0 to 40"),
        ({"features": 0}, "features is 0"),
        ({"batch": 0}, "batch is 0"),
        ({"learning_rate": float("nan")}, "learning_rate is nan"),
        ({"learning_rate": 0.0}, "learning_rate is 0: choose above 0, at most 1"),
        ({"weight_decay": -1.0}, "weight_decay is -1"),
        ({"noise": float("inf")}, "noise is inf"),
        ({"device": "tpu"}, "device 'tpu' is unknown: choose auto, cpu or cuda"),
    ],
)
def test_settings_out_of_range_are_refused(values: dict, said: str) -> None:
    with pytest.raises(UsageError) as caught:
        TrainSettings(**values)
    assert said in str(caught.value)


def test_paper_settings_out_of_range_are_refused() -> None:
    with pytest.raises(UsageError, match="epochs is 0: choose 1 to 1000000"):
        PaperSettings(epochs=0)
    with pytest.raises(UsageError, match="batch is 0"):
        PaperSettings(batch=0)
