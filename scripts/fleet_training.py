# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print how well models of a fleet predict vehicles that they have not seen.

    adk fleet demo --quick --out demo_fleet
    python scripts/fleet_training.py demo_fleet/drives --out fleet [--seeds 3] [--steps 4000]

Models: of all training vehicles, with balanced and with unbalanced windows, and of one vehicle.
The seed also chooses the vehicles. Values: RMSE 1 s ahead, future commands known, over that of the
best naive predictor for the same starts, geometric mean over v_x, v_y and yaw rate, by condition.
"""

from __future__ import annotations

import argparse
import resource
from dataclasses import replace
from pathlib import Path

import numpy as np

from adk_ros.api.fleet.fleet_run import FleetOptions
from adk_ros.api.fleet.fleet_training import train_fleet
from adk_ros.api.fleet.shard_stage import SHARDS
from adk_ros.api.fleet.training_data import (
    FleetTrainingData,
    FleetTrainingOptions,
    fleet_training_data,
    joined_records,
    split_of,
)
from adk_ros.api.training import default_settings
from adk_ros.fleet.training.blocks import HARD_M_S2, speed_classes
from adk_ros.model.evaluation import Rollouts
from adk_ros.numerics.arrays import BoolArray, FloatArray
from adk_ros.signals.channels import Record
from adk_ros.signals.score import best_naive, naive_predictions, score
from adk_ros.train.dataset import TEST
from adk_ros.train.held_out import score_held_out
from adk_ros.train.training_run import run_training

_SECOND = 2
"""Index of 1 s among the horizons of a score, counted from the end."""


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("drives")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--steps", type=int, default=4000)
    parser.add_argument("--hours", type=float, default=0.25)
    given = parser.parse_args()
    ratios: dict[str, dict[str, list[float]]] = {}
    for seed in range(given.seeds):
        settings = replace(default_settings(given.steps), seed=seed)
        for name, balanced in (("all, balanced", True), ("all, unbalanced", False)):
            training = FleetTrainingOptions(3600.0 * given.hours, balanced)
            model = given.out / f"model_{seed}_{balanced}"
            trained = train_fleet(
                [given.drives], given.out, model, settings=settings, training=training,
                report=False, force=True,
            )  # fmt: skip
            run = trained.training
            assert run is not None
            assert run.test is not None
            _add(ratios, name, run.test.rollouts)
            memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
            print(f"seed {seed}: {name}, at most {memory:.0f} MiB so far", flush=True)
        data = fleet_training_data(
            [given.drives], given.out, seed, FleetTrainingOptions(), FleetOptions()
        )
        records, tests = _of_one_vehicle(given.out / SHARDS, data, seed)
        single = run_training(records, given.out / f"model_{seed}_one", settings)
        scored = score_held_out(single.model, [(record, None) for record in tests])
        assert scored is not None
        _add(ratios, "one vehicle", scored.rollouts)
        print(f"seed {seed}: one vehicle, {len(records)} recordings", flush=True)
    _print(ratios)


def _of_one_vehicle(
    folder: Path, data: FleetTrainingData, seed: int
) -> tuple[list[Record], list[Record]]:
    """Return the recordings of the training vehicle with most data, and those of the test."""
    blocks = data.windows.blocks()
    total = {name: 0.0 for name in data.split.train}
    for block in blocks:
        total[block.vehicle] += block.seconds
    one = max(total, key=lambda name: total[name])
    chosen = sorted((b for b in blocks if b.vehicle == one), key=lambda b: (b.shard, b.start))
    tests = split_of(folder, data, joined_records(folder, data.windows.window(0)), seed).of(TEST)
    return joined_records(folder, chosen), tests


def _add(ratios: dict[str, dict[str, list[float]]], name: str, rolled: list[Rollouts]) -> None:
    for condition, value in _by_condition(rolled).items():
        ratios.setdefault(condition, {}).setdefault(name, []).append(value)


def _by_condition(rolled: list[Rollouts]) -> dict[str, float]:
    squares: dict[str, list[FloatArray]] = {}
    for item in rolled:
        predictions = {"": item.predicted} | naive_predictions(item.record, item.rows, 80)
        for condition, inside in _conditions(item).items():
            if inside.sum() < 1:
                continue
            rows = item.rows[inside]
            tables = {n: score(item.record, rows, p[inside]) for n, p in predictions.items()}
            naive = best_naive({n: t for n, t in tables.items() if n})
            pair = np.array([tables[""].rmse[-_SECOND], naive[-_SECOND]])
            squares.setdefault(condition, []).append(inside.sum() * pair**2)
    pooled = {name: np.sqrt(np.sum(pairs, axis=0)) for name, pairs in squares.items()}
    return {name: float(np.exp(np.log(x[0] / x[1]).mean())) for name, x in pooled.items()}


def _conditions(item: Rollouts) -> dict[str, BoolArray]:
    start = item.record.x_ref[item.rows]
    hard = np.asarray(np.abs(start[:, 0] * start[:, 2]) > HARD_M_S2)
    every = np.ones(len(start), dtype=bool)
    return {"all": every} | speed_classes(start[:, 0]) | {"hard cornering": hard}


def _print(ratios: dict[str, dict[str, list[float]]]) -> None:
    names = list(next(iter(ratios.values())))
    print(f"| condition | {' | '.join(names)} |")
    print(f"| --- |{' --- |' * len(names)}")
    for condition, by_name in ratios.items():
        cells = [
            f"{np.exp(np.mean(np.log(values))):.3f} ({min(values):.3f} to {max(values):.3f})"
            for values in (by_name[name] for name in names)
        ]
        print(f"| {condition} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
