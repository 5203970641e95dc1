# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Training on data of which one window is in memory."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.train import SMALL, record

from adk_ros.train.dataset import TRAIN, VALIDATION, split_records
from adk_ros.train.network_fit import FittedNetwork, fit
from adk_ros.train.windows import TrainingWindows

SETTINGS = replace(SMALL, steps=60, validate_every=20)


def weights(of: FittedNetwork) -> list[np.ndarray]:
    return [value.numpy() for value in of.network.state_dict().values()]


def trained(windows: TrainingWindows | None, **more) -> list[np.ndarray]:
    split = split_records([record()])
    found = fit(split.of(TRAIN), split.of(VALIDATION), SETTINGS, windows=windows, **more)
    return weights(found)


def test_a_step_has_its_window() -> None:
    windows = TrainingWindows(3, "", lambda _: [])
    assert [windows.of_step(step, 6) for step in range(6)] == [0, 0, 1, 1, 2, 2]
    assert [windows.of_step(step, 2) for step in range(2)] == [0, 1]


def test_equal_windows_change_nothing() -> None:
    train = split_records([record()]).of(TRAIN)
    same = TrainingWindows(3, "k", lambda _: train)
    for one, other in zip(trained(None), trained(same), strict=True):
        np.testing.assert_array_equal(one, other)


def test_each_window_is_read_once_and_learned_from() -> None:
    first, read = split_records([record()]).of(TRAIN), []

    def window(number: int) -> list:
        read.append(number)
        return [record("town", 60.0)] if number == 1 else first

    assert any(
        np.abs(one - other).max() > 0.0
        for one, other in zip(trained(None), trained(TrainingWindows(2, "k", window)), strict=True)
    )
    assert read == [1]


def test_a_checkpoint_of_other_windows_is_not_resumed(tmp_path) -> None:
    settings = replace(SETTINGS, steps=600, validate_every=300)
    split = split_records([record()])
    train, validation = split.of(TRAIN), split.of(VALIDATION)
    path = tmp_path / "checkpoint.npz"

    def first_step(key: str) -> int:
        told: list[int] = []

        def stop(step) -> None:
            told.append(step.step)
            if step.step in {510, 1}:
                raise KeyboardInterrupt

        windows = TrainingWindows(2, key, lambda _: train)
        with pytest.raises(KeyboardInterrupt):
            fit(train, validation, settings, stop, path, windows)
        return told[0]

    fit_until = TrainingWindows(2, "a", lambda _: train)

    def stop_late(step) -> None:
        if step.step == 505:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fit(train, validation, settings, stop_late, path, fit_until)
    assert first_step("a") == 501
    assert first_step("b") == 1
