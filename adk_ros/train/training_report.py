# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The model report: a self-contained HTML page in the model folder, with figures and scores."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from adk_ros.files.pages.page import embed, render_page
from adk_ros.files.pages.provenance import Provenance
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.finite import number_or_dash
from adk_ros.signals.channels import STATE_NAMES, TICK_NS
from adk_ros.train.held_out import MODEL, TIE, HeldOutScores
from adk_ros.train.report_figures import (
    REPORT_UNITS,
    curve_figure,
    horizon_figure,
    prediction_figure,
    predictor_label,
)
from adk_ros.train.training_run import TrainingResult

FILES = ("report.html", "held_out.json", "training.png", "horizon.png", "prediction.png")
"""All files of a report."""
_ONE_SECOND = 40
"""Steps of 25 ms."""
_KINDS = {
    "default": "default training",
    "dk": "the paper's deep Koopman model (DK)",
    "aldk": "the paper's deep Koopman model with acceleration loss (ALDK)",
}
_SETTINGS = {
    "history": "past samples, 25 ms apart",
    "hidden": "width of the hidden layers",
    "features": "learned features",
    "steps": "training steps",
    "batch": "sequences per training step",
    "learning_rate": "peak learning rate",
    "weight_decay": "weight decay of AdamW",
    "short_steps": "rollout length in the first stage, in 25 ms ticks",
    "long_steps": "rollout length in the second stage, in 25 ms ticks",
    "short_share": "first stage as a share of the training steps",
    "noise": "noise added to past states, in standard deviations of the increment per tick",
    "quadratic": "quadratic features, if they fit; width and features are then 3/4 of the above",
    "speed_augmentation": "quadratic features fitted to rows at higher speeds as well",
    "single_track": "single-track model outside the range of the data, if it predicts them",
    "patience": "validations without improvement before early stopping",
    "validate_every": "training steps between validations",
    "seed": "random seed",
    "device": "requested device",
    "acceleration": "acceleration loss",
    "epochs": "epochs",
    "window": "length of the training windows, in 25 ms ticks",
}
"""Meaning of each setting on the page; the names are those of the manifest."""


def remove_report(out: Path) -> None:
    """Remove the report of an earlier training, which describes another model."""
    for name in FILES:
        (out / name).unlink(missing_ok=True)


def write_report(run: TrainingResult, out: Path, *, provenance: Provenance | None = None) -> Path:
    """Write `report.html`, figures and `held_out.json` into `out`; return the page's path."""
    remove_report(out)
    figures = {}
    if run.test is not None:
        alt = "RMSE of the model and the naive predictors over the horizon, by channel"
        horizon_figure(run.test, out / "horizon.png")
        figures["horizon"] = embed(out / "horizon.png", alt)
        alt = "Measured and predicted (1 s ahead) state over time on held-out data, and the errors"
        prediction_figure(run.test, out / "prediction.png")
        figures["prediction"] = embed(out / "prediction.png", alt)
        (out / "held_out.json").write_text(json.dumps(run.test.as_json(), indent=2) + "\n")
    if run.trained is not None and run.trained.curve:
        curve_figure(run.trained.curve, run.trained.best_step, out / "training.png")
        alt = "Training and validation loss over the training steps, with the selected checkpoint"
        figures["training"] = embed(out / "training.png", alt)
    text = render_page(
        "adk_ros.train",
        "report.html.j2",
        provenance,
        name=out.name,
        facts=run.facts,
        meanings=_SETTINGS,
        kind=_KINDS.get(run.facts["kind"], run.facts["kind"]),
        sentence=_sentence(run.test),
        rows=_rows(run.test) if run.test else [],
        predictors=[predictor_label(name) for name in run.test.scores] if run.test else [],
        not_better=run.test.lost if run.test else {},
        unaugmented=run.trained.unaugmented_text if run.trained else "",
        without_single_track=run.facts["settings"].get("single_track", False)
        and not run.facts["single_track"],
        takeovers=[takeover.text for takeover in run.model.fallback.takeovers()],
        figures=figures,
    )
    path = out / "report.html"
    path.write_text(text, encoding="utf-8")
    return path


def _sentence(test: HeldOutScores | None) -> str:
    if test is None:
        return "The held-out data are too short to score."
    known, held = test.ratio, test.ratio_held
    second = known[test.scores[MODEL].steps.index(_ONE_SECOND)]
    return (
        f"With future commands known, the model is better than every naive predictor in "
        f"{int((known < TIE).sum())} of {int(np.isfinite(known).sum())} (channel, horizon) "
        "combinations on held-out data, from one 25 ms tick to 2 s. At 1 s its RMSE over that of "
        f"the best naive predictor is {_ratios_text(second)}. "
        "With commands held constant, as in the published horizon of the live node, it is better "
        f"in {int((held < TIE).sum())}."
    )


def _ratios_text(ratios: FloatArray) -> str:
    """Return the ratios (3,) of the channels that are measured."""
    names = ("v_x", "v_y", "yaw rate")
    known = [
        f"{x:.2f} for {name}" for name, x in zip(names, ratios, strict=True) if math.isfinite(x)
    ]
    return f"{', '.join(known[:-1])} and {known[-1]}" if len(known) > 1 else "".join(known)


def _rows(test: HeldOutScores) -> list[dict[str, Any]]:
    """Return one row per channel and horizon; ratios are pairs of text and whether it is < 1."""
    rows = []
    for c in range(len(STATE_NAMES)):
        for i, step in enumerate(test.scores[MODEL].steps):
            ratios = [table[i, c] for table in (test.ratio, test.ratio_held)]
            rows.append(
                {
                    "channel": REPORT_UNITS.labels[c] if i == 0 else "",
                    "horizon": f"{step * TICK_NS * 1e-9:g} s",
                    "errors": [
                        number_or_dash(s.rmse[i, c] * REPORT_UNITS.scale[c], ".4g")
                        for s in test.scores.values()
                    ],
                    "ratios": [
                        (number_or_dash(ratio, ".2f"), bool(ratio < TIE)) for ratio in ratios
                    ],
                }
            )
    return rows
