# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Drives of a benchmark: one for training, tests, each in a clean and a noisy variant.

Training and the nominal test are the first 70 % and the rest of one drive, as in the paper; each
other test is a separate drive with its own seed. In the noisy variant x and a carry white noise,
and samples drop out. Predictions start from the measurement and are scored against the truth;
training uses only the measurement, as for a real recording.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from adk_ros.bench.paper.other_simulators import OtherDrive
from adk_ros.errors import DataError
from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.plant.scenario.scenario_file import Scenario, load_scenario
from adk_ros.plant.scenario.sensor_simulation import SimulatedDrive
from adk_ros.plant.scenario.simulate import Progress, simulate
from adk_ros.signals.channels import Flag, Record

TRAINING = "xyz_edges"
NOMINAL = "nominal"
PAPER_TESTS = (
    NOMINAL, "mass_plus_160", "mass_minus_170", "inertia_plus_142", "inertia_minus_158",
    "mountain", "slalom",
)  # fmt: skip
"""Tests of sections 4.2 to 4.4 of the paper."""
OWN_TESTS = ("winter", "gusts", "worn_tyres")
TESTS = PAPER_TESTS + OWN_TESTS
CLEAN, NOISY = "clean", "noisy"
VARIANTS = (CLEAN, NOISY)

TRAINING_SHARE = 0.7
NOISE = np.array([0.02, 0.02, 0.002])
"""Standard deviation of v_x, v_y (m/s) and yaw rate (rad/s), as in `Odometry`."""
FORCE_NOISE = 0.05
"""Standard deviation of a_x and a_y, m/s², as in `Imu`."""
DROPPED = 0.01
"""Share of the ticks that repeat x and a of the tick before."""

HISTORY = 8
"""Samples before the first predicted row: the longest history that a predictor needs."""
AHEAD = 80
"""Longest horizon in ticks: 2 s."""
PIECES_S = 100.0
"""Approximate length of the pieces that validation data are taken from, s."""
_TEST_PIECE_S = 10.0
_NOISE_SEED = 2026


@dataclass(frozen=True)
class DriveSet:
    """
    The drives of a benchmark.

    `training`: scenario, by name or file, of training and nominal test. `tests`: names, of which
    `NOMINAL` is one. `files`: scenario files by test; the others are packaged scenarios of the
    test's name. `noise_scale`: factor on the noise of the noisy variant. `noise_seed`: of it.
    `others`: tests in other simulators, which have no scenario.
    """

    training: str = TRAINING
    tests: tuple[str, ...] = TESTS
    files: Mapping[str, str] = field(default_factory=dict)
    noise_scale: float = 1.0
    noise_seed: int = _NOISE_SEED
    others: Mapping[str, OtherDrive] = field(default_factory=dict)

    def scenario(self, test: str) -> Scenario:
        """
        Return the scenario of a test.

        :raises UsageError: there is none of that name.
        """
        return load_scenario(self.training if test == NOMINAL else self.files.get(test, test))


PAPER_DRIVES = DriveSet()
"""Ten tests, chosen and looked at while the method was developed."""


@dataclass(frozen=True)
class Durations:
    """Durations, s; None: those of the scenarios. `train` includes the nominal test."""

    train: float | None = None
    test: float | None = None


def simulate_test(
    test: str,
    durations: Durations,
    progress: Progress | None = None,
    drives: DriveSet = PAPER_DRIVES,
) -> tuple[SimulatedDrive, int]:
    """
    Simulate the drive of a test; return it without readings, and the row where the test begins.

    :raises UsageError: there is no scenario of that name.
    """
    nominal = test == NOMINAL
    scenario = drives.scenario(test)
    seconds = durations.train if nominal else durations.test
    driven = simulate(scenario, duration_s=seconds, progress=progress)
    # The sensor readings, half a million, are not needed here.
    driven = replace(driven, readings=[], streams={}, log_ns=driven.log_ns[:0])
    return driven, _cut(len(driven.x)) if nominal else 0


def _cut(n: int) -> int:
    return int(TRAINING_SHARE * n)


def write_truth(folder: Path, test: str, driven: SimulatedDrive | Record) -> None:
    """Write the truth of a drive for the other processes."""
    np.savez(folder / f"{test}.npz", stamp_ns=driven.stamp_ns, x=driven.x, u=driven.u, a=driven.a)


def _read_truth(folder: Path, test: str) -> Record:
    with np.load(folder / f"{test}.npz") as stored:
        stamp_ns, x, u, a = (stored[name] for name in ("stamp_ns", "x", "u", "a"))
    zeros = np.zeros(len(x), dtype=np.int64)
    return Record(stamp_ns, x, u, a, zeros, x.copy(), zeros.copy(), test)


def record_of_test(
    folder: Path, test: str, variant: str, drives: DriveSet = PAPER_DRIVES
) -> Record:
    """Return the record of a test: measurement `x`, truth `x_ref`."""
    record = _read_truth(folder, test)
    if test == NOMINAL:
        record = record.rows(slice(_cut(len(record)), None))
    return record if variant == CLEAN else noisy(record, 1 + drives.tests.index(test), drives)


def training_record(folder: Path, variant: str, drives: DriveSet = PAPER_DRIVES) -> Record:
    """Return the training record; if noisy, `x_ref` is the measurement, NaN at dropouts."""
    record = _read_truth(folder, NOMINAL)
    record = replace(record.rows(slice(0, _cut(len(record)))), name=Path(drives.training).name)
    return record if variant == CLEAN else noisy(record, 0, drives, training=True)


def noisy(
    record: Record, seed: int, drives: DriveSet = PAPER_DRIVES, training: bool = False
) -> Record:
    """
    Add white noise to x and a, and dropouts that repeat the tick before.

    Dropouts are flagged as stale, so they are not learned from. `training`: `x_ref` becomes the
    measurement as well.
    """
    random = np.random.default_rng((drives.noise_seed, seed))
    scale = drives.noise_scale
    x = record.x + scale * NOISE * random.standard_normal(record.x.shape)
    a = record.a + scale * FORCE_NOISE * random.standard_normal(record.a.shape)
    lost = random.random(len(record)) < DROPPED
    # The first samples have no earlier one to repeat.
    lost[: HISTORY + 1] = False
    last = np.maximum.accumulate(np.where(lost, 0, np.arange(len(record))))
    flags = np.where(lost, record.flags | int(Flag.ODOMETRY_STALE), record.flags)
    x_ref = record.x_ref
    if training:
        x_ref = np.where(lost[:, None], np.nan, x)
    return replace(record, x=x[last], a=a[last], flags=flags, x_ref=x_ref)


def measured(record: Record) -> FloatArray:
    """Return the measurement at each tick (n, 3), NaN at dropouts."""
    return np.where(record.learnable[:, None], record.x, np.nan)


def rows_of(record: Record, stride: int) -> tuple[IntArray, IntArray]:
    """
    Return the rows of one-step predictions, and every `stride`-th of them for rollouts of 2 s.

    History and future of a row must be free of gaps in the grid. Dropouts are not excluded.
    :raises DataError: the record is too short.
    """
    n, episode = len(record), record.episode
    rows = np.arange(HISTORY, n - 1)
    rows = rows[episode[rows - HISTORY] == episode[rows + 1]]
    starts = rows[rows < n - AHEAD]
    starts = starts[episode[starts] == episode[starts + AHEAD]][::stride]
    if not starts.size:
        raise DataError(f"{record.name}: {record.duration_s:.1f} s are too short to be a test")
    return rows, starts


def pieces(record: Record) -> list[Record]:
    """
    Cut a training record for `run_training(..., "bags")`.

    The last tenth of each piece of about 100 s is for validation. The last piece, 10 s, is the
    test data of the training report, which is not used here.
    """
    n = len(record)
    last = min(round(_TEST_PIECE_S * 40.0), n // 10)
    count = max(1, round((n - last) / (PIECES_S * 40.0)))
    parts = [*np.array_split(np.arange(n - last), count), np.arange(n - last, n)]
    return [replace(record.rows(part), name=f"{record.name}.{i}") for i, part in enumerate(parts)]
