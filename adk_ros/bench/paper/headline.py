# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The headline table: RMSE of each predictor over that of the best naive one, by horizon."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

from adk_ros.bench.paper.cases import CLEAN
from adk_ros.bench.paper.paper_tables import Table
from adk_ros.bench.paper.predictors import (
    ADK_ROS,
    ALDK,
    DK,
    LINEAR_ADAPTED,
    MF,
    MF_CHOSEN,
    MF_PLAIN,
    MF_TUNED,
    NAIVE,
    ORACLE,
    PYKOOP,
    PYKOOPMAN,
    SWLS,
)
from adk_ros.bench.paper.ratios import best_cells, geometric_means, lost_tests, mean_text
from adk_ros.bench.paper.scores import HORIZONS, ScoreTable, divergence_limits

ROWS = (
    *NAIVE, LINEAR_ADAPTED, DK, ALDK, SWLS, MF_PLAIN, MF, MF_TUNED, MF_CHOSEN, PYKOOP, PYKOOPMAN,
    ADK_ROS, ORACLE,
)  # fmt: skip
EXACT = "exact"
NOT_RUN = "not run"


@dataclass(frozen=True)
class Headline:
    """
    Geometric means over tests and channels of the RMSE over that of the best naive predictor.

    `tables`: one per variant, as text. `means`, `lost`: by (predictor, variant, horizon) the mean,
    and the number of tests in which at least one prediction diverged.
    """

    lead: str
    tables: list[Table]
    means: dict[tuple[str, str, int], float]
    lost: dict[tuple[str, str, int], int]

    def markdown(self) -> str:
        """Return the lead and the tables in Markdown."""
        return "\n".join([f"{self.lead}\n", *(table.markdown() for table in self.tables)])

    def write(self, folder: Path) -> None:
        """Write `headline.md`, and `headline.csv` with one line per predictor and variant."""
        (folder / "headline.md").write_text(self.markdown())
        with (folder / "headline.csv").open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow([
                "variant", "predictor", *HORIZONS, *(f"tests diverged {h}" for h in HORIZONS),
            ])  # fmt: skip
            for variant, name in sorted(
                {(v, n) for n, v, _ in self.lost}, key=lambda k: (k[0], ROWS.index(k[1]))
            ):
                keys = [(name, variant, i) for i in range(len(HORIZONS))]
                means = [f"{self.means[k]:.5g}" if k in self.means else "" for k in keys]
                writer.writerow([variant, name, *means, *(self.lost[k] for k in keys)])


def headline(board: ScoreTable, setting: str = "") -> Headline:
    """Return the headline; `setting` describes the run in a sentence."""
    means = {
        (name, *key): value for name in ROWS for key, value in geometric_means(board, name).items()
    }
    lost = {
        (name, *key): count
        for name in ROWS if board.has(name)
        for key, count in lost_tests(board, name).items()
    }  # fmt: skip
    tables = [_table(board, variant, means, lost) for variant in board.variants()]
    lead = (
        f"RMSE divided by that of the best naive predictor (persistence, straight line, IMU "
        f"integration) for the same test, channel and horizon, with future commands known: "
        f"geometric mean over {len(board.tests())} tests and three channels. Below 1 is better "
        f"than every naive predictor; the best value in each column is bold. The oracle is "
        f"the simulated car itself, started from the same (noisy) samples: the best result "
        f'without filtering. "> a (n)" is a lower bound: predictions diverged in n tests and '
        f"count as an error of {divergence_limits()}."
    )
    return Headline(f"{lead} {setting}".strip(), tables, means, lost)


def _table(
    board: ScoreTable, variant: str, means: dict[tuple[str, str, int], float],
    lost: dict[tuple[str, str, int], int],
) -> Table:  # fmt: skip
    rows = []
    names = [n for n in ROWS if board.has(n) or n in (PYKOOP, PYKOOPMAN)]
    for name in names:
        if not board.has(name):
            rows.append([name, *[NOT_RUN] * len(HORIZONS)])
            continue
        keys = [(name, variant, i) for i in range(len(HORIZONS))]
        cells = [mean_text(means.get(key), lost[key]) for key in keys]
        if name == ORACLE and variant == CLEAN:
            cells = [EXACT] * len(HORIZONS)
        rows.append([name, *cells])
    columns = [
        {
            name: means[name, variant, i] for name in names
            if (name, variant, i) in means and not lost[name, variant, i]
        }
        for i in range(len(HORIZONS))
    ]  # fmt: skip
    title = "From noisy measurements" if variant != CLEAN else "From exact measurements (clean)"
    header = ["predictor", *HORIZONS]
    strong = tuple(i for i, name in enumerate(names) if name == ADK_ROS)
    return Table(f"headline_{variant}", title, header, rows, strong, best_cells(names, columns))
