# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What the effect of the paper's online method depends on, and which reading reproduces it.

The paper prints errors of ALDK-SWLS that are 95, 91 and 91 % below those of ALDK, and leaves open

- whether an error is an innovation, y_k - theta_(k-1) phi_k, which a predictor makes, or the
  a-posteriori error y_k - theta_k phi_k, of the same pair after the update has learned it,
- which eigenvalues of the Gram matrix its pseudo-inverse counts as zero (the cut),
- the training epochs that its printed results have (Table 2 states 2000).

Each combination of these is a reading. Window and cut are also chosen by innovations on the last
fifth of the training drive; all figures are of the nominal test, clean, one step ahead.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from adk_ros.bench.paper import cases
from adk_ros.bench.paper.paper_results import effect
from adk_ros.model.adaptation.online_methods import OnlineSettings, PaperSWLS
from adk_ros.model.koopman import KoopmanModel
from adk_ros.numerics.arrays import BoolArray, FloatArray
from adk_ros.signals.channels import Record
from adk_ros.signals.score import REPORT_SCALE

EPOCHS = (6, 90)
"""Trainings besides that of the run: far from settled, and where the loss has settled."""
WINDOWS = (25, 50, 100, 200, 400)
CUTS = (1e-14, 1e-12, 1e-10, 1e-8, 1e-6, 1e-4)
VALIDATED_FROM = 0.8
"""Share of the training drive before the part on which parameters are chosen; by choice."""
INNOVATION, A_POSTERIORI = "innovation", "a posteriori"

Tell = Callable[[float], None]
Fit = Callable[[int, Tell], KoopmanModel]


@dataclass(frozen=True)
class OnlineErrors:
    """
    Errors one step ahead of each pair of a record, SI (n - 1, 3), and resets of the method.

    `constant`: of the offline model; `innovation` before, `a_posteriori` after the update; NaN for
    pairs that are not learned from.
    """

    constant: FloatArray
    innovation: FloatArray
    a_posteriori: FloatArray
    resets: int

    def of(self, kind: str) -> FloatArray:
        """Return the errors of a kind, `INNOVATION` or `A_POSTERIORI`."""
        return self.innovation if kind == INNOVATION else self.a_posteriori


@dataclass(frozen=True)
class LiftedPairs:
    """Regressors `phi` (n - 1, n_phi), lifted successors `y` (n - 1, n_z), which are `known`."""

    phi: FloatArray
    y: FloatArray
    known: BoolArray
    theta0: FloatArray
    x_scale: FloatArray

    @staticmethod
    def of(model: KoopmanModel, record: Record) -> LiftedPairs:
        """Lift all samples of a record with a model of the paper's form."""
        scaled = model.scaling.scale_x(record.x)
        finite = np.isfinite(scaled).all(axis=1) & record.learnable
        features = np.full((len(record), model.n_z - 3), np.nan)
        for row in np.flatnonzero(finite):
            features[row] = model.lifting(scaled[row].astype(np.float32))
        z = np.hstack([scaled, features])
        phi = np.hstack([z, model.scaling.scale_u(record.u)])[:-1]
        both = finite[:-1] & finite[1:] & (record.episode[1:] == record.episode[:-1])
        known = both & np.isfinite(phi).all(axis=1)
        return LiftedPairs(phi, z[1:], known, model.theta0, model.scaling.x_scale)

    def errors(self, window: int, cut: float) -> OnlineErrors:
        """Adapt with the paper's method over all known pairs, in order."""
        method = PaperSWLS(self.theta0, OnlineSettings("swls", window=window), cut)
        shape = (self.phi.shape[0], 3)
        before, after = np.full(shape, np.nan), np.full(shape, np.nan)
        constant = self.y[:, :3] - self.phi @ self.theta0[:3].T
        for k in np.flatnonzero(self.known):
            before[k] = self.y[k, :3] - method.theta[:3] @ self.phi[k]
            method.update(self.phi[k], self.y[k])
            after[k] = self.y[k, :3] - method.theta[:3] @ self.phi[k]
        constant = np.where(self.known[:, None], constant, np.nan)
        scale = self.x_scale
        return OnlineErrors(constant * scale, before * scale, after * scale, method.failures)


def rmse(errors: FloatArray) -> FloatArray:
    """Return the root mean square (3,) over the finite rows, in km/h, km/h and deg/s."""
    return np.asarray(np.sqrt(np.nanmean(np.square(errors), axis=0)) * REPORT_SCALE)


def chosen_settings(pairs: LiftedPairs) -> tuple[int, float]:
    """Return window and cut with the smallest innovations (geometric mean over the channels)."""
    every = [(window, cut) for window in WINDOWS for cut in CUTS]
    scores = [float(np.log(rmse(pairs.errors(*each).innovation)).mean()) for each in every]
    return every[int(np.argmin(scores))]


@dataclass(frozen=True)
class Reading:
    """
    One way to read the paper: RMSE and Max (3,) of ALDK and ALDK-SWLS, km/h, km/h, deg/s.

    `kind` is `INNOVATION` or `A_POSTERIORI`; `chosen`: window and cut are the chosen ones.
    """

    epochs: int
    window: int
    cut: float
    chosen: bool
    kind: str
    constant_rmse: FloatArray
    rmse: FloatArray
    worst: FloatArray

    @property
    def reduction(self) -> FloatArray:
        """By how many per cent the RMSE is below that of ALDK, (3,)."""
        return np.asarray(100.0 * (1.0 - self.rmse / self.constant_rmse))

    @property
    def reproduces(self) -> bool:
        """Whether each reduction is at least the printed one."""
        return bool((self.reduction >= printed_reduction()).all())

    def as_json(self) -> dict[str, Any]:
        """Return the reading for JSON, in km/h, km/h and deg/s."""
        return {
            "epochs": self.epochs, "window": self.window, "cut": self.cut, "chosen": self.chosen,
            "errors": self.kind, "aldk_rmse": self.constant_rmse.tolist(),
            "rmse": self.rmse.tolist(), "max": self.worst.tolist(),
            "reduction_percent": self.reduction.tolist(), "reproduces": self.reproduces,
        }  # fmt: skip


def printed_reduction() -> FloatArray:
    """Return by how many per cent the paper prints ALDK-SWLS below ALDK, nominal test, (3,)."""
    return np.asarray(100.0 * effect(cases.NOMINAL))


def study(
    fit: Fit,
    epochs: Sequence[int],
    train: Record,
    test: Record,
    default: tuple[int, float],
    tell: Tell,
) -> list[Reading]:
    """
    Return all readings for models trained with these numbers of epochs.

    `fit` returns the model of a number of epochs and reports its progress, a share;
    `default`: window and cut of `adk bench paper`.
    """
    validation = train.rows(slice(int(VALIDATED_FROM * len(train)), None))
    rows = cases.rows_of(test, 1)[0]
    result = []
    done, total = 0, sum(epochs)
    for number_of in epochs:

        def within(share: float, done: int = done, number_of: int = number_of) -> None:
            tell((done + share * number_of) / total)

        model = fit(number_of, within)
        done += number_of
        best = chosen_settings(LiftedPairs.of(model, validation))
        pairs = LiftedPairs.of(model, test)
        for chosen, (window, cut) in ((False, default), (True, best)):
            errors = pairs.errors(window, cut)
            for kind in (INNOVATION, A_POSTERIORI):
                own = errors.of(kind)[rows]
                worst = np.nanmax(np.abs(own), axis=0) * REPORT_SCALE
                result.append(
                    Reading(
                        number_of, window, cut, chosen, kind,
                        rmse(errors.constant[rows]), rmse(own), worst,
                    )
                )  # fmt: skip
    return result


def epochs_of(trained: int) -> Iterator[int]:
    """Yield the numbers of epochs to compare, in order, that of the run among them."""
    yield from sorted({*(x for x in EPOCHS if x < trained), trained})
