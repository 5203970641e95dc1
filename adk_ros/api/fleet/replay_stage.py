# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Stage `replay`: errors of a model on a recording, and when the model was most surprised."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from adk_ros.api.fleet.index_stage import file_hash
from adk_ros.bags.recording import RecordingOptions
from adk_ros.fleet.stage import hash_of
from adk_ros.fleet.training.blocks import HARD_M_S2, speed_classes
from adk_ros.numerics.arrays import BoolArray, FloatArray
from adk_ros.signals.channels import STATE_NAMES, TICK_NS
from adk_ros.signals.score import HORIZON_STEPS

if TYPE_CHECKING:
    from adk_ros.api.replay import ReplayResult

_UNITS = dict(zip(STATE_NAMES, ("m/s", "m/s", "rad/s"), strict=True))
MINUTES = 5
"""Minutes that are listed, the most surprising first."""
_LEAST_S = 10.0
"""s of predictions in a minute that is listed: the last one may have but a few. By choice."""


@dataclass(frozen=True)
class ReplayStage:
    """
    What `adk replay` scores.

    Rows by `kind`: `error` (RMSE by channel, horizon and driving condition; the mean of squares
    over recordings is weighted with details.count), `baseline` (RMSE of the best naive predictor),
    `surprise` (minutes with the largest normalised innovation; `value` is the root mean of the
    innovation squared over its predicted variance, 1 if the model's covariance is right).
    `options`: topics and sensor configuration; by default that of the model.
    """

    model: str
    options: RecordingOptions | None = None
    name: str = "replay"

    @property
    def model_hash(self) -> str:
        """Hash of the model folder."""
        return file_hash(self.model)

    @property
    def inputs_hash(self) -> str:
        """Hash of the model, topics and sensor configuration."""
        return self.inputs_of_model(self.model_hash)

    def inputs_of_model(self, model_hash: str) -> str:
        """Return `inputs_hash`, given that of the model."""
        return hash_of([model_hash, self.options and asdict(self.options)])

    @property
    def shared_paths(self) -> tuple[str, ...]:
        """Folder of the model."""
        return (self.model,)

    def run(self, path: Path, recording: str) -> list[dict[str, Any]]:
        """Return the rows of a recording."""
        from adk_ros.api.replay import replay

        result = replay(path, self.model, options=self.options)
        rows = [*error_rows(result), *surprise_rows(result)]
        rows += [
            {"kind": "warning", "finding": "replay", "text": text} for text in result.warnings
        ]
        return rows


def error_rows(result: ReplayResult) -> list[dict[str, Any]]:
    """Return the RMSE of the model by channel, horizon and driving condition, and the baseline."""
    from adk_ros.train.held_out import MODEL

    if result.held_out is None:
        return []
    rows: list[dict[str, Any]] = []
    rollouts = result.held_out.rollouts[0]
    start = rollouts.record.x_ref[rollouts.rows]
    lateral = np.abs(start[:, 0] * start[:, 2])
    conditions: dict[str, BoolArray] = {"": np.ones(len(start), dtype=bool)}
    conditions |= speed_classes(start[:, 0])
    conditions[f"lateral acceleration above {HARD_M_S2:g} m/s²"] = lateral > HARD_M_S2
    for step in HORIZON_STEPS:
        ahead = rollouts.rows + step
        error = rollouts.record.x_ref[ahead] - rollouts.predicted[:, step - 1]
        for condition, chosen in conditions.items():
            rows += _rmse_rows(error[chosen], step, condition)
    steps = result.held_out.scores[MODEL].steps
    for at, step in enumerate(steps):
        for channel, value in zip(STATE_NAMES, result.held_out.naive[at], strict=True):
            if np.isfinite(value):
                rows.append(
                    {
                        "kind": "baseline",
                        "finding": "rmse",
                        "channel": channel,
                        "horizon_s": round(step * TICK_NS * 1e-9, 3),
                        "condition": "",
                        "value": float(value),
                        "unit": _UNITS[channel],
                    }
                )
    return rows


def _rmse_rows(error: FloatArray, step: int, condition: str) -> list[dict[str, Any]]:
    known = error[np.isfinite(error).all(axis=1)]
    if not len(known):
        return []
    rmse = np.sqrt(np.mean(known**2, axis=0))
    return [
        {
            "kind": "error",
            "finding": "rmse",
            "channel": channel,
            "horizon_s": round(step * TICK_NS * 1e-9, 3),
            "condition": condition,
            "value": float(value),
            "unit": _UNITS[channel],
            "details": {"count": len(known)},
        }
        for channel, value in zip(STATE_NAMES, rmse, strict=True)
    ]


def surprise_rows(result: ReplayResult) -> list[dict[str, Any]]:
    """Return the minutes with the largest normalised innovations, the largest first."""
    if not result.predictions:
        return []
    innovation = result.innovations
    # The innovation of a prediction belongs to the sample it starts from; its variance is that of
    # the prediction before.
    variance = np.array([np.diagonal(p.covariance) for p in result.predictions])
    variance = np.concatenate([np.full((1, 3), np.nan), variance[:-1]])
    origin_ns = np.array([p.origin_ns for p in result.predictions], dtype=np.int64)
    time_s = (origin_ns - result.recording.content.start_ns) * 1e-9
    squares = innovation**2 / variance
    known = np.isfinite(squares).all(axis=1)
    minute = (time_s // 60.0).astype(np.int64)
    rows = []
    for number in np.unique(minute[known]):
        inside = squares[known & (minute == number)]
        if len(inside) * TICK_NS * 1e-9 < _LEAST_S:
            continue
        by_channel = np.sqrt(inside.mean(axis=0))
        rows.append(
            {
                "kind": "surprise",
                "finding": f"minute {number}",
                "channel": STATE_NAMES[int(np.argmax(by_channel))],
                "value": float(np.sqrt(inside.mean())),
                "unit": "standard deviations",
                "details": {
                    "from_s": 60.0 * float(number),
                    "samples": len(inside),
                    "by_channel": dict(zip(STATE_NAMES, by_channel.tolist(), strict=True)),
                },
            }
        )
    return sorted(rows, key=lambda row: -float(str(row["value"])))[:MINUTES]
