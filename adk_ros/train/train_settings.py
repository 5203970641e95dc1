# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Settings of a training, with the defaults that the benchmarks use."""

from __future__ import annotations

from dataclasses import dataclass

from adk_ros.errors import UsageError

MIN_TRAINING_S = 60.0
"""
s of recordings that a training needs in all, for blocks of `dataset` in each of its parts. By
choice.
"""


@dataclass(frozen=True)
class TrainSettings:
    """
    Settings of the default training.

    `history`: past samples in addition to the present one. `hidden`, `features`: width and number
    of features of the encoder, three quarters of it with quadratic features. `steps`: updates,
    each of `batch` sequences. The rollout in the loss has `short_steps` for the first
    `short_share` of the training and `long_steps` after it. `noise`: standard deviation added to
    past states, in units of `Scaling.step_scale`. `quadratic`: add quadratic features fitted by
    least squares (`quadratic_features`) if they fit the data; the network is then trained at a
    quarter of the learning rate, with noise matched to the data. `speed_augmentation`: fit them to
    rows augmented to higher speeds as well, in the equations that the data do not contradict
    (`augmented_regression`). `single_track`: outside the range of the training data, blend into a
    single-track model (`single_track_fit`) if it predicts the validation part. `weight_decay`: of
    AdamW; without it a recording of three laps is overfitted. `patience`: validations without
    improvement before early stopping, not in the first stage. `device`: auto, cpu or cuda.

    :raises UsageError: a value is out of range.
    """

    history: int = 5
    hidden: int = 32
    features: int = 12
    steps: int = 4000
    batch: int = 512
    learning_rate: float = 4e-3
    weight_decay: float = 0.1
    short_steps: int = 20
    long_steps: int = 60
    short_share: float = 0.6
    noise: float = 0.25
    quadratic: bool = True
    speed_augmentation: bool = True
    single_track: bool = False
    patience: int = 6
    validate_every: int = 200
    seed: int = 0
    device: str = "auto"

    def __post_init__(self) -> None:
        ranges = {
            "history": (0, 40),
            "hidden": (4, 512),
            "features": (1, 64),
            "steps": (10, 10**7),
            "batch": (1, 65536),
            "short_steps": (1, 400),
            "long_steps": (1, 400),
            "patience": (1, 10**6),
            "validate_every": (1, 10**6),
        }
        for name, (low, high) in ranges.items():
            if not low <= getattr(self, name) <= high:
                raise UsageError(f"{name} is {getattr(self, name)}: choose {low} to {high}")
        if not 0.0 < self.learning_rate <= 1.0:
            raise UsageError(f"learning_rate is {self.learning_rate:g}: choose above 0, at most 1")
        if not 0.0 <= self.weight_decay <= 100.0:
            raise UsageError(f"weight_decay is {self.weight_decay:g}: choose 0 to 100")
        if not 0.0 <= self.noise <= 100.0:
            raise UsageError(f"noise is {self.noise:g}: choose 0 to 100")
        if self.single_track and not self.history:
            raise UsageError("single_track needs a history of at least 1: its lags act on it")
        require_device(self.device)


@dataclass(frozen=True)
class PaperSettings:
    """
    The paper's training: Table 2, eqs. (11) to (14) and, with `acceleration`, (25) to (28).

    The acceleration loss is in units of its range in the data: in m/s² it would outweigh the other
    three about a million times.

    :raises UsageError: a value is out of range.
    """

    acceleration: bool = True
    learning_rate: float = 1e-3
    batch: int = 20
    epochs: int = 2000
    hidden: int = 128
    features: int = 12
    seed: int = 0
    window: int = 50
    device: str = "cpu"

    def __post_init__(self) -> None:
        if not 1 <= self.epochs <= 10**6:
            raise UsageError(f"epochs is {self.epochs}: choose 1 to 1000000")
        if not 1 <= self.batch <= 65536:
            raise UsageError(f"batch is {self.batch}: choose 1 to 65536")
        require_device(self.device)


def require_device(name: str) -> None:
    """:raises UsageError: `name` is no device to train on."""
    if name not in ("auto", "cpu", "cuda"):
        raise UsageError(f"device '{name}' is unknown: choose auto, cpu or cuda")
