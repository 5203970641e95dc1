# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The yaw rate that a network is trained on: as the observer has it, where it is noisy."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.train import SMALL, drive

from adk_ros.signals.channels import Record
from adk_ros.signals.record import build_record
from adk_ros.train import denoising as module
from adk_ros.train.denoising import observer_filter, observer_gain
from adk_ros.train.network_fit import Step
from adk_ros.train.training_run import checkpoints_of, run_training

NOISE = 0.003
"""rad/s."""


@pytest.fixture(scope="module")
def clean() -> Record:
    return build_record(drive("handling", 120.0, clean=True).readings, "clean")


@pytest.fixture(scope="module")
def noisy(clean: Record) -> Record:
    """The same with white noise on all states, in the reference too, as sensors have it."""
    noise = np.random.default_rng(0).normal(0.0, 1.0, clean.x.shape) * [0.02, 0.02, NOISE]
    return replace(clean, x=clean.x + noise, x_ref=clean.x_ref + noise)


def test_clean_measurements_are_not_filtered(clean: Record) -> None:
    assert observer_gain([clean], SMALL.history) == 1.0
    filtered = observer_filter([clean], [clean], SMALL)
    assert filtered(clean) is clean


def test_observer_removes_yaw_rate_noise(clean: Record, noisy: Record) -> None:
    assert observer_gain([noisy], SMALL.history) in module._GAINS[1:]
    told: list[Step] = []
    before = noisy.x.copy()
    filtered = observer_filter([noisy], [noisy], SMALL, told.append)
    train, validation = filtered(noisy), filtered(noisy)
    np.testing.assert_array_equal(noisy.x, before)
    np.testing.assert_array_equal(train.x, validation.x)
    np.testing.assert_array_equal(train.x[:, :2], noisy.x[:, :2])
    np.testing.assert_array_equal(train.x_ref, noisy.x_ref)
    error = np.sqrt(np.nanmean((train.x[200:, 2] - clean.x[200:, 2]) ** 2))
    assert error < 0.8 * NOISE
    assert told[-1].steps == int(0.4 * SMALL.steps)


def test_no_filtering_when_quadratic_features_fail(noisy: Record) -> None:
    """A yaw rate that jumps about as no car's does: the observer would lag behind."""
    jumps = np.cumsum(np.random.default_rng(1).normal(0.0, 0.05, len(noisy)))
    x = noisy.x.copy()
    x[:, 2] = 0.3 * np.tanh(jumps)
    assert observer_gain([replace(noisy, x=x, x_ref=x)], SMALL.history) == 1.0


@pytest.mark.slow
@pytest.mark.usefixtures("one_candidate")
def test_interrupted_training_resumes_in_either_stage(noisy: Record, tmp_path: Path) -> None:
    """The first training's checkpoint stays until all is done, and then is gone."""
    settings = replace(SMALL, steps=20, validate_every=5)
    out = tmp_path / "m"

    def kill(what: str, done: int, total: int) -> None:
        if what.startswith("selecting"):
            raise KeyboardInterrupt

    monkey = pytest.MonkeyPatch()
    with monkey.context() as patched:
        patched.setattr("adk_ros.train.network_fit._CHECKPOINT_EVERY", 5)
        with pytest.raises(KeyboardInterrupt):
            run_training([noisy], out, settings, note=kill)
        assert all(path.is_file() for path in checkpoints_of(out))
        told: list[str] = []
        run_training([noisy], out, settings, note=lambda what, *_: told.append(what))
    assert "preparing: fitting the observer" not in told
    assert sorted(path.name for path in tmp_path.iterdir()) == ["m"]
