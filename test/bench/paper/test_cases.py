# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Drives of the benchmark: split, noise, dropouts and predicted rows."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.train import made_record

from adk_ros.bench.paper import cases
from adk_ros.errors import DataError, UsageError
from adk_ros.plant.scenario.scenario_file import load_scenario, scenarios
from adk_ros.signals.channels import Flag, Record
from adk_ros.train.dataset import TEST, TRAIN, VALIDATION, split_records

SHORT = cases.Durations(train=20.0, test=6.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("drives")
    for test in ("nominal", "slalom"):
        driven, _ = cases.simulate_test(test, SHORT)
        cases.write_truth(place, test, driven)
    return place


def wave(n: int = 4000) -> Record:
    t = np.arange(n) * 0.025
    record = made_record(np.stack([20 + np.sin(t), 0.1 * np.sin(t), 0.2 * np.sin(t)], axis=1))
    return replace(record, a=np.zeros((n, 2)))


def test_every_test_has_its_own_scenario_and_seed() -> None:
    names = [cases.TRAINING, *(test for test in cases.TESTS if test != cases.NOMINAL)]
    assert set(names) <= set(scenarios())
    seeds = [load_scenario(name).seed for name in names]
    assert len(set(seeds)) == len(seeds)
    assert cases.TESTS[:7] == cases.PAPER_TESTS


def test_the_nominal_test_is_held_out(folder: Path) -> None:
    train = cases.training_record(folder, cases.CLEAN)
    test = cases.record_of_test(folder, cases.NOMINAL, cases.CLEAN)
    driven, begin = cases.simulate_test(cases.NOMINAL, SHORT)
    assert len(train) == begin == int(0.7 * len(driven.x))
    np.testing.assert_array_equal(np.concatenate([train.x, test.x]), driven.x)
    assert not driven.readings
    np.testing.assert_array_equal(test.x, test.x_ref)
    other, begin = cases.simulate_test("slalom", SHORT)
    assert begin == 0
    np.testing.assert_array_equal(cases.record_of_test(folder, "slalom", cases.CLEAN).u, other.u)


def test_noise_and_dropout_statistics() -> None:
    clean = wave(40_000)
    heard = cases.noisy(clean, 3)
    lost = heard.flags == int(Flag.ODOMETRY_STALE)
    assert lost.mean() == pytest.approx(0.01, abs=0.002)
    assert not heard.learnable[lost].any()
    assert heard.learnable[~lost].all()
    noise = (heard.x - clean.x)[~lost]
    np.testing.assert_allclose(noise.std(axis=0), [0.02, 0.02, 0.002], rtol=0.03)
    np.testing.assert_allclose(heard.a[~lost].std(axis=0), 0.05, rtol=0.03)
    rows = np.flatnonzero(lost)
    np.testing.assert_array_equal(heard.x[rows], heard.x[rows - 1])
    np.testing.assert_array_equal(heard.a[rows], heard.a[rows - 1])
    np.testing.assert_array_equal(heard.u, clean.u)
    np.testing.assert_array_equal(heard.x_ref, clean.x_ref)
    assert np.isnan(cases.measured(heard)[lost]).all()
    np.testing.assert_array_equal(cases.measured(heard)[~lost], heard.x[~lost])
    np.testing.assert_array_equal(cases.noisy(clean, 3).x, heard.x)
    assert (cases.noisy(clean, 4).x != heard.x).any()


def test_training_uses_only_the_measurement() -> None:
    heard = cases.noisy(wave(), 0, training=True)
    lost = ~heard.learnable
    assert lost.any()
    assert np.isnan(heard.x_ref[lost]).all()
    np.testing.assert_array_equal(heard.x_ref[~lost], heard.x[~lost])


def test_all_rows_with_history_are_predicted() -> None:
    record = cases.noisy(wave(1000), 5)
    rows, starts = cases.rows_of(record, 20)
    np.testing.assert_array_equal(rows, np.arange(8, 999))
    np.testing.assert_array_equal(starts, np.arange(8, 920, 20))
    broken = replace(record, episode=(np.arange(1000) >= 500).astype(np.int64))
    rows, starts = cases.rows_of(broken, 1)
    assert not set(range(499, 508)) & set(rows.tolist())
    assert not set(range(420, 508)) & set(starts.tolist())
    assert {498, 508} <= set(rows.tolist())
    assert {419, 508} <= set(starts.tolist())
    with pytest.raises(DataError, match="too short to be a test"):
        cases.rows_of(wave(60), 20)


def test_validation_data_are_a_tenth_spread_over_the_drive() -> None:
    record = wave(40_000)
    cut = cases.pieces(record)
    np.testing.assert_array_equal(np.concatenate([piece.x for piece in cut]), record.x)
    split = split_records(cut, "bags")
    assert split.seconds(TEST) == 10.0
    assert split.seconds(VALIDATION) == pytest.approx(0.1 * 990.0, abs=0.5)
    assert split.seconds(TRAIN) == pytest.approx(0.9 * 990.0, abs=0.5)
    assert len(split.of(VALIDATION)) == 10


def test_an_unknown_test_is_refused() -> None:
    with pytest.raises(UsageError, match="no_such"):
        cases.simulate_test("no_such", SHORT)
