# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print how a model predicts on a road that is banked throughout, clean and noisy.

    adk train bags/handling --out model
    python scripts/banked_road.py model [--peers]

Ratios of the RMSE of v_y and of the yaw rate to that of the best naive predictor, with future
commands known, on a closed course that is level or banked by 0.05 to 0.15 to one side, which the
model has not seen. With `--peers` also those of pykoop and pykoopman (`make peers`), fitted to the
level course with another seed.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from adk_ros.bench.paper.baseline_libraries import Peers
from adk_ros.bench.paper.cases import noisy
from adk_ros.model import artefact
from adk_ros.model.evaluation import rollout_record
from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.plant.environment.road import RoadPatch
from adk_ros.plant.scenario.scenario_file import load_scenario
from adk_ros.plant.scenario.simulate import simulate
from adk_ros.signals.channels import Record
from adk_ros.signals.score import HORIZON_STEPS, best_naive, naive_predictions, score

COURSE = "xyz_edges"
SECONDS, SETTLED, STRIDE = 150.0, 1200, 8
AHEAD = HORIZON_STEPS[-1]


def drive(bank: float, seed: int) -> Record:
    """Return the truth of a drive on the course, banked throughout."""
    scenario = load_scenario(COURSE)
    if bank:
        length = simulate(scenario, seed, 1.0).route.length
        place = RoadPatch(start=0.0, end=length, bank=bank, blend=1.0)
        scenario = scenario.model_copy(update={"places": [*scenario.places, place]})
    return simulate(scenario, seed, SECONDS).truth()


def ratios(record: Record, rows: IntArray, predicted: FloatArray) -> FloatArray:
    """Return the ratios (5, 3) to the best naive predictor, by horizon and state."""
    naive = {n: score(record, rows, x) for n, x in naive_predictions(record, rows, AHEAD).items()}
    return np.asarray(score(record, rows, predicted).rmse / best_naive(naive))


def main() -> None:
    """Print a line for each bank, noise and predictor."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("model", type=Path)
    parser.add_argument("--peers", action="store_true")
    parser.add_argument("--seed", type=int, default=5)
    given = parser.parse_args()
    model = artefact.load(given.model).model
    level = drive(0.0, given.seed + 1)
    print("bank  noise   predictor   state     25 ms  0.25 s   0.5 s     1 s     2 s")
    for noise in (False, True):
        with tempfile.TemporaryDirectory() as scratch:
            train = noisy(level, 0, training=True) if noise else level
            peers = Peers([train], scratch=Path(scratch)) if given.peers else None
            for bank in (0.0, 0.05, 0.1, 0.15):
                record = drive(bank, given.seed)
                record = noisy(record, 1) if noise else record
                scored = np.arange(len(record)) >= SETTLED
                found = rollout_record(model, record, None, scored, AHEAD, STRIDE)
                tables = {"adk_ros": ratios(record, found.rows, found.predicted)}
                for peer in peers.predictors if peers is not None else []:
                    ahead = peer.predict(record, found.rows, AHEAD)
                    tables[peer.name] = ratios(record, found.rows, ahead)
                for name, table in tables.items():
                    for state, column in (("v_y", 1), ("yaw rate", 2)):
                        shown = "  ".join(f"{x:6.3f}" for x in table[:, column])
                        kind = "noisy" if noise else "clean"
                        print(f"{bank:<5g} {kind:7} {name:11} {state:9} {shown}", flush=True)
            if peers is not None:
                peers.close()


if __name__ == "__main__":
    main()
