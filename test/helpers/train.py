# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the tests of everything offline share: drives, bags and one small model, each made once."""

import pickle
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
import pytest

from adk_ros.cli.main import main
from adk_ros.model import artefact
from adk_ros.model.lifting.encoder import Lifting
from adk_ros.numerics.arrays import FloatArray
from adk_ros.offline.export import write_bag
from adk_ros.plant.scenario.scenario_file import load_scenario
from adk_ros.plant.scenario.sensor_simulation import SimulatedDrive
from adk_ros.plant.scenario.sensors import Stream
from adk_ros.plant.scenario.simulate import simulate
from adk_ros.signals.channels import TICK_NS, Record, Source
from adk_ros.signals.record import build_record
from adk_ros.train import hyperparameters
from adk_ros.train.train_settings import TrainSettings
from adk_ros.train.training_report import write_report
from adk_ros.train.training_run import TrainingResult, run_training
from helpers.shared import made_once

SMALL = TrainSettings(
    steps=300, batch=128, hidden=16, features=8, history=3, learning_rate=8e-3, short_steps=10,
    long_steps=20, validate_every=50, device="cpu",
)  # fmt: skip
START_NS = 1_760_000_000_000_000_000


def drive(
    name: str = "handling", seconds: float = 120.0, imu: bool = True, clean: bool = False
) -> SimulatedDrive:
    """A drive of the package's own car; `clean`: sensors without noise, and mu 1."""
    return _drive(name, float(seconds), imu, clean)


@lru_cache
def _drive(name: str, seconds: float, imu: bool, clean: bool) -> SimulatedDrive:
    scenario = load_scenario(name)
    if clean:
        scenario = scenario.model_copy(update={"sensors": scenario.sensors.clean(), "mu": 1.0})
    if not imu:
        without = scenario.sensors.model_copy(update={"imu": None})
        scenario = scenario.model_copy(update={"sensors": without})
    return simulate(scenario, duration_s=seconds)


def record(name: str = "handling", seconds: float = 120.0, imu: bool = True) -> Record:
    """What the aligner makes of a drive's readings."""
    return _record(name, float(seconds), imu)


@lru_cache
def _record(name: str, seconds: float, imu: bool) -> Record:
    return build_record(drive(name, seconds, imu).readings, name)


def bag(name: str = "town", seconds: float = 30.0, imu: bool = True, clean: bool = False) -> Path:
    """A drive as a bag."""
    key = f"{name}_{seconds:g}_{imu}_{clean}"
    made = made_once(
        f"bag_{key}", lambda at: write_bag(drive(name, seconds, imu, clean), at / key)
    )
    return made / key


class Small(NamedTuple):
    """A small training with report, and where it lies."""

    run: TrainingResult
    path: Path


class _Pickler(pickle.Pickler):
    """Leaves out the encoder: a TorchScript program, which the model folder contains."""

    def persistent_id(self, obj: object) -> str | None:
        return "encoder" if isinstance(obj, Lifting) else None


class _Unpickler(pickle.Unpickler):
    """Restores the result of a training with the encoder of its model folder."""

    def __init__(self, file: BinaryIO, encoder: Lifting) -> None:
        super().__init__(file)
        self._encoder = encoder

    def persistent_load(self, pid: str) -> Lifting:
        assert pid == "encoder"
        return self._encoder


_CANDIDATES = {
    table: getattr(hyperparameters, table) for table in ("_RIDGES", "_SLOW", "_OBSERVERS", "_FAST")
}
"""All candidates for each hyperparameter, whatever a test has left of them."""


def leave_one_candidate(patch: pytest.MonkeyPatch) -> None:
    """Leave one candidate for each hyperparameter: 34 take most of the time of a training."""
    for table, candidates in _CANDIDATES.items():
        patch.setattr(hyperparameters, table, candidates[-1:])


@lru_cache
def small() -> Small:
    """The model that most tests use; trained from `record()`."""

    def train(folder: Path) -> None:
        with pytest.MonkeyPatch.context() as patch:
            for table, candidates in _CANDIDATES.items():
                patch.setattr(hyperparameters, table, candidates)
            run = run_training([record()], folder / "small_model", SMALL)
        write_report(run, folder / "small_model")
        with (folder / "run.pickle").open("wb") as file:
            _Pickler(file).dump(run)

    folder = made_once("small", train)
    model = folder / "small_model"
    with (folder / "run.pickle").open("rb") as file:
        run: TrainingResult = _Unpickler(file, artefact.load(model).model.lifting).load()
    return Small(run, model)


@lru_cache
def small_without_imu() -> Path:
    """A model trained on a drive that had no IMU, with one candidate for each hyperparameter."""
    settings = replace(SMALL, steps=60, validate_every=20)
    name = "small_model_without_imu"

    def train(folder: Path) -> None:
        with pytest.MonkeyPatch.context() as patch:
            leave_one_candidate(patch)
            run_training([record("handling", 90.0, imu=False)], folder / name, settings)

    return made_once(name, train) / name


def changed_streams(
    of: SimulatedDrive, path: Path, change: Callable[[Source, Stream], Stream]
) -> Path:
    """Write `of` as a bag with each of its streams passed through `change`."""
    streams = {source: change(source, stream) for source, stream in of.streams.items()}
    write_bag(replace(of, streams=streams), path)
    return path


def kept(stream: Stream, rows: np.ndarray) -> Stream:
    """The chosen messages of a stream."""
    return Stream(stream.stamp_ns[rows], stream.log_ns[rows], stream.values[rows])


def made_record(x: FloatArray, u: FloatArray | None = None, name: str = "made") -> Record:
    """A flawless record of states `x` (n, 3), without accelerations."""
    n = len(x)
    x = np.asarray(x, dtype=np.float64)
    return Record(
        stamp_ns=START_NS + TICK_NS * np.arange(n),
        x=x,
        u=np.zeros((n, 2)) if u is None else u,
        a=np.full((n, 2), np.nan),
        flags=np.zeros(n, dtype=np.int64),
        x_ref=x.copy(),
        episode=np.zeros(n, dtype=np.int64),
        name=name,
    )


def lines(text: str) -> list[str]:
    """The lines of what was printed, without the empty ones."""
    return [line for line in text.splitlines() if line.strip()]


def refused(capsys: pytest.CaptureFixture[str], arguments: Sequence[object], code: int) -> str:
    """Run `adk`, which must end with `code` and one line of its own on stderr; return it."""
    assert main([str(item) for item in arguments]) == code
    said = capsys.readouterr()
    assert said.out == ""
    own = [line for line in lines(said.err) if line.startswith("adk: ")]
    assert len(own) == 1, said.err
    assert lines(said.err)[-1] == own[0], said.err
    assert "Traceback" not in said.err
    return own[0]
