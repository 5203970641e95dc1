# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Figure of a manoeuvre: lateral error along the path, by car, controller and prediction model."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import numpy as np
from matplotlib import pyplot as plt

from adk_ros.bench.control.reference_path import ReferencePath
from adk_ros.bench.control.scores import ADAPTED, DYNAMIC, FROZEN, KINEMATIC, PLANT, ScoredRun
from adk_ros.files.pages.figure_style import BLACK, BLUE, GREY, ORANGE, VERMILION

_STYLES = {
    KINEMATIC: (GREY, ":"), DYNAMIC: (ORANGE, "--"), FROZEN: (VERMILION, "-"),
    ADAPTED: (BLUE, "-"), PLANT: (BLACK, "-."),
}  # fmt: skip
_LEAST_RANGE_M, _MOST_RANGE_M = 0.1, 1.0


def write_figure(runs: Sequence[ScoredRun], path: ReferencePath, file: Path) -> None:
    """Draw the runs of the first seed along `path`; hatched: beyond the tolerance of a gate."""
    seed = runs[0].seed
    shown = [run for run in runs if run.manoeuvre == path.name and run.seed == seed]
    cars = list(dict.fromkeys(run.car for run in shown))
    controllers = list(dict.fromkeys(run.controller for run in shown))
    figure, grid = plt.subplots(
        len(cars), len(controllers), figsize=(5.0 * len(controllers), 1.9 * len(cars) + 0.6),
        squeeze=False, sharex=True, sharey="row", layout="constrained",
    )  # fmt: skip
    for row, car in enumerate(cars):
        for axes, controller in zip(grid[row], controllers, strict=True):
            here = [r for r in shown if (r.car, r.controller) == (car, controller)]
            for run in here:
                colour, line = _STYLES[run.model]
                axes.plot(run.s - path.begin, run.lateral, line, color=colour, label=run.model)
            s = here[0].s
            tolerance = path.tolerance_at(s)
            for sign in (-1.0, 1.0):
                axes.fill_between(
                    s - path.begin, sign * tolerance, sign * 9.0, where=np.isfinite(tolerance),
                    facecolor="none", edgecolor=GREY, hatch="///", linewidth=0.0,
                )  # fmt: skip
            axes.set_title(f"{car}, {controller}", fontsize=9)
        of_ours = [np.abs(r.lateral).max() for r in shown if r.car == car and r.model == ADAPTED]
        reach = 2.5 * max(of_ours, default=_LEAST_RANGE_M)
        reach = min(max(reach, _LEAST_RANGE_M), _MOST_RANGE_M)
        grid[row][0].set_ylim(-reach, reach)
        grid[row][0].set_ylabel("lateral error, m")
    for axes in grid[-1]:
        axes.set_xlabel("distance along the path, m")
    handles, labels = grid[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), fontsize=9)
    figure.savefig(file, dpi=110)
    plt.close(figure)
