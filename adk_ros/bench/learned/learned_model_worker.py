# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Worker that trains learned vehicle models with their authors' code, and rolls them out.

Runs under the Python given to `adk bench learned` and imports nothing of adk_ros, only the
checked-out code of the authors: their parser of the recording, dataset, network, loss and training
loop, with their published settings. Of their main functions it leaves out the command line and the
search for hyperparameters (ray), and of their training loops the logging (wandb).

A training job has `train` (name of a model), `code` (its folder), `csv`, `epochs`, `seed`; its
answer `losses` (epochs,) on their validation data, `settings`, `seconds`. A prediction job has
`predict` (a trained model), `x` (n, 3), `u` (n, 2) at their sampling, `rows` (m,), `ahead`,
`refreshed`; its answer `predicted` (m, ahead, 3), and the times of one start, `step_s` and
`rollout_s`. Times are processor time.

Coefficients of tyres and drive come from the network at the start of a rollout and stay, as in the
authors' rollouts; with `refreshed` the network is evaluated at each step, on predicted states.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import re
import runpy
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

SAMPLE_S = 0.04
"""Sampling of the authors' recordings, in their equations of motion."""
MIN_SPEED = 5.0
"""m/s; their parsers drop slower samples."""
FUTURE_SAMPLES = 5
"""Samples ahead of which the speed is the published `VREF` of Deep Pacejka: 0.2 s."""
TRUSTED = 1e-6
"""Largest difference of our features from those of the authors' parsers: rounding of the CSV."""
_TIMED_CALLS = 11
_LOGGING = ("wandb", "ray")
_BASELINES = Path(__file__).parents[1] / "paper" / "baseline_library_worker.py"


class LearnedModel:
    """
    A learned model; subclasses name what differs between the authors' repositories.

    `columns`: of (v_x, v_y, yaw rate, throttle, steering, its change by throttle, by steering,
    v_x), those that the network is given.
    """

    package = "deep_dynamics"
    config = ""
    columns: Any = slice(0, 7)
    trained_share = 0.8

    def __init__(self, code: Path, epochs: int) -> None:
        import torch
        import yaml

        self._torch = torch
        torch.set_num_threads(1)
        sys.path.insert(0, str(code))
        text = (code / self.package / "cfgs" / self.config).read_text(encoding="utf-8")
        self.settings = yaml.safe_load(text)
        self.horizon = int(self.settings["MODEL"]["HORIZON"])
        self.settings["MODEL"]["OPTIMIZATION"]["NUM_EPOCHS"] = epochs

    def data(self, csv: Path) -> tuple[Any, ...]:
        """Return what their parser makes of the recording: features, labels, further columns."""
        module = importlib.import_module("deep_dynamics.tools.csv_parser")
        features, labels, _ = module.write_dataset(str(csv), self.horizon, save=False)
        # Their loop stops early by the samples of `VREF` and leaves these rows zero.
        return features[:-FUTURE_SAMPLES], labels[:-FUTURE_SAMPLES]

    def parts(self) -> tuple[Any, Any, Any]:
        """Return their classes of model and dataset, and their training function."""
        models = importlib.import_module("deep_dynamics.model.models")
        name = self.settings["MODEL"]["NAME"]
        train = importlib.import_module("deep_dynamics.model.train").train
        return models.string_to_model[name], models.string_to_dataset[name], train

    def validation(self, whole: Any, rest: Any) -> tuple[Any, int, bool]:
        """Return the validation data of their main function, batch size, whether to drop more."""
        return rest, len(rest), False

    def train(self, csv: Path, seed: int) -> list[float]:
        """Train as their main function does; return the validation loss of each epoch."""
        torch = self._torch
        data = self.data(csv)
        model_of, dataset_of, train = self.parts()
        torch.manual_seed(seed)
        self._model = model_of(self.settings)
        if not torch.cuda.is_available():
            # Their loop moves the network to a GPU without asking for one.
            self._model.cuda = lambda: self._model
        dataset = dataset_of(*data)
        self._scaler = dataset.scaler
        self._check(dataset, csv)
        chosen, rest = dataset.split(self.trained_share)
        # Their split fixes the seed.
        torch.manual_seed(seed)
        batch = self._model.batch_size
        validation, size, drop = self.validation(dataset, rest)
        said = io.StringIO()
        with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(said):
            loaders = _loader(chosen, batch, True, True), _loader(validation, size, False, drop)
            train(self._model, *loaders, "adk_ros", False, folder)
            self._load_best(Path(folder))
        self._model.eval()
        return [float(text) for text in re.findall(r"Epoch: .*Val Loss: (\S+)", said.getvalue())]

    def _load_best(self, folder: Path) -> None:
        """Load the weights of the smallest validation loss, the last that they wrote."""
        best = max(folder.glob("*.pth"), key=lambda path: path.stat().st_mtime_ns)
        self._model.load_state_dict(self._torch.load(best, weights_only=True))

    def _check(self, dataset: Any, csv: Path) -> None:
        """Compare the features of a prediction with theirs, so that both mean the same."""
        table = np.loadtxt(csv, delimiter=",", skiprows=1)
        x, u = table[:, :3], table[:, 3:5]
        fast = int(np.argmax(np.abs(x[:, 0]) >= MIN_SPEED))
        count = min(len(dataset), 100)
        # The first sample has no change before it.
        rows = fast + self.horizon + np.arange(1, count)
        ours = self._windows(self._table(x, u), rows)
        theirs = dataset.X_data[2 : count + 1].cpu().numpy()
        if not np.abs(ours[: len(theirs)] - theirs).max() <= TRUSTED * np.abs(theirs).max():
            raise ValueError("the features differ from those of the authors' parser")

    def exogenous(self, x: Any, u: Any) -> Any:
        """Return throttle, steering and their change to the next sample (n, 4)."""
        change = np.diff(u, axis=0, append=u[-1:])
        return np.column_stack([u, change])

    def reference_speed(self, x: Any) -> Any:
        """Return the input `VREF` (n,)."""
        return x[:, 0]

    def _table(self, x: Any, u: Any) -> Any:
        table = np.column_stack([x, self.exogenous(x, u), self.reference_speed(x)])
        return np.asarray(table[:, self.columns], dtype=np.float32)

    def _windows(self, table: Any, rows: Any) -> Any:
        return table[rows[:, None] + np.arange(1 - self.horizon, 1)]

    def predict(self, x: Any, u: Any, rows: Any, ahead: int, refreshed: bool) -> Any:
        """Roll out from `rows` under the recorded commands: (m, ahead, 3)."""
        torch = self._torch
        table = self._table(x, u)
        window = self._windows(table, rows)
        out = np.empty((len(rows), ahead, 3))
        with torch.no_grad():
            for step in range(ahead):
                if step:
                    now = table[rows + step].copy()
                    now[:, :3] = out[:, step - 1]
                    self.own_speed(now)
                    window = np.concatenate([window[:, 1:], now[:, None]], axis=1)
                if refreshed or not step:
                    coefficients = self._coefficients(window)
                last = torch.from_numpy(window[:, -1:])
                out[:, step] = self.advance(last, coefficients).numpy()
        return out

    def _coefficients(self, window: Any) -> Any:
        torch = self._torch
        flat = self._scaler.transform(window.reshape(-1, window.shape[2]))
        scaled = torch.from_numpy(np.asarray(flat, dtype=np.float32).reshape(window.shape))
        hidden = self._model.init_hidden(len(window)) if self._model.is_rnn else None
        return self.coefficients(torch.from_numpy(window), scaled, hidden)

    def own_speed(self, now: Any) -> None:
        """Replace the recorded reference speed of later samples by the predicted speed."""

    def coefficients(self, window: Any, scaled: Any, hidden: Any) -> Any:
        """Return what the network estimates, (m, parameters)."""
        return self._model(window, scaled, hidden)[2]

    def advance(self, last: Any, coefficients: Any) -> Any:
        """Return the state (m, 3) a sample after `last` (m, 1, columns)."""
        return self._model.differential_equation(last, coefficients, SAMPLE_S)


class DeepDynamics(LearnedModel):
    """Single-track model whose Pacejka and drive coefficients a network estimates, bounded."""

    config = "model/deep_dynamics_iac.yaml"


class DeepPacejkaPublished(LearnedModel):
    """As `DeepPacejka`, with the published `VREF`: the speed that is measured 0.2 s later."""

    config = "model/deep_pacejka_iac.yaml"
    columns = np.array([0, 1, 2, 4, 6, 7])

    def reference_speed(self, x: Any) -> Any:
        """Return the measured speed 0.2 s later."""
        return np.concatenate([x[FUTURE_SAMPLES:, 0], np.repeat(x[-1:, 0], FUTURE_SAMPLES)])


class DeepPacejka(DeepPacejkaPublished):
    """Single-track model whose Pacejka coefficients and drive force a network estimates."""

    def data(self, csv: Path) -> tuple[Any, ...]:
        """As `LearnedModel.data`, with the speed of the same sample as `VREF`."""
        features, labels = super().data(csv)
        features = features.copy()
        features[:, :, 7] = features[:, :, 0]
        return features, labels

    def reference_speed(self, x: Any) -> Any:
        """Return the speed of the same sample: a later one is not known to a predictor."""
        return x[:, 0]

    def own_speed(self, now: Any) -> None:
        """Use the predicted speed."""
        now[:, 5] = now[:, 0]


class Fthd(LearnedModel):
    """Deep Dynamics with a hybrid loss and fine tuning."""

    package = "fthd"
    config = "fthd_iac.yaml"
    trained_share = 0.9

    def data(self, csv: Path) -> tuple[Any, ...]:
        """As `LearnedModel.data`, with the times before and after the step."""
        module = importlib.import_module("fthd.tools.csv_fthd_timeverify")
        # Their main function sets these.
        module.__dict__.update(TOTAL_TIME=0.0, SAMPLING_TIME=SAMPLE_S)
        module.write_dataset(str(csv), self.horizon)
        (written,) = csv.parent.glob(f"{csv.stem}_{self.horizon}*.npz")
        with np.load(written) as made:
            names = "features", "labels", "times_features", "times"
            result = tuple(made[name] for name in names)
        written.unlink()
        return result

    def parts(self) -> tuple[Any, Any, Any]:
        """As `LearnedModel.parts`."""
        models = importlib.import_module("fthd.model.models_supervised")
        name = self.settings["MODEL"]["NAME"]
        train = importlib.import_module("fthd.train.fthd_train").train
        return models.string_to_model[name], models.string_to_dataset[name], train

    def validation(self, whole: Any, rest: Any) -> tuple[Any, int, bool]:
        """Return all data, in batches of the hidden state's size, as their main function does."""
        return whole, self._model.batch_size, True

    def exogenous(self, x: Any, u: Any) -> Any:
        """Return throttle, steering and their change from the sample before (n, 4)."""
        return np.column_stack([u, np.diff(u, axis=0, prepend=u[:1])])

    def coefficients(self, window: Any, scaled: Any, hidden: Any) -> Any:
        """As `LearnedModel.coefficients`; their network stores them by name."""
        self._model(window, scaled, hidden, *self._times(len(window)))
        named = self._model.trained_coeff_ls
        return self._torch.stack([named[name] for name in self._model.sys_params], dim=1)

    def advance(self, last: Any, coefficients: Any) -> Any:
        """As `LearnedModel.advance`."""
        return self._model.differential_equation(last, coefficients, *self._times(len(last)))[0]

    def _times(self, count: int) -> tuple[Any, Any]:
        before = self._torch.zeros((count, 1))
        return before, before + SAMPLE_S


MODELS = {
    "Deep Dynamics": DeepDynamics,
    "Deep Pacejka": DeepPacejka,
    "Deep Pacejka, future v_x given": DeepPacejkaPublished,
    "FTHD": Fthd,
}


def _loader(data: Any, batch: int, shuffled: bool, drop: bool) -> Any:
    """Return a loader of the authors' batches, read as a whole instead of row by row."""
    from torch.utils.data import BatchSampler, DataLoader, RandomSampler, SequentialSampler

    order = RandomSampler(data) if shuffled else SequentialSampler(data)
    return DataLoader(data, sampler=BatchSampler(order, batch, drop), batch_size=None)


def train(job: Any, models: dict[str, LearnedModel]) -> dict[str, Any]:
    """Train the model named in the job."""
    name = str(job["train"])
    model = MODELS[name](Path(str(job["code"])), int(job["epochs"]))
    started = time.process_time()
    losses = model.train(Path(str(job["csv"])), int(job["seed"]))
    models[name] = model
    optimised = model.settings["MODEL"]["OPTIMIZATION"]
    return {
        "losses": np.array(losses),
        "settings": f"{model.horizon} past samples, batch {optimised['BATCH_SIZE']}, learning"
        f" rate {optimised['LR']:g}",
        "seconds": time.process_time() - started,
    }


def predict(job: Any, models: dict[str, LearnedModel]) -> dict[str, Any]:
    """Predict with a trained model, and time one start."""
    model = models[str(job["predict"])]
    x, u, rows, ahead = (job[name] for name in ("x", "u", "rows", "ahead"))
    refreshed = bool(job["refreshed"])
    predicted = model.predict(x, u, rows, int(ahead), refreshed)
    step_s, rollout_s = (
        _median_time(model, x, u, int(rows[0]), steps, refreshed) for steps in (1, int(ahead))
    )
    return {"predicted": predicted, "step_s": step_s, "rollout_s": rollout_s}


def _median_time(model: Any, x: Any, u: Any, row: int, ahead: int, refreshed: bool) -> float:
    """Return the median time of a prediction from one row, s."""
    # As in a vehicle: with the whole recording, making its table of features would count.
    x, u, rows = samples_of(model, x, u, row, ahead)
    times = []
    for _ in range(_TIMED_CALLS):
        started = time.process_time()
        model.predict(x, u, rows, ahead, refreshed)
        times.append(time.process_time() - started)
    return float(np.median(times))


def samples_of(model: Any, x: Any, u: Any, row: int, ahead: int) -> tuple[Any, Any, Any]:
    """Return the samples x and u that a prediction from `row` uses, and the row in them (1,)."""
    # The change of the commands needs one sample before the window.
    first = max(row - model.horizon, 0)
    last = row + ahead + FUTURE_SAMPLES
    return x[first:last], u[first:last], np.array([row - first])


def main() -> None:
    """Train models and predict with them."""
    shared = runpy.run_path(str(_BASELINES))
    for name in _LOGGING:
        sys.modules[name] = shared["_Absent"](name)
    models: dict[str, LearnedModel] = {}
    shared["serve"](lambda job: train(job, models) if "train" in job else predict(job, models))


if __name__ == "__main__":
    main()
