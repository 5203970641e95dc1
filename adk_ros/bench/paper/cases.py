# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The drives of the tables: one to train on, ten to test on, each as it was and as sensors tell it.

Training and the nominal test are the first 70 % and the rest of one drive, as in the paper; the
other tests are drives of their own, under seeds of their own. In the noisy variant x carries white
noise and drops out. Predictions start from that and are scored against the truth; training has
nothing but the measurement, as nobody who records a drive has more.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from adk_ros.errors import DataError
from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.plant.scenario.scenario_file import load_scenario
from adk_ros.plant.scenario.sensor_simulation import SimulatedDrive
from adk_ros.plant.scenario.simulate import Progress, simulate
from adk_ros.signals.channels import Flag, Record

TRAINING = "xyz_edges"
NOMINAL = "nominal"
PAPER_TESTS = (
    NOMINAL, "mass_plus_160", "mass_minus_170", "inertia_plus_142", "inertia_minus_158",
    "mountain", "slalom",
)  # fmt: skip
"""Of sections 4.2 to 4.4."""
OWN_TESTS = ("winter", "gusts", "worn_tyres")
TESTS = PAPER_TESTS + OWN_TESTS
CLEAN, NOISY = "clean", "noisy"
VARIANTS = (CLEAN, NOISY)

TRAINING_SHARE = 0.7
NOISE = np.array([0.02, 0.02, 0.002])
"""Deviation of v_x, v_y, yaw rate: m/s, m/s, rad/s."""
FORCE_NOISE = 0.05
"""Of a_x and a_y, m/s^2."""
DROPPED = 0.01
"""Share of the ticks whose x and a are those of the tick before."""

HISTORY = 8
"""Samples that lie before any row that is predicted from: as many as the neediest needs."""
AHEAD = 80
PIECES_S = 100.0
_TEST_PIECE_S = 10.0
_NOISE_SEED = 2026


@dataclass(frozen=True)
class Durations:
    """Seconds to drive, None for the scenarios' own: `train` for both parts of it."""

    train: float | None = None
    test: float | None = None


def simulate_test(
    test: str, durations: Durations, progress: Progress | None = None
) -> tuple[SimulatedDrive, int]:
    """
    Simulate a test's drive, without its readings; and the row at which the test begins.

    :raises UsageError: no scenario has that name.
    """
    nominal = test == NOMINAL
    scenario = load_scenario(TRAINING if nominal else test)
    seconds = durations.train if nominal else durations.test
    driven = simulate(scenario, duration_s=seconds, progress=progress)
    # Half a million readings that nobody here listens to.
    driven = replace(driven, readings=[], streams={}, log_ns=driven.log_ns[:0])
    return driven, _cut(len(driven.x)) if nominal else 0


def _cut(n: int) -> int:
    return int(TRAINING_SHARE * n)


def write_truth(folder: Path, test: str, driven: SimulatedDrive) -> None:
    """Keep what the other processes need of a drive."""
    np.savez(folder / f"{test}.npz", stamp_ns=driven.stamp_ns, x=driven.x, u=driven.u, a=driven.a)


def _read_truth(folder: Path, test: str) -> Record:
    with np.load(folder / f"{test}.npz") as stored:
        stamp_ns, x, u, a = (stored[name] for name in ("stamp_ns", "x", "u", "a"))
    zeros = np.zeros(len(x), dtype=np.int64)
    return Record(stamp_ns, x, u, a, zeros, x.copy(), zeros.copy(), test)


def test_record(folder: Path, test: str, variant: str) -> Record:
    """Return what a test's predictions start from, `x`, and the truth they miss, `x_ref`."""
    record = _read_truth(folder, test)
    if test == NOMINAL:
        record = record.rows(slice(_cut(len(record)), None))
    return record if variant == CLEAN else noisy(record, 1 + TESTS.index(test))


test_record.__test__ = False  # type: ignore[attr-defined]


def training_record(folder: Path, variant: str) -> Record:
    """Return what all are trained on; noisy, `x_ref` is the measurement, NaN where it dropped."""
    record = _read_truth(folder, NOMINAL)
    record = replace(record.rows(slice(0, _cut(len(record)))), name=TRAINING)
    return record if variant == CLEAN else noisy(record, 0, training=True)


def noisy(record: Record, seed: int, training: bool = False) -> Record:
    """
    Return `record` as sensors tell it: white noise on x and a, and ticks that repeat the last.

    Those are flagged as stale, so that nothing is learned from them. `training`: `x_ref` becomes
    the measurement as well.
    """
    random = np.random.default_rng((_NOISE_SEED, seed))
    x = record.x + NOISE * random.standard_normal(record.x.shape)
    a = record.a + FORCE_NOISE * random.standard_normal(record.a.shape)
    lost = random.random(len(record)) < DROPPED
    # Somewhere it has to begin.
    lost[: HISTORY + 1] = False
    last = np.maximum.accumulate(np.where(lost, 0, np.arange(len(record))))
    flags = np.where(lost, record.flags | int(Flag.ODOMETRY_STALE), record.flags)
    x_ref = record.x_ref
    if training:
        x_ref = np.where(lost[:, None], np.nan, x)
    return replace(record, x=x[last], a=a[last], flags=flags, x_ref=x_ref)


def measured(record: Record) -> FloatArray:
    """What was measured at each tick (n, 3), NaN where nothing was."""
    return np.where(record.learnable[:, None], record.x, np.nan)


def rows_of(record: Record, stride: int) -> tuple[IntArray, IntArray]:
    """
    Rows whose next tick is predicted: every one; and every `stride`-th, from which 2 s are.

    All that is asked of a row is a past and a future without a break in the grid: a measurement
    that dropped out is no excuse, the car drives on.
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
    Cut a training record for `run_training(..., "bags")`: a tenth to validate on, spread over it.

    Of each piece of some 100 s the last tenth validates. The last piece, 10 s, is what the
    training reports on by itself, and nothing here uses.
    """
    n = len(record)
    last = min(round(_TEST_PIECE_S * 40.0), n // 10)
    count = max(1, round((n - last) / (PIECES_S * 40.0)))
    parts = [*np.array_split(np.arange(n - last), count), np.arange(n - last, n)]
    return [replace(record.rows(part), name=f"{record.name}.{i}") for i, part in enumerate(parts)]
