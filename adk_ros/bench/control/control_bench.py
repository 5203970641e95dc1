# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Run `adk bench control`: every manoeuvre, car, controller and prediction model, in closed loop.

Path and speed are those of the nominal car for all cars: nothing tells the planner of a change.
"""

from __future__ import annotations

import csv
import json
import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from adk_ros.bench.control.bicycle_models import BicycleModel
from adk_ros.bench.control.cars import CARS, NOMINAL, SimulatedCar, make_car
from adk_ros.bench.control.closed_loop import ApproachDriver, Sensors, run_closed_loop
from adk_ros.bench.control.controllers import (
    CONTROLLERS,
    MPC_NAME,
    MPPI_NAME,
    Controller,
    ControlSettings,
)
from adk_ros.bench.control.linear_mpc import LinearMpc, has_osqp
from adk_ros.bench.control.mppi import Mppi
from adk_ros.bench.control.plant_model import PlantModel
from adk_ros.bench.control.prediction_models import KoopmanPredictions, PredictionModel
from adk_ros.bench.control.reference_path import MANOEUVRES, ReferencePath, reference_path
from adk_ros.bench.control.scores import (
    ADAPTED,
    DYNAMIC,
    FROZEN,
    KINEMATIC,
    MODELS,
    ScoredRun,
    criteria,
    errors_by_distance,
    score_run,
)
from adk_ros.model import artefact
from adk_ros.model.koopman import KoopmanModel
from adk_ros.numerics.finite import finite

Progress = Callable[[float, float, str], None]


@dataclass(frozen=True)
class ControlPlan:
    """
    What to run, all combinations of it.

    `model`: folder of the trained model. `length_m`: of the scored part, at most. Without OSQP the
    linear MPC is left out.
    """

    model: Path
    seeds: tuple[int, ...] = (1,)
    manoeuvres: tuple[str, ...] = MANOEUVRES
    cars: tuple[str, ...] = CARS
    controllers: tuple[str, ...] = CONTROLLERS
    models: tuple[str, ...] = MODELS
    length_m: float = float("inf")
    settings: ControlSettings = field(default_factory=ControlSettings)

    def runs(self) -> Iterator[RunChoice]:
        """Yield all runs; those of a car and a seed follow each other."""
        for manoeuvre in self.manoeuvres:
            for car in self.cars:
                for seed in self.seeds:
                    for controller in self.controllers:
                        for model in self.models:
                            if controller != MPC_NAME or has_osqp():
                                yield RunChoice(manoeuvre, car, controller, model, seed)


class RunChoice(NamedTuple):
    """Names of what is run, and the seed."""

    manoeuvre: str
    car: str
    controller: str
    model: str
    seed: int


def path_of(manoeuvre: str, length_m: float) -> ReferencePath:
    """Return the path of a manoeuvre, its scored part at most `length_m` long."""
    path = reference_path(manoeuvre, make_car(NOMINAL).grip())
    return replace(path, end=min(path.end, path.begin + length_m))


def run_one(plan: ControlPlan, choice: RunChoice) -> ScoredRun:
    """Run and score one closed loop."""
    path = path_of(choice.manoeuvre, plan.length_m)
    pose, speed = path.pose_at(path.start)
    car = SimulatedCar(make_car(choice.car), speed, pose)
    run = run_closed_loop(
        car,
        path,
        _model(plan, choice.model, car),
        _controller(plan.settings, choice, path),
        ApproachDriver(make_car(NOMINAL).vehicle.constants(), path, choice.seed),
        Sensors(choice.seed),
    )
    return ScoredRun(*choice, score_run(run, path), *errors_by_distance(run, path))


def _model(plan: ControlPlan, name: str, car: SimulatedCar) -> PredictionModel:
    if name in (FROZEN, ADAPTED):
        return KoopmanPredictions(_load(plan.model), adapts=name == ADAPTED)
    if name in (KINEMATIC, DYNAMIC):
        return BicycleModel(dynamic=name == DYNAMIC)
    return PlantModel(car)


def _controller(settings: ControlSettings, choice: RunChoice, path: ReferencePath) -> Controller:
    if choice.controller == MPPI_NAME:
        return Mppi(settings, path.route, choice.seed)
    return LinearMpc(settings, path.route)


@cache
def _load(folder: Path) -> KoopmanModel:
    return artefact.load(folder).model


def run_control(
    plan: ControlPlan,
    jobs: int = 1,
    progress: Progress | None = None,
    keep: Callable[[list[ScoredRun]], None] | None = None,
) -> list[ScoredRun]:
    """
    Run all of a plan, in `jobs` processes; times per cycle are those with that load.

    :param keep: called with the results so far after each run.
    :raises UsageError: the model cannot be read.
    """
    choices = list(plan.runs())
    _load(plan.model)

    def tell(done: int, what: str) -> None:
        if progress is not None:
            progress(done, len(choices), what)

    if jobs == 1:
        results = []
        for done, choice in enumerate(choices):
            tell(done, ", ".join(choice[:4]))
            results.append(run_one(plan, choice))
            if keep is not None:
                keep(results)
        tell(len(choices), "")
        return results
    by_choice: dict[RunChoice, ScoredRun] = {}
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs, mp_context=context) as pool:
        running = {pool.submit(run_one, plan, choice): choice for choice in choices}
        for future in as_completed(running):
            by_choice[running[future]] = future.result()
            if keep is not None:
                keep([by_choice[choice] for choice in choices if choice in by_choice])
            tell(len(by_choice), ", ".join(running[future][:4]))
    return [by_choice[choice] for choice in choices]


def as_dict(runs: Sequence[ScoredRun], plan: ControlPlan) -> dict[str, Any]:
    """Return results for JSON: settings, one entry per run, and the criteria."""
    return {
        "settings": asdict(plan.settings) | {"weights": plan.settings.weights._asdict()},
        "length_m": plan.length_m,
        "runs": [
            {
                "manoeuvre": r.manoeuvre, "car": r.car, "controller": r.controller,
                "model": r.model, "seed": r.seed, **asdict(r.score),
            }
            for r in runs
        ],
        "criteria": [asdict(item) for item in criteria(runs)],
    }  # fmt: skip


def write_results(runs: Sequence[ScoredRun], plan: ControlPlan, folder: Path) -> None:
    """Write `control.json` and `control.csv` to a folder, which is made if it does not exist."""
    folder.mkdir(exist_ok=True)
    content = finite(as_dict(runs, plan))
    (folder / "control.json").write_text(json.dumps(content, indent=1), encoding="utf-8")
    with (folder / "control.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(content["runs"][0]))
        writer.writeheader()
        writer.writerows(content["runs"])
