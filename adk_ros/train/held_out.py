# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Held-out scores: model against naive predictors by horizon and channel, and why it is worse."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from adk_ros.model.adaptation.online_methods import OnlineSettings
from adk_ros.model.evaluation import Rollouts, rollout_record
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.training_range import TrainingRange
from adk_ros.numerics.arrays import BoolArray, FloatArray
from adk_ros.signals.channels import STATE_NAMES, TICK_NS, Record
from adk_ros.signals.score import (
    HORIZON_STEPS,
    REPORT_SCALE,
    ErrorTable,
    best_naive,
    naive_predictions,
    pool,
    reference_noise,
    score,
)

MODEL, HELD_INPUTS = "model", "model, commands held"
TIE = 0.995
"""The model is better than the naive predictors below this RMSE ratio: 0.5 % is a tie."""
_AHEAD = HORIZON_STEPS[-1]
_UNIT = ("km/h", "km/h", "deg/s")


@dataclass(frozen=True)
class HeldOutScores:
    """
    Scores by predictor name over the same starts.

    `lost`: "channel at horizon" -> why the model is not better than the best naive predictor;
    `rollouts`: what the scores are computed from, one for each record with a start.
    """

    scores: dict[str, ErrorTable]
    lost: dict[str, str]
    rollouts: list[Rollouts]

    @property
    def ratio(self) -> FloatArray:
        """RMSE of the model over the best naive one, (steps, 3), future commands known."""
        return self.scores[MODEL].rmse / np.maximum(self.naive, 1e-12)

    @property
    def ratio_held(self) -> FloatArray:
        """RMSE ratio (steps, 3) with commands held constant, as the node publishes its horizon."""
        return self.scores[HELD_INPUTS].rmse / np.maximum(self.naive, 1e-12)

    @property
    def naive(self) -> FloatArray:
        """RMSE of the best naive predictor at each horizon and channel, (steps, 3)."""
        return best_naive({k: v for k, v in self.scores.items() if k not in (MODEL, HELD_INPUTS)})

    def write_csv(self, path: Path) -> None:
        """Write `predictor,channel,horizon_s,rmse,max` rows, SI units."""
        with path.open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(["predictor", "channel", "horizon_s", "rmse", "max"])
            for name, item in self.scores.items():
                for c, channel in enumerate(STATE_NAMES):
                    for i, step in enumerate(item.steps):
                        cell = (f"{v[i, c]:.6g}" for v in (item.rmse, item.worst))
                        writer.writerow([name, channel, f"{step * TICK_NS * 1e-9:g}", *cell])

    def as_json(self) -> dict[str, Any]:
        """Return the scores, SI, by predictor, channel and horizon; None if not measured."""
        steps = self.scores[MODEL].steps
        return {
            "horizons_s": [round(s * TICK_NS * 1e-9, 3) for s in steps],
            "starts": self.scores[MODEL].count,
            "predictors": {
                name: {
                    channel: {
                        "rmse": _values(item.rmse[:, c]),
                        "max": _values(item.worst[:, c]),
                    }
                    for c, channel in enumerate(STATE_NAMES)
                }
                | {"diverged": item.diverged}
                for name, item in self.scores.items()
            },
            "ratio_to_best_naive": {
                channel: _values(self.ratio[:, c]) for c, channel in enumerate(STATE_NAMES)
            },
            "ratio_to_best_naive_commands_held": {
                channel: _values(self.ratio_held[:, c]) for c, channel in enumerate(STATE_NAMES)
            },
            "geometric_mean_ratio": float(np.exp(np.nanmean(np.log(self.ratio)))),
            "lost_cells": self.lost,
        }


def _values(column: FloatArray) -> list[float | None]:
    """Return a column of a table; None for what is not measured."""
    return [float(v) if np.isfinite(v) else None for v in column]


def score_held_out(
    model: KoopmanModel,
    parts: list[tuple[Record, BoolArray | None]],
    known: TrainingRange | None = None,
    online: OnlineSettings | None = None,
    stride: int = 4,
    progress: Callable[[int, int], None] | None = None,
) -> HeldOutScores | None:
    """
    Score a model on parts of records: a mask (n,) of the rows, or None for all.

    `known`: range of the training data, to explain losses outside of it. Return None if no part
    has a start with its whole horizon.
    """
    rollouts = []
    for number, (record, scored) in enumerate(parts):

        def report(done: int, total: int, number: int = number) -> None:
            if progress is not None:
                progress(number * total + done, len(parts) * total)

        rolled = rollout_record(model, record, online, scored, _AHEAD, stride, progress=report)
        if rolled.rows.size:
            rollouts.append(rolled)
    if not rollouts:
        return None
    by_name: dict[str, list[ErrorTable]] = {}
    common: set[str] | None = None
    for rolled in rollouts:
        predictions = {MODEL: rolled.predicted, HELD_INPUTS: rolled.held_input_predictions}
        predictions |= naive_predictions(rolled.record, rolled.rows, _AHEAD)
        common = set(predictions) if common is None else common & set(predictions)
        for name, predicted in predictions.items():
            by_name.setdefault(name, []).append(score(rolled.record, rolled.rows, predicted))
    scores = {name: pool(items) for name, items in by_name.items() if name in (common or set())}
    result = HeldOutScores(scores, {}, rollouts)
    for step, channel in np.argwhere(result.ratio >= TIE):
        horizon = HORIZON_STEPS[step] * TICK_NS * 1e-9
        cell = f"{STATE_NAMES[channel]} at {horizon:g} s"
        result.lost[cell] = _why(result, int(step), int(channel), known)
    return result


def _why(result: HeldOutScores, step: int, channel: int, known: TrainingRange | None) -> str:
    naive, ratio = float(result.naive[step, channel]), float(result.ratio[step, channel])
    text = f"{ratio:.2f} times the best naive predictor's RMSE"
    floors = [reference_noise(rolled.record)[channel] for rolled in result.rollouts]
    floor = float(np.nanmedian(floors))
    if naive < 2.0 * floor:
        shown = f"{floor * REPORT_SCALE[channel]:.2g} {_UNIT[channel]}"
        return f"{text}; both are within twice the measurement's noise ({shown})"
    if known is not None:
        beyond = known.share_beyond([(r.record, r.rows) for r in result.rollouts])
        if beyond:
            name, share = max(beyond.items(), key=lambda item: item[1])
            beyond_text = f"in {100 * share:.0f} % of the rollouts {name} was beyond"
            return f"{text}; {beyond_text} the training data"
    errors = np.concatenate(
        [
            r.predicted[:, HORIZON_STEPS[step] - 1, channel]
            - r.record.x_ref[r.rows + HORIZON_STEPS[step], channel]
            for r in result.rollouts
        ]
    )
    share = float(np.sort(errors**2)[-max(1, errors.size // 20) :].sum() / np.sum(errors**2))
    if share > 0.5:
        return f"{text}; {100 * share:.0f} % of the squared error comes from 5 % of the rollouts"
    return f"{text}; the error is spread evenly over the rollouts"
