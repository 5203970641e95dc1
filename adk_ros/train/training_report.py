# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The training report: a page that stands by itself, beside the model it is about."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from adk_ros.signals.channels import STATE_NAMES, TICK_NS
from adk_ros.signals.score import REPORT_SCALE
from adk_ros.train.held_out import MODEL, TIE, HeldOutScores
from adk_ros.train.report_figures import curve_figure, horizon_figure, prediction_figure
from adk_ros.train.training_run import TrainingResult

_UNITS = ("km/h", "km/h", "deg/s")


FILES = ("report.html", "held_out.json", "training.png", "horizon.png", "prediction.png")
"""All that a report consists of."""


def remove_report(out: Path) -> None:
    """Remove the report of an earlier training: it would not be about the model beside it."""
    for name in FILES:
        (out / name).unlink(missing_ok=True)


def write_report(run: TrainingResult, out: Path) -> Path:
    """Write `report.html`, its figures as PNG and `held_out.json` into `out`; return the page."""
    remove_report(out)
    figures: dict[str, Path] = {}
    if run.trained is not None and run.trained.curve:
        figures["Training"] = out / "training.png"
        curve_figure(run.trained.curve, run.trained.best_step, figures["Training"])
    if run.test is not None:
        figures["Error against horizon, held-out data"] = out / "horizon.png"
        horizon_figure(run.test, out / "horizon.png")
        figures["A stretch of held-out data"] = out / "prediction.png"
        prediction_figure(run.test, out / "prediction.png")
        (out / "held_out.json").write_text(json.dumps(run.test.as_json(), indent=2) + "\n")
    environment = Environment(
        loader=PackageLoader("adk_ros.train"), autoescape=True, undefined=StrictUndefined
    )
    page = environment.get_template("report.html.j2").render(
        name=out.name,
        facts=run.facts,
        sentence=_sentence(run.test),
        rows=_rows(run.test) if run.test else [],
        names=list(run.test.scores) if run.test else [],
        lost=run.test.lost if run.test else {},
        figures={
            title: base64.b64encode(path.read_bytes()).decode() for title, path in figures.items()
        },
    )
    path = out / "report.html"
    path.write_text(page)
    return path


def _sentence(test: HeldOutScores | None) -> str:
    if test is None:
        return "Nothing was held out that is long enough to score."
    ratio = test.ratio
    better, held = int((ratio < TIE).sum()), int((test.ratio_held < TIE).sum())
    second = test.scores[MODEL].steps.index(40)
    return (
        f"Given the commands, better than the best naive predictor in {better} of {ratio.size} "
        f"cells of held-out data: 1 s ahead its RMSE is {ratio[second, 0]:.2f}, "
        f"{ratio[second, 1]:.2f} and {ratio[second, 2]:.2f} of the best naive one's for v_x, v_y "
        "and yaw rate. With the commands held, as the node publishes its horizon, better in "
        f"{held}."
    )


def _rows(test: HeldOutScores) -> list[dict[str, Any]]:
    rows = []
    steps = test.scores[MODEL].steps
    for c, channel in enumerate(STATE_NAMES):
        for i, step in enumerate(steps):
            rows.append(
                {
                    "channel": f"{channel} ({_UNITS[c]})" if i == 0 else "",
                    "horizon": f"{step * TICK_NS * 1e-9:g} s",
                    "cells": [
                        f"{s.rmse[i, c] * REPORT_SCALE[c]:.4g}" for s in test.scores.values()
                    ],
                    "ratio": f"{test.ratio[i, c]:.2f}",
                    "ratio_held": f"{test.ratio_held[i, c]:.2f}",
                    "lost": bool(test.ratio[i, c] >= TIE),
                    "first": i == 0,
                }
            )
    return rows
