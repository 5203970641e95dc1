# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`adk_ros.load_model`: a trained model with its held-out scores."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from adk_ros.api.tables import as_html, score_frame
from adk_ros.signals.channels import INPUT_NAMES

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from adk_ros.model.artefact import Artefact
    from adk_ros.train.training_run import TrainingResult

MANIFEST = "manifest.json"
"""As `model.artefact.MANIFEST`, which needs PyTorch to import."""


@dataclass(frozen=True)
class TrainedModel:
    """
    A trained model.

    `artefact`: the model folder as loaded. `training`: what the training returned; None for a
    model loaded from disk.
    """

    artefact: Artefact
    training: TrainingResult | None = None

    @property
    def path(self) -> Path:
        """The model folder."""
        return self.artefact.path

    @property
    def manifest(self) -> dict[str, Any]:
        """The manifest: format, channels, sizes, hashes, and under "training" how it was made."""
        return self.artefact.manifest

    @property
    def facts(self) -> dict[str, Any]:
        """How the model was trained: settings, data, split, sensors, held-out scores."""
        facts: dict[str, Any] = self.manifest["training"]
        return facts

    @property
    def sensors(self) -> dict[str, Any] | None:
        """Sensor configuration of the training data, as in the manifest."""
        return self.facts.get("sensors")

    @property
    def uses_commands(self) -> bool:
        """Whether a command changed in the training data; True where it is not known."""
        known = self.facts.get("range") or {}
        limits = [known.get(name, (-math.inf, math.inf)) for name in INPUT_NAMES]
        return any(low < high for low, high in limits)

    @cached_property
    def scores(self) -> pd.DataFrame:
        """
        Scores on held-out data.

        Index (channel, horizon_s); one column per predictor with its RMSE in m/s or rad/s, then
        `ratio` and `ratio_commands_held`: RMSE of the model divided by that of the best naive
        predictor, with future commands known and with commands held constant.
        """
        return score_frame(self.facts.get("held_out"))

    def figure(self) -> Figure:
        """Draw the RMSE on held-out data against the horizon, with the naive predictors."""
        from adk_ros.api.figures import score_figure

        return score_figure(self.scores, f"{self.path.name}: RMSE on held-out data")

    def _repr_html_(self) -> str:
        return as_html(f"Model {self.path}: scores on held-out data", self.scores)


def is_model_folder(path: Path | str) -> bool:
    """Whether `path` is a folder that contains a model's manifest."""
    return (Path(path) / MANIFEST).is_file()


def load_model(path: Path | str) -> TrainedModel:
    """
    Load and check a trained model.

    :param path: model folder written by `train_model` or `adk train`.
    :raises UsageError: the folder is missing, incomplete, altered, or of another version.

    Example::

        model = adk_ros.load_model("models/handling")
        model.scores["ratio"].unstack()
    """
    from adk_ros.model import artefact

    return TrainedModel(artefact.load(Path(path)))


def as_model(model: TrainedModel | Path | str) -> TrainedModel:
    """Return `model`, loaded if it is a path."""
    return model if isinstance(model, TrainedModel) else load_model(model)
