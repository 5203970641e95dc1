# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Criteria and tables of `adk bench learned`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

import numpy as np

from adk_ros.bench.learned.learned_bench import HORIZONS_S, RecordingResult
from adk_ros.bench.learned.learned_models import DEEP_PACEJKA_GIVEN, PACKAGES
from adk_ros.bench.paper.predictors import ADK_ROS
from adk_ros.bench.real.scores import Criterion
from adk_ros.signals.channels import STATE_NAMES
from adk_ros.signals.score import NAIVE_PREDICTORS

MIN_AHEAD = 0.9
"""Share of (recording, channel, horizon) with the smaller RMSE: by choice, as in `bench paper`."""


def criteria(results: Sequence[RecordingResult]) -> list[Criterion]:
    """
    Return one criterion for each learned model, and one for all.

    Of a model's two rollouts the better one counts, in each combination. A model that is given a
    measured future speed is compared, but not part of "all".
    """
    found = []
    models = [name for name in PACKAGES if any(name in result.rmse for result in results)]
    everybody = [name for name in models if name != DEEP_PACEJKA_GIVEN]
    for name in models:
        parts = [r.mean(ADK_ROS) < r.best(name) for r in results if name in r.rmse]
        found.append(_criterion(f"ahead of {name}", np.concatenate(parts)))
    parts = [
        r.mean(ADK_ROS) < np.min([r.best(n) for n in everybody if n in r.rmse], axis=0)
        for r in results if any(n in r.rmse for n in everybody)
    ]  # fmt: skip
    if parts:
        found.append(_criterion("ahead of the best of them", np.concatenate(parts)))
    return found


def _criterion(name: str, ahead: np.ndarray) -> Criterion:
    share = float(ahead.mean())
    return Criterion(name, share, f"at least {MIN_AHEAD:g}", share >= MIN_AHEAD, ahead.size)


def ratio_rows(result: RecordingResult, channel: int) -> list[tuple[str, list[float]]]:
    """Return the RMSE relative to the best naive predictor by horizon, of each predictor."""
    naive = result.naive()[:, channel]
    names = [name for name in result.rmse if name not in NAIVE_PREDICTORS]
    return [(name, list(result.mean(name)[:, channel] / naive)) for name in names]


def as_dict(results: Sequence[RecordingResult]) -> dict[str, object]:
    """Return what `adk bench learned --json` prints."""
    return {
        "kind": "bench learned",
        "horizons_s": list(HORIZONS_S),
        "channels": list(STATE_NAMES),
        "recordings": [_recording(result) for result in results],
        "criteria": [asdict(item) for item in criteria(results)],
    }


def _recording(result: RecordingResult) -> dict[str, object]:
    return {
        "name": result.name,
        "starts": result.count,
        "rmse_si": {
            name: [table.tolist() for table in tables] for name, tables in result.rmse.items()
        },
        "effort": {
            name: [asdict(item) for item in items] for name, items in result.effort.items()
        },
        "trainings": [
            {
                "model": item.model, "settings": item.settings, "epochs": len(item.losses),
                "best_epoch": item.best_epoch, "within_5_percent_at": item.converged_epoch,
                "validation_losses": item.losses.tolist(), "seconds": item.seconds,
            }
            for items in result.trainings.values() for item in items
        ],
    }  # fmt: skip
