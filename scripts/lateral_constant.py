# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print what the nearly free constants of the lateral rows do, on banked roads and in long turns.

    adk train bags/handling --out model
    python scripts/lateral_constant.py model [--peers] [--seed 5]

Banked: a closed, hilly course without bank, or banked by 0.05 to 0.15 rad to one side throughout.
Turning: two minutes in a circle to the left, then 20 s to the right, the car of the training and
one with front tyres of 0.75 of the cornering stiffness; only the last part counts. A turn to the
right is a mirrored turn to the left.

Rows: the model with the same ridge for all coefficients, as it is, and without windowed least
squares; with `--peers` also pykoop and pykoopman (`make peers`), fitted to the course without bank
with another seed. RMSE of v_y in m/s and of the yaw rate in rad/s, future commands known, and over
that of the best naive predictor.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import numpy as np

from adk_ros.bench.paper.baseline_libraries import Peers
from adk_ros.bench.paper.cases import noisy
from adk_ros.model import artefact
from adk_ros.model.adaptation import online_methods
from adk_ros.model.evaluation import rollout_record
from adk_ros.model.koopman import KoopmanModel
from adk_ros.numerics.arrays import BoolArray, FloatArray
from adk_ros.plant.environment.road import RoadPatch
from adk_ros.plant.scenario.scenario_file import Scenario, load_scenario
from adk_ros.plant.scenario.simulate import simulate
from adk_ros.plant.vehicle.vehicle_parameters import load_vehicle
from adk_ros.signals.channels import Flag, Record
from adk_ros.signals.score import HORIZON_STEPS, best_naive, naive_predictions, score

COURSE, CIRCLE = "xyz_edges", "handling"
BANKS = (0.0, 0.05, 0.1, 0.15)
SECONDS, SETTLED, STRIDE = 150.0, 1200, 8
TURN_ROWS, AFTER_ROWS = 4800, 800
RADIUS = 45.0
AHEAD = HORIZON_STEPS[-1]
SHOWN = (2, 3, 4)
"""Horizons of 0.5, 1 and 2 s."""


def banked(bank: float, seed: int) -> Record:
    """Return the truth of a drive on the course, banked throughout."""
    scenario = load_scenario(COURSE)
    if bank:
        length = simulate(scenario, seed, 1.0).route.length
        place = RoadPatch(start=0.0, end=length, bank=bank, blend=1.0)
        scenario = scenario.model_copy(update={"places": [*scenario.places, place]})
    return simulate(scenario, seed, SECONDS).truth()


def turning(softer: float, seed: int) -> Record:
    """Return a drive in circles to the left and then, mirrored, to the right."""
    given = load_scenario(CIRCLE).model_dump(exclude_none=True, exclude={"heights", "undulations"})
    bend = {"radius": RADIUS, "angle_deg": 90.0, "transition": 6.0}
    stiffness = softer * load_vehicle(given["vehicle"]).front_tyre.b_y
    given |= {
        "route": [part for _ in range(4) for part in ({"straight": 8.0}, {"bend": bend})],
        "places": [],
        "vehicle_changes": {"front_tyre": {"b_y": stiffness}},
    }
    return mirrored(simulate(Scenario.model_validate(given), seed, 200.0).truth(), TURN_ROWS)


def mirrored(record: Record, row: int) -> Record:
    """Return the truth of a drive whose motion is mirrored from `row` on."""
    x, u, a, flags = (y.copy() for y in (record.x, record.u, record.a, record.flags))
    for signal in (x, u, a):
        signal[row:, 1:] *= -1.0
    # No pair spans the change, and no prediction of before is compared with what follows: it is
    # none of the car.
    flags[row] |= int(Flag.LEVEL_CHANGE)
    return replace(record, x=x, u=u, a=a, x_ref=x.copy(), flags=flags)


def rolled(
    model: KoopmanModel, record: Record, scored: BoolArray
) -> Iterator[tuple[str, FloatArray, FloatArray]]:
    """Yield name, RMSE and ratio (5, 3) of the model in its three variants."""
    fixed = replace(model, online=replace(model.online, method="constant"))
    as_it_is = online_methods._OFFSET_RIDGE_SHARE
    for name, used, share in (
        ("same ridge", model, 1.0),
        ("as it is", model, as_it_is),
        ("not adapted", fixed, as_it_is),
    ):
        with patch.object(online_methods, "_OFFSET_RIDGE_SHARE", share):
            found = rollout_record(used, record, None, scored, AHEAD, STRIDE)
        rows = found.rows
        naive = naive_predictions(record, rows, AHEAD)
        best = best_naive({n: score(record, rows, x) for n, x in naive.items()})
        rmse = score(record, rows, found.predicted).rmse
        yield name, rmse, rmse / best


def of_peers(
    peers: Peers, record: Record, scored: BoolArray, model: KoopmanModel
) -> Iterator[tuple[str, FloatArray, FloatArray]]:
    """Yield the same of the baseline libraries, on the rows of the model."""
    rows = rollout_record(model, record, None, scored, AHEAD, STRIDE).rows
    naive = naive_predictions(record, rows, AHEAD)
    best = best_naive({n: score(record, rows, x) for n, x in naive.items()})
    for peer in peers.predictors:
        rmse = score(record, rows, peer.predict(record, rows, AHEAD)).rmse
        yield peer.name, rmse, rmse / best


def show(where: str, name: str, rmse: FloatArray, ratio: FloatArray) -> None:
    """Print a line."""
    columns = []
    for state in (1, 2):
        columns += [f"{rmse[i, state]:.4f}" for i in SHOWN]
        columns += [f"{ratio[i, state]:.3f}" for i in SHOWN]
    print(f"{where:24} {name:12} " + " ".join(f"{text:>7}" for text in columns), flush=True)


def main() -> None:
    """Print a line for each drive, noise and predictor."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("model", type=Path)
    parser.add_argument("--peers", action="store_true")
    parser.add_argument("--seed", type=int, default=5)
    given = parser.parse_args()
    model = artefact.load(given.model).model
    heading = [
        f"{state} {kind}{s:g}" for state in ("v_y", "r") for kind in ("", "/") for s in (0.5, 1, 2)
    ]
    print(f"{'':24} {'':12} " + " ".join(f"{text:>7}" for text in heading))
    drives: list[tuple[str, Record, int, int | None]] = [
        (f"banked {bank:g}", banked(bank, given.seed), SETTLED, None) for bank in BANKS
    ]
    drives += [
        (f"turning, tyres {softer:g}", turning(softer, given.seed), TURN_ROWS, AFTER_ROWS)
        for softer in (1.0, 0.75)
    ]
    for noise in (False, True):
        with tempfile.TemporaryDirectory() as scratch, ExitStack() as stack:
            peers = None
            if given.peers:
                level = banked(0.0, given.seed + 1)
                train = noisy(level, 0, training=True) if noise else level
                peers = stack.enter_context(Peers([train], scratch=Path(scratch)))
            for where, truth, begin, count in drives:
                record = noisy(truth, 1) if noise else truth
                row = np.arange(len(record))
                end = len(record) if count is None else begin + count
                scored = (row >= begin) & (row < end)
                label = f"{where}, {'noisy' if noise else 'clean'}"
                for line in rolled(model, record, scored):
                    show(label, *line)
                if peers is not None and count is None:
                    for line in of_peers(peers, record, scored, model):
                        show(label, *line)


if __name__ == "__main__":
    main()
