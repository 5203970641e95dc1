# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Learned vehicle models in their own environment: train one, and roll it out."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from adk_ros.bench.learned.sampled_drive import SampledDrive, write_csv
from adk_ros.bench.paper.baseline_libraries import Worker, WorkerNames
from adk_ros.errors import DataError, UsageError
from adk_ros.numerics.arrays import FloatArray, IntArray

DEEP_DYNAMICS, FTHD = "Deep Dynamics", "FTHD"
DEEP_PACEJKA, DEEP_PACEJKA_GIVEN = "Deep Pacejka", "Deep Pacejka, future v_x given"
PACKAGES = {
    DEEP_DYNAMICS: "deep_dynamics",
    DEEP_PACEJKA: "deep_dynamics",
    FTHD: "fthd",
    DEEP_PACEJKA_GIVEN: "deep_dynamics",
}
"""Folder of the authors' code by model."""
EPOCHS = {DEEP_DYNAMICS: 400, DEEP_PACEJKA: 400, DEEP_PACEJKA_GIVEN: 400, FTHD: 1000}
"""Published epochs; of FTHD as many again for fine tuning."""
HISTORY = 20
"""Past samples before a start: at least those of the published settings (15 and 16)."""
WORKER = Path(__file__).with_name("learned_model_worker.py")
TIMEOUT_S = 4 * 3600.0
NAMES = WorkerNames(
    "the learned models",
    "install torch, scikit-learn, scipy, matplotlib, pyyaml and tqdm there, or name the"
    " environment with --python",
)


@dataclass(frozen=True)
class Training:
    """
    How a model was trained.

    `losses`: validation loss of each epoch, as the authors' code computes it.
    """

    model: str
    settings: str
    losses: FloatArray
    seconds: float

    @property
    def best_epoch(self) -> int:
        """Epoch of the smallest validation loss, from 1 on."""
        return int(np.argmin(self.losses)) + 1

    @property
    def converged_epoch(self) -> int:
        """First epoch with a validation loss within 5 % of the smallest."""
        return int(np.argmax(self.losses <= 1.05 * self.losses.min())) + 1


@dataclass(frozen=True)
class Rollout:
    """Predictions (m, ahead, 3) SI; times of one step and of one whole rollout, s."""

    predicted: FloatArray
    step_s: float
    rollout_s: float


def find_code(folder: Path) -> dict[str, Path]:
    """
    Return the checked-out repository of each model below `folder`.

    :raises UsageError: there is none.
    """
    found = {}
    for name, package in PACKAGES.items():
        places = [p.parent for p in folder.glob(f"*/{package}") if (p / "model").is_dir()]
        if places:
            found[name] = sorted(places)[0].resolve()
    if not found:
        raise UsageError(
            f"{folder} has no checkout of deep-dynamics or FTHD: clone them into that folder"
        )
    return found


class LearnedModels:
    """
    Process of the other environment; a context manager that ends it on exit.

    :param python: Python of the environment; None: this one.
    """

    def __init__(
        self, scratch: Path, python: Path | None = None, timeout_s: float = TIMEOUT_S
    ) -> None:
        self._scratch = scratch
        # Not resolved: Python finds its environment by the path of the link.
        place = (python or Path(sys.executable)).absolute()
        if not place.is_file():
            raise UsageError(f"--python {python} is not a Python")
        self._worker = Worker(place, WORKER, timeout_s, scratch, NAMES)

    def train(
        self, model: str, code: Path, drive: SampledDrive, epochs: int, seed: int
    ) -> Training:
        """
        Train a model on a whole drive.

        :raises UsageError, DataError: the environment lacks a package, or the code fails.
        """
        csv = self._scratch / "drive.csv"
        write_csv(drive, csv)
        answer = self._worker.ask(
            train=np.array(model), code=np.array(str(code)), csv=np.array(str(csv)),
            epochs=np.array(epochs), seed=np.array(seed),
        )  # fmt: skip
        losses = np.asarray(answer["losses"], dtype=np.float64)
        if not losses.size:
            raise DataError(f"{model}: its training printed no validation loss")
        return Training(model, str(answer["settings"]), losses, float(answer["seconds"]))

    def predict(
        self, model: str, drive: SampledDrive, rows: IntArray, ahead: int, refreshed: bool
    ) -> Rollout:
        """Roll out a trained model from `rows`; `refreshed`: evaluate its network each step."""
        answer = self._worker.ask(
            predict=np.array(model), x=drive.x, u=drive.u, rows=rows, ahead=np.array(ahead),
            refreshed=np.array(refreshed),
        )  # fmt: skip
        predicted = np.asarray(answer["predicted"], dtype=np.float64)
        if predicted.shape != (len(rows), ahead, 3):
            raise DataError(f"{model}: the worker returned an array of shape {predicted.shape}")
        return Rollout(predicted, float(answer["step_s"]), float(answer["rollout_s"]))

    def close(self) -> None:
        """End the process."""
        self._worker.close()

    def __enter__(self) -> LearnedModels:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def chosen(names: Sequence[str], code: dict[str, Path]) -> list[str]:
    """
    Return the models to run: `names`, or all whose code is there and that know no future speed.

    :raises UsageError: one is unknown, or its code is missing.
    """
    for name in names:
        if name not in PACKAGES:
            raise UsageError(f"--model '{name}' is unknown: choose from {', '.join(PACKAGES)}")
        if name not in code:
            raise UsageError(f"--model '{name}': no checkout has the folder {PACKAGES[name]}")
    wanted = names or [name for name in code if name != DEEP_PACEJKA_GIVEN]
    return [name for name in PACKAGES if name in wanted]
