# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk bench learned with synthetic code in the layout of the authors' repositories."""

from __future__ import annotations

import json
import re
import runpy
import textwrap
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.calibration import driven, write_streams
from helpers.model import make_model

from adk_ros.bench.learned import learned_bench, scores
from adk_ros.bench.learned.learned_bench import HORIZONS_S, RecordingResult, at_horizons
from adk_ros.bench.learned.learned_models import (
    DEEP_DYNAMICS,
    DEEP_PACEJKA,
    DEEP_PACEJKA_GIVEN,
    FTHD,
    PACKAGES,
    WORKER,
    LearnedModels,
    chosen,
    find_code,
)
from adk_ros.bench.learned.sampled_drive import (
    SAMPLE_NS,
    SampledDrive,
    read_sampled,
    starts,
    write_csv,
)
from adk_ros.bench.paper.predictors import ADK_ROS, KoopmanPredictor
from adk_ros.calibration.streams import Stream, Streams
from adk_ros.cli.main import main
from adk_ros.errors import DataError, UsageError

# A network of one layer whose "coefficients" are accelerations; the rest has the interfaces that
# the worker uses. `%s` is the package.
MODELS = """
import torch
import wandb
from ray import train as raytrain


class Scaler:
    def transform(self, rows):
        return rows / 10.0


class Data(torch.utils.data.Dataset):
    def __init__(self, features, labels, times_features=None, times=None):
        if features.shape[2] == 8:
            kept = [0, 1, 2, 4, 6, 7] if PACEJKA else list(range(7))
            features = features[:, :, kept]
        self.X_data = torch.from_numpy(features).float()
        self.y_data = torch.from_numpy(labels).float()
        self.scaler = Scaler()

    def __len__(self):
        return len(self.X_data)

    def __getitem__(self, at):
        return self.X_data[at], self.y_data[at]

    def split(self, share):
        torch.manual_seed(0)
        first = int(len(self) * share)
        return torch.utils.data.random_split(self, [first, len(self) - first])


class Model(torch.nn.Module):
    def __init__(self, settings):
        super().__init__()
        self.settings = settings["MODEL"]
        self.batch_size = self.settings["OPTIMIZATION"]["BATCH_SIZE"]
        self.epochs = self.settings["OPTIMIZATION"]["NUM_EPOCHS"]
        self.is_rnn = True
        self.sys_params = ["a_x", "a_y", "a_r"]
        self.layer = torch.nn.Linear(self.settings["COLUMNS"], 3)

    def init_hidden(self, count):
        return torch.zeros(1, count, 1)

    def forward(self, x, scaled, hidden, *times):
        assert len(hidden[0]) == len(x)
        found = self.layer(scaled[:, -1])
        self.trained_coeff_ls = {name: found[:, i] for i, name in enumerate(self.sys_params)}
        return self.differential_equation(x, found, *(times or (0.04,))), hidden, found

    def differential_equation(self, x, found, *times):
        if len(times) == 1:
            return x[:, -1, :3] + times[0] * found
        return x[:, -1, :3] + (times[1] - times[0]) * found, found


def train(model, training, validation, name, log, folder, project_name=None):
    model.cuda()
    optimiser = torch.optim.Adam(model.parameters(), 0.1)
    for epoch in range(model.epochs):
        for x, y in training:
            optimiser.zero_grad()
            times = () if "%s" == "deep_dynamics" else (torch.zeros(1), torch.full((1,), 0.04))
            out = model(x, x / 10.0, model.init_hidden(len(x)), *times)[0]
            loss = ((out if not times else out[0]) - y).square().mean()
            loss.backward()
            optimiser.step()
        torch.save(model.state_dict(), f"{folder}/epoch_{epoch}.pth")
        print(f"Epoch: {epoch + 1}/{model.epochs}... Loss: 1.0... Val Loss: {loss.item():.6f}")
    wandb.finish()
"""
PARSER = """
import numpy as np

MOVING = 5.0


def read(path):
    rows = [line.split(",") for line in open(path).read().split()]
    at = {name.split("(")[0]: i for i, name in enumerate(rows[0])}
    table = np.array(rows[1:], dtype=float)
    x = table[:, [at["vx"], at["vy"], at["omega"]]]
    pedal = table[:, at["throttle_ped_cmd"]] / 100.0
    pedal -= table[:, at["brake_ped_cmd"]] / 2757.89990234
    u = np.column_stack([pedal, table[:, at["delta"]]])
    fast = np.abs(x[:, 0]) >= MOVING
    first = int(np.argmax(fast))
    return x[first:], u[first:]
"""
DEEP_PARSER = (
    PARSER
    + """

def write_dataset(path, horizon, save=True):
    x, u = read(path)
    n = len(x) - 1 - horizon - 1
    rows = np.column_stack([x[:-1], u[:-1], np.diff(u, axis=0), np.r_[x[5:, 0], np.zeros(4)]])
    features = np.zeros((n, horizon, 8))
    labels = np.zeros((n, 3))
    for i in range(n - 5):
        features[i], labels[i] = rows[i : i + horizon], x[i + horizon]
    return features, labels, None
"""
)
FTHD_PARSER = (
    PARSER
    + """

def write_dataset(path, horizon, save=True):
    global TOTAL_TIME
    x, u = read(path)
    rows = np.column_stack([x, u, np.diff(u, axis=0, prepend=u[:1])])
    n = len(x) - horizon
    features = np.array([rows[i : i + horizon] for i in range(n)])
    times = TOTAL_TIME + SAMPLING_TIME * np.arange(len(x))[:, None]
    np.savez(path[: path.find(".csv")] + f"_{horizon}RNN_Val.npz", features=features,
             labels=x[horizon:], times_features=times[horizon - 1 : -1], times=times[horizon:])
"""
)


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(textwrap.dedent(text))


def _settings(name: str, columns: int) -> str:
    return (
        f"MODEL: {{NAME: {name}, HORIZON: 3, COLUMNS: {columns},"
        " OPTIMIZATION: {BATCH_SIZE: 64, NUM_EPOCHS: 9, LR: 0.1}}"
    )


@pytest.fixture(scope="module")
def code(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with both repositories."""
    folder = tmp_path_factory.mktemp("code")
    deep = folder / "one" / "deep_dynamics"
    both = "\nclass PacejkaData(Data):\n    pass\n"
    models = MODELS % "deep_dynamics" + both
    models = models.replace("if PACEJKA", 'if type(self).__name__ == "PacejkaData"')
    models += 'string_to_model = {"D": Model, "P": Model}\n'
    models += 'string_to_dataset = {"D": Data, "P": PacejkaData}\n'
    _write(deep / "model" / "models.py", models)
    _write(deep / "model" / "train.py", "from deep_dynamics.model.models import train\n")
    _write(deep / "tools" / "csv_parser.py", DEEP_PARSER)
    _write(deep / "cfgs" / "model" / "deep_dynamics_iac.yaml", _settings("D", 7))
    _write(deep / "cfgs" / "model" / "deep_pacejka_iac.yaml", _settings("P", 6))
    fthd = folder / "two" / "fthd"
    models = (MODELS % "fthd").replace("if PACEJKA", "if False")
    models += 'string_to_model = {"F": Model}\nstring_to_dataset = {"F": Data}\n'
    _write(fthd / "model" / "models_supervised.py", models)
    _write(fthd / "train" / "fthd_train.py", "from fthd.model.models_supervised import train\n")
    _write(fthd / "tools" / "csv_fthd_timeverify.py", FTHD_PARSER)
    _write(fthd / "cfgs" / "fthd_iac.yaml", _settings("F", 7))
    return folder


@pytest.fixture(scope="module")
def worker(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LearnedModels]:
    """Return the process that trains; it takes seconds to start."""
    with LearnedModels(tmp_path_factory.mktemp("worker")) as process:
        yield process


def drive(n: int = 600) -> SampledDrive:
    """Return a drive whose accelerations are linear in the commands."""
    random = np.random.default_rng(0)
    u = np.column_stack([
        np.sin(np.arange(n) / 30.0) * 0.4 + 0.02 * random.normal(size=n),
        np.sin(np.arange(n) / 17.0) * 0.1,
    ])  # fmt: skip
    x = np.full((n, 3), [20.0, 0.0, 0.0])
    rate = np.column_stack([2.0 * u[:, 0], 3.0 * u[:, 1], -u[:, 1]])
    x[1:] += 0.04 * np.cumsum(rate, axis=0)[:-1]
    x[:7, 0] = 1.0
    return SampledDrive("drive", np.arange(n) * SAMPLE_NS, x, u)


def _streams() -> Streams:
    """Return a simulated drive with a pedal, sampled every 40 ms 22 ms after a tick."""
    made = driven("handling", 1, 120.0)
    assert made.odometry is not None
    assert made.command is not None
    at_s = np.asarray(np.arange(25, 2950) * 0.04 + 0.022, dtype=np.float64)

    def sampled(stream: Stream) -> Stream:
        columns = {
            name: np.interp(at_s, stream.at_s, values) for name, values in stream.columns.items()
        }
        return replace(stream, at_s=at_s, columns=columns)

    command = sampled(made.command)
    pedal = command["torque"] / np.abs(command["torque"]).max()
    command = command.having(torque=pedal)
    return replace(made, imu=None, odometry=sampled(made.odometry), command=command)


@pytest.mark.parametrize("model", [DEEP_DYNAMICS, DEEP_PACEJKA, DEEP_PACEJKA_GIVEN, FTHD])
def test_a_model_is_trained_and_rolled_out(worker: LearnedModels, code: Path, model: str) -> None:
    whole, folder = drive(), find_code(code)[model]
    rows = np.array([200, 201, 300])
    training = worker.train(model, folder, whole, 30, 0)
    held, refreshed = (worker.predict(model, whole, rows, 10, on) for on in (False, True))
    assert len(training.losses) == 30
    assert training.losses[-1] < training.losses[0]
    assert "3 past samples, batch 64" in training.settings
    np.testing.assert_allclose(held.predicted[:, 0], refreshed.predicted[:, 0], atol=1e-5)
    truth = whole.x[rows[:, None] + np.arange(1, 11)]
    # Deep Pacejka is not given the pedal.
    assert np.abs(refreshed.predicted - truth).max() < 0.4
    # What stays the same is the change of each step.
    change = np.diff(held.predicted, axis=1)
    np.testing.assert_allclose(change, change[:, :1].repeat(9, axis=1), atol=1e-4)
    assert held.rollout_s > 0.0


def test_deep_pacejka_is_not_given_future_speeds(worker: LearnedModels, code: Path) -> None:
    whole, rows = drive(), np.array([300])
    later = whole.x.copy()
    later[301:] += 5.0
    changed = replace(whole, x=later)
    for model, is_given in ((DEEP_PACEJKA, False), (DEEP_PACEJKA_GIVEN, True)):
        worker.train(model, find_code(code)[model], whole, 5, 0)
        first, second = (
            worker.predict(model, x, rows, 5, not is_given).predicted for x in (whole, changed)
        )
        assert np.array_equal(first, second) is not is_given


def test_times_are_those_of_the_samples_that_a_prediction_uses() -> None:
    """Also of a longer recording, from which one prediction uses as much."""
    code = runpy.run_path(str(WORKER), run_name="worker")
    lengths: list[int] = []

    class Given:
        horizon = 3

        def predict(self, x: Any, u: Any, rows: Any, ahead: int, refreshed: bool) -> Any:
            lengths.append(len(x))
            return x[rows[:, None] + np.arange(1, ahead + 1)]

    whole = drive()
    job = {"predict": "given", "x": whole.x, "u": whole.u, "rows": np.array([200, 300])}
    answer = code["predict"](job | {"ahead": 10, "refreshed": True}, {"given": Given()})
    assert answer["predicted"].shape == (2, 10, 3)
    assert lengths[0] == 600
    assert max(lengths[1:]) < 20


@pytest.mark.parametrize("name", PACKAGES)
@pytest.mark.parametrize("ahead", [1, 10])
def test_these_samples_give_the_same_features(name: str, ahead: int) -> None:
    code = runpy.run_path(str(WORKER), run_name="worker")
    # Without its network.
    model = object.__new__(code["MODELS"][name])
    model.horizon = 3
    whole = drive()
    x, u, (row,) = code["samples_of"](model, whole.x, whole.u, 200, ahead)
    few, every = model._table(x, u), model._table(whole.x, whole.u)
    used = np.arange(-2, ahead)
    np.testing.assert_array_equal(few[row + used], every[200 + used])


def test_features_unlike_those_of_the_parser_are_refused(tmp_path: Path, code: Path) -> None:
    folder = tmp_path / "code"
    text = (code / "one" / "deep_dynamics" / "tools" / "csv_parser.py").read_text()
    for source in (code / "one").rglob("*.*"):
        if source.suffix in (".py", ".yaml"):
            _write(folder / "x" / source.relative_to(code / "one"), source.read_text())
    parser = folder / "x" / "deep_dynamics" / "tools" / "csv_parser.py"
    parser.write_text(text.replace("np.diff(u, axis=0),", "np.diff(u, axis=0)[::-1],"))
    # In another process: this one has imported the other code.
    with LearnedModels(tmp_path) as fresh, pytest.raises(DataError, match="features differ"):
        fresh.train(DEEP_DYNAMICS, find_code(folder)[DEEP_DYNAMICS], drive(), 1, 0)


def test_starts_follow_the_sample_at_once_and_stay_fast() -> None:
    whole = drive()
    shifted = replace(whole, stamp_ns=whole.stamp_ns + 22_000_000)
    rows, tick_ns = starts(shifted, 0, 20, 50)
    age = tick_ns - shifted.stamp_ns[rows]
    assert set(age.tolist()) == {3_000_000}
    assert set(np.diff(rows).tolist()) == {5}
    assert rows[0] - 20 >= 7
    assert rows[-1] + 50 < len(whole)
    slow = shifted.x.copy()
    slow[300, 0] = 4.0
    rows = starts(replace(shifted, x=slow), 100, 20, 50)[0]
    assert rows[0] >= 120
    assert not ((rows - 20 <= 300) & (rows + 50 >= 300)).any()


def test_the_table_has_the_columns_of_the_parsers(tmp_path: Path) -> None:
    write_csv(drive(), tmp_path / "drive.csv")
    lines = (tmp_path / "drive.csv").read_text().split("\n")
    at = {name.split("(")[0]: i for i, name in enumerate(lines[0].split(","))}
    table = np.array([line.split(",") for line in lines[1:-1]], dtype=float)
    pedal = table[:, at["throttle_ped_cmd"]] / 100.0
    pedal -= table[:, at["brake_ped_cmd"]] / 2757.89990234
    np.testing.assert_allclose(pedal, drive().u[:, 0], atol=1e-12)
    assert {"vx", "vy", "omega", "delta", "x", "y", "phi"} <= at.keys()


def test_predictions_are_interpolated_at_the_horizons() -> None:
    path = np.arange(51.0)[None, :, None] * 0.04 * np.ones(3)
    np.testing.assert_allclose(at_horizons(path)[0, :, 0], HORIZONS_S, atol=1e-12)
    offset = np.array([-3_000_000])
    ticks = np.arange(81.0)[None, :, None] * 0.025 * np.ones(3)
    found = learned_bench._interpolated(ticks, offset, 25_000_000)
    np.testing.assert_allclose(found[0, :, 0], np.array(HORIZONS_S) - 0.003, atol=1e-12)


@pytest.mark.slow(seconds=10)
def test_the_command_trains_and_compares_all(
    tmp_path: Path, code: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # Its own training takes a minute.
    untrained = KoopmanPredictor(ADK_ROS, make_model())
    monkeypatch.setattr(learned_bench, "train_default", lambda *_: untrained)
    write_streams(_streams(), tmp_path / "recordings" / "drive")
    arguments = ["--recordings", str(tmp_path / "recordings"), "--code", str(code), "--seeds", "1"]
    arguments += ["--epochs", "2", "--epochs", "FTHD=1", "--steps", "20"]
    out = tmp_path / "results.json"
    assert main(["bench", "learned", *arguments, "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert re.search(r"drive, \d+ starts", printed)
    assert "ahead of the best of them" in printed
    assert "2 epochs" in printed
    (found,) = json.loads(out.read_text())["recordings"]
    with_both = {DEEP_DYNAMICS, DEEP_PACEJKA, FTHD}
    names = {"persistence", "straight line", ADK_ROS, *with_both}
    names |= {name + learned_bench.REFRESHED for name in with_both}
    assert set(found["rmse_si"]) == names
    assert np.shape(found["rmse_si"][ADK_ROS]) == (1, 5, 3)
    assert all(item["train_s"] > 0.0 for items in found["effort"].values() for item in items)


def test_the_better_rollout_of_a_model_counts() -> None:
    result = RecordingResult("drive", 3)
    zero = np.zeros((3, 5, 3))
    for name, error in (
        ("persistence", 2.0), (ADK_ROS, 0.5), (DEEP_DYNAMICS, 0.4), (DEEP_PACEJKA_GIVEN, 0.1),
        (DEEP_DYNAMICS + learned_bench.REFRESHED, np.nan), (FTHD, 1.0),
    ):  # fmt: skip
        result.add(name, zero, zero + error)
    found = {item.name: item for item in scores.criteria([result])}
    assert not found[f"ahead of {DEEP_DYNAMICS}"].is_met
    assert found[f"ahead of {FTHD}"].figure == 1.0
    assert not found[f"ahead of {DEEP_PACEJKA_GIVEN}"].is_met
    assert found["ahead of the best of them"].figure == 0.0
    rows = dict(scores.ratio_rows(result, 0))
    assert rows[ADK_ROS] == [0.25] * 5
    assert "persistence" not in rows


def test_unusable_options_and_recordings_are_refused(tmp_path: Path, code: Path) -> None:
    with pytest.raises(UsageError, match="no checkout"):
        find_code(tmp_path)
    found = find_code(code)
    assert chosen((), found) == [DEEP_DYNAMICS, DEEP_PACEJKA, FTHD]
    assert chosen((DEEP_PACEJKA_GIVEN,), found) == [DEEP_PACEJKA_GIVEN]
    with pytest.raises(UsageError, match="unknown"):
        chosen(("Deep Thought",), found)
    with pytest.raises(UsageError, match="no checkout has the folder"):
        chosen((FTHD,), {DEEP_DYNAMICS: found[DEEP_DYNAMICS]})
    with pytest.raises(UsageError, match="not a Python"):
        LearnedModels(tmp_path, tmp_path / "none")
    write_streams(replace(driven("handling", 1, 80.0), imu=None), tmp_path / "torque")
    with pytest.raises(DataError, match="the learned models need"):
        read_sampled(tmp_path / "torque")
    arguments = ["bench", "learned", "--recordings", str(tmp_path), "--code", str(code)]
    assert main([*arguments, "--epochs", "Deep=3"]) == 2
    assert main([*arguments, "--steps", "0"]) == 2
    assert main([*arguments, "--seeds", "0"]) == 2
    assert main(["bench", "learned", "--recordings", str(tmp_path), "--code", "none"]) == 2
