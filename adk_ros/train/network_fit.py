# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The default training: a multi-step loss, in units of the error of persistence.

    L = mean over steps j and channels c of ((x_pred(k+j) - x_ref(k+j)) / s_jc)^2
    s_jc = RMS of x_ref(k+j) - x_k over the training data

so that every horizon and channel has the same weight, and a loss of 1 equals the prediction "no
change". The acceleration in the paper's loss corresponds to the increment at j = 1.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from adk_ros.errors import DataError, UsageError
from adk_ros.model.lifting.scaling import Scaling
from adk_ros.model.lifting.single_track import SINGLE_TRACK_FEATURES
from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.signals.channels import TICK_NS, Record
from adk_ros.signals.score import reference_noise
from adk_ros.train import checkpoint
from adk_ros.train.dataset import Sequences, sequences
from adk_ros.train.network import Network, as_tensor
from adk_ros.train.quadratic_features import QuadraticFeatures, Rows, fit_quadratic, newest
from adk_ros.train.single_track_fit import SingleTrack, fit_single_track
from adk_ros.train.speed_augmentation import scale_to_higher_speeds
from adk_ros.train.train_settings import TrainSettings
from adk_ros.train.windows import TrainingWindows

_TICK_S = TICK_NS * 1e-9
_CHECKPOINT_EVERY = 500
"""Updates between checkpoints: about 20 s."""
_MIN_ROWS = 800
"""Sequence starts that a training needs: 20 s of driving. Empirical, not calibrated."""
_VALIDATION_ROWS = 4096
"""Largest number of sequences in the validation loss, evenly spaced: limits its time."""
_QUADRATIC_RATE = 0.25
"""
Factor on the learning rate with fitted features, which start near the solution. Empirical.
"""
_WIDTH_WITH_QUADRATIC = 0.75
"""
Factor on width and features of the network with quadratic features, for the same time per tick.
"""
_QUADRATIC_ACCEPT_LOSS = 0.15
"""
Quadratic features are kept if their validation loss before training is below this; 1 is
persistence. On recordings resampled from another rate they fit the resampling, and their rollouts
diverge on new manoeuvres. Empirical, not calibrated.
"""
_SINGLE_TRACK_ACCEPT_LOSS = 0.5
"""
The single-track model is used if its validation loss is below this; 1 is persistence. By choice.
"""
_NOISE_SHARE, _MIN_NOISE = 0.45, 0.02
"""
Training noise as a share of the measurement noise, and its minimum in units of `step_scale`.
Empirical, not calibrated.
"""
_MIN_CHANGE = 1e-6
"""Scaled. A state that changes less over all the training data is a constant."""


@dataclass(frozen=True)
class Step:
    """Progress of a training: `loss` is a running mean, `validation` the last validation loss."""

    step: int
    steps: int
    loss: float
    validation: float
    learning_rate: float


@dataclass(frozen=True)
class FittedNetwork:
    """
    The network with the lowest validation loss; `curve` rows: step, loss, validation loss.

    `unaugmented`: equations that rows augmented to higher speeds are left out of, since the data
    contradict them.
    """

    network: Network
    scaling: Scaling
    curve: list[tuple[int, float, float]]
    best_step: int
    stopped_early: bool
    unaugmented: tuple[str, ...] = ()
    single_track: SingleTrack | None = None

    @property
    def unaugmented_text(self) -> str:
        """Return these equations for people."""
        return ", ".join(name.replace("_rate", " rate") for name in self.unaugmented)


def choose_device(name: str) -> torch.device:
    """
    Return the device for `auto`, `cpu` or `cuda`.

    :raises UsageError: `cuda` without a GPU.
    """
    available = torch.cuda.is_available()
    if name == "cuda" and not available:
        raise UsageError("device is cuda, but torch finds no GPU: use --device auto")
    return torch.device("cuda" if available and name != "cpu" else "cpu")


def require_min_rows(rows: IntArray) -> None:
    """:raises DataError: there are too few sequence starts to train from."""
    if rows.size < _MIN_ROWS:
        raise DataError(
            f"only {rows.size * _TICK_S:.0f} s of training data without gaps, at least "
            f"{_MIN_ROWS * _TICK_S:.0f} s are needed: give more or longer recordings"
        )


class _Data:
    """A part of the data as scaled tensors, from which sequences are gathered."""

    def __init__(self, part: Sequences, scaling: Scaling, device: torch.device) -> None:
        self.part, self.scaling = part, scaling
        self.x = as_tensor(scaling.scale_x(part.x), device)
        self.x_ref = as_tensor(scaling.scale_x(part.x_ref), device)
        self.u = as_tensor(scaling.scale_u(part.u), device)
        past = torch.arange(part.history + 1, device=device)
        self._x_past, self._u_past = -past, -1 - past[:-1]

    def gather(self, rows: Tensor, ahead: int) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """x_past (b, p + 1, 3), u_past (b, p, 2), u_ahead (b, h, 2), x_ref ahead (b, h, 3)."""
        column, step = rows[:, None], torch.arange(ahead, device=rows.device)
        return (
            self.x[column + self._x_past],
            self.u[column + self._u_past],
            self.u[column + step],
            self.x_ref[column + 1 + step],
        )

    def persistence(self, ahead: int) -> Tensor:
        """Return s_jc (h, 3), see the module; infinite for a channel that is not measured."""
        rows = torch.from_numpy(self.part.rows).to(self.x.device)
        now, ends = self.x[rows], range(1, ahead + 1)
        result = [((self.x_ref[rows + j] - now) ** 2).mean(0) for j in ends]
        change = torch.stack(result).sqrt()
        return torch.where(change > _MIN_CHANGE, change, math.inf)


def input_noise(train: Sequence[Record], scaling: Scaling, most: float) -> FloatArray:
    """
    Return the noise (3,) to add to past states in training, in units of `Scaling.step_scale`.

    About half of the measurement noise, at most `most`. A model trained without noise amplifies
    measurement noise about ten times; too much noise hides detail of clean data.
    """
    floors = np.array([reference_noise(record) for record in train])
    known = np.isfinite(floors).all(axis=1)
    if not known.any():
        return np.full(3, most)
    relative = np.median(floors[known], axis=0) / (scaling.x_scale * scaling.step_scale)
    return np.asarray(np.clip(_NOISE_SHARE * relative, min(_MIN_NOISE, most), most))


def fit(
    train: Sequence[Record],
    validation: Sequence[Record],
    settings: TrainSettings,
    on_step: Callable[[Step], None] | None = None,
    checkpoint_path: Path | None = None,
    windows: TrainingWindows | None = None,
) -> FittedNetwork:
    """
    Train a network on `train` and return its state with the lowest loss on `validation`.

    A checkpoint of the same training at `checkpoint_path` is resumed. `windows`: further data, of
    which `train` is the first window; scaling and fitted features come from it.
    :raises DataError: too little data, or the training diverges.
    """
    torch.set_num_threads(1)
    device = choose_device(settings.device)
    longest = max(settings.short_steps, settings.long_steps)
    part = sequences(train, settings.history, longest, "training")
    require_min_rows(part.rows)
    validation_set = sequences(validation, settings.history, longest, "validation")
    scaling = scaling_of(part)
    data = _Data(part, scaling, device)
    validation_data = _Data(validation_set, scaling, device)

    def trainer_of(
        quadratic: QuadraticFeatures | None, single: SingleTrack | None = None
    ) -> _Trainer:
        torch.manual_seed(settings.seed)
        share, noise = 1.0, np.full(3, settings.noise)
        if quadratic is not None:
            share, noise = _WIDTH_WITH_QUADRATIC, input_noise(train, scaling, settings.noise)
        hidden, features = (max(1, int(share * n)) for n in (settings.hidden, settings.features))
        if single is not None:
            features = max(1, settings.features - SINGLE_TRACK_FEATURES)
        blended = single and single.with_quadratic(quadratic is not None)
        network = Network(
            settings.history, hidden, features, scaling.step_scale, quadratic, blended
        )
        return _Trainer(network.to(device), data, validation_data, settings, noise, windows)

    quadratic = None
    if settings.quadratic:
        quadratic = quadratic_features_of(part, scaling, settings.speed_augmentation)
    trainer = trainer_of(quadratic)
    if quadratic is not None and not trainer.validate() < _QUADRATIC_ACCEPT_LOSS:
        quadratic = None
        trainer = trainer_of(None)
    single = fit_single_track(part, scaling) if settings.single_track else None
    # Before the training, its increments alone are predicted.
    if single and not trainer_of(None, single).validate() < _SINGLE_TRACK_ACCEPT_LOSS:
        single = None
    if single:
        combined = trainer_of(quadratic, single)
        # Beside quadratic features it must make them better, also before the training.
        if quadratic is not None and not combined.validate() < trainer.validate():
            single = None
        else:
            trainer = combined
    key = checkpoint.fingerprint(settings, [*train, *validation])
    if windows is not None:
        key += windows.key
    curve, best_step, early = trainer.run(key, checkpoint_path, on_step)
    unaugmented = () if quadratic is None else quadratic.unaugmented
    return FittedNetwork(
        trainer.network.to("cpu"), scaling, curve, best_step, early, unaugmented, single
    )


def scaling_of(part: Sequences) -> Scaling:
    """Return the standard scaling of a part of the data."""
    change = np.diff(part.x_ref, axis=0)
    change = change[np.isfinite(change).all(axis=1)]
    return Scaling.standard(part.x[part.rows], part.u[part.rows], change)


def quadratic_features_of(
    part: Sequences, scaling: Scaling, augment: bool = True
) -> QuadraticFeatures:
    """
    Return the quadratic features that best predict the scaled increments of a part.

    `augment`: also those of the part at higher speeds.
    """
    x, x_ref = scaling.scale_x(part.x), scaling.scale_x(part.x_ref)
    target = np.full_like(x, np.nan)
    target[:-1] = (x_ref[1:] - x[:-1]) / scaling.step_scale
    rows = _faster_rows(part, scaling) if augment else None
    return fit_quadratic(x, scaling.scale_u(part.u), target, part.rows, part.history, rows)


def _faster_rows(part: Sequences, scaling: Scaling) -> Rows:
    """Return the rows of a part at higher speeds, scaled."""
    augmented = scale_to_higher_speeds(part, newest(part.history))
    change = augmented.change / (scaling.x_scale * scaling.step_scale)
    return Rows(
        augmented.rows,
        [scaling.scale_x(state) for state in augmented.states],
        change,
        np.abs(part.x[:, 0]),
    )


class _Trainer:
    def __init__(
        self,
        network: Network,
        data: _Data,
        validation: _Data,
        settings: TrainSettings,
        noise: FloatArray,
        windows: TrainingWindows | None = None,
    ) -> None:
        self.network, self.data, self.settings = network, data, settings
        self.windows, self._window = windows, 0
        self.validation = validation
        self.has_fitted_features = network.encoder.known_features > 0
        longest = max(settings.short_steps, settings.long_steps)
        self.weight = 1.0 / data.persistence(longest)
        self.optimiser = torch.optim.AdamW(
            network.parameters(), lr=settings.learning_rate, weight_decay=settings.weight_decay
        )
        self.noise = as_tensor(noise, self.weight.device) * network.step_scale
        spread = np.linspace(0, validation.part.rows.size - 1, _VALIDATION_ROWS).astype(int)
        chosen = validation.part.rows[np.unique(spread)]
        self.validation_rows = torch.from_numpy(chosen).to(self.weight.device)

    def loss(self, data: _Data, rows: Tensor, ahead: int, noise: Tensor | None) -> Tensor:
        x_past, u_past, u_ahead, target = data.gather(rows, ahead)
        if noise is not None:
            x_past = x_past + noise
        error = (self.network.roll_out(x_past, u_past, u_ahead) - target) * self.weight[:ahead]
        return (error**2).mean()

    def validate(self) -> float:
        with torch.no_grad():
            ahead = max(self.settings.short_steps, self.settings.long_steps)
            return float(self.loss(self.validation, self.validation_rows, ahead, None))

    def rate(self, step: int) -> float:
        """Return the learning rate: linear rise over the first tenth, then a cosine to zero."""
        share = step / self.settings.steps
        shape = share / 0.1 if share < 0.1 else 0.5 * (1 + math.cos(math.pi * (share - 0.1) / 0.9))
        share = _QUADRATIC_RATE if self.has_fitted_features else 1.0
        return self.settings.learning_rate * share * max(shape, 1e-3)

    def run(
        self, key: str, path: Path | None, on_step: Callable[[Step], None] | None
    ) -> tuple[list[tuple[int, float, float]], int, bool]:
        settings, network = self.settings, self.network
        first, running, since = 0, math.nan, 0
        curve: list[tuple[int, float, float]] = []
        # Features that were fitted before the training are a candidate as they are.
        best, best_step = self.validate() if self.has_fitted_features else math.inf, 0
        best = best if math.isfinite(best) else math.inf
        best_state = {k: v.clone() for k, v in network.state_dict().items()}
        resumed = checkpoint.load(path, key, network, self.optimiser) if path else None
        if resumed is not None:
            first, extra = resumed
            curve = [(int(a), float(b), float(c)) for a, b, c in extra["curve"]]
            best, best_step, running, since = (
                float(extra["best"]),
                int(extra["best_step"]),
                float(extra["running"]),
                int(extra["since"]),
            )
            best_state = {k: torch.as_tensor(extra[f"best.{k}"]) for k in best_state}
        stage = int(settings.short_share * settings.steps)
        early = False
        for step in range(first, settings.steps):
            running = self.one_step(step, stage, running)
            if (step + 1) % settings.validate_every == 0 or step + 1 == settings.steps:
                value = self.validate()
                curve.append((step + 1, running, value))
                # Not in the first stage, which minimises a loss over a shorter horizon; and not
                # against what was fitted before, which a training may reach late.
                is_lowest = value < min(
                    (x for *_, x in curve[:-1] if math.isfinite(x)), default=math.inf
                )
                since = since + 1 if step >= stage and not is_lowest else 0
                if value < best:
                    best, best_step = value, step + 1
                    best_state = {k: v.clone() for k, v in network.state_dict().items()}
                early = since >= settings.patience
            if on_step is not None:
                last = curve[-1][2] if curve else math.nan
                on_step(Step(step + 1, settings.steps, running, last, self.rate(step)))
            # Not after early stopping: a training resumed from there would continue.
            if path is not None and not early and (step + 1) % _CHECKPOINT_EVERY == 0:
                extra = {f"best.{k}": v.cpu().numpy() for k, v in best_state.items()}
                extra |= {
                    "curve": np.array(curve).reshape(-1, 3),
                    "best": np.array(best),
                    "best_step": np.array(best_step),
                    "running": np.array(running),
                    "since": np.array(since),
                }
                checkpoint.save(path, key, step + 1, network, self.optimiser, extra)
            if early:
                break
        if not any(math.isfinite(value) for *_, value in curve):
            raise DataError("the training diverged: lower --learning-rate, check the bag's units")
        network.load_state_dict(best_state)
        return curve, best_step, early

    def data_of(self, step: int) -> _Data:
        """Return the window of a step; the one before is given up."""
        if self.windows is None:
            return self.data
        number = self.windows.of_step(step, self.settings.steps)
        if number != self._window:
            part = self.data.part
            read = sequences(self.windows.read(number), part.history, part.ahead, "training")
            self.data = _Data(read, self.data.scaling, self.weight.device)
            self._window = number
        return self.data

    def one_step(self, step: int, stage: int, running: float) -> float:
        settings, data = self.settings, self.data_of(step)
        random = np.random.default_rng((settings.seed, step))
        device = self.weight.device
        rows = torch.from_numpy(random.choice(data.part.rows, settings.batch)).to(device)
        shape = (settings.batch, settings.history + 1, 3)
        noise = as_tensor(random.standard_normal(shape), device) * self.noise
        ahead = settings.short_steps if step < stage else settings.long_steps
        loss = self.loss(data, rows, ahead, noise)
        self.optimiser.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), 1.0)
        for group in self.optimiser.param_groups:
            group["lr"] = self.rate(step)
        self.optimiser.step()
        value = float(loss.detach())
        return value if math.isnan(running) else 0.98 * running + 0.02 * value
