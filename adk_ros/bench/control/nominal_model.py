# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The model that the benchmark trains if it is given none: on drives of the nominal car only."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

from adk_ros.bags.recording import read_recording
from adk_ros.model import artefact
from adk_ros.model.koopman import KoopmanModel
from adk_ros.offline.export import write_bag
from adk_ros.plant.scenario.scenario_file import Scenario, load_scenario
from adk_ros.plant.scenario.simulate import simulate
from adk_ros.signals.channels import Record
from adk_ros.train.network_fit import Step
from adk_ros.train.train_settings import TrainSettings
from adk_ros.train.training_run import run_training

_DRIVES = ((4.4, 0.005, 400.0), (4.8, 0.006, 300.0), (5.0, 0.004, 200.0))
"""Planned lateral acceleration, m/s², and excitation, rad and N·m, of the drives: the plan is
exceeded up to the grip, about 8 m/s², without losing the car."""
_SEED = 5000
"""Seeds of the training drives begin here, far from those of the runs."""
STEPS = 1600
"""Training steps: about 5 min."""
QUICK_STEPS = 200


def nominal_drives(seconds: float) -> list[Record]:
    """Return recordings of the nominal car on the scenario `handling`, `seconds` each."""
    base = load_scenario("handling")
    records = []
    for number, (lateral, steer, torque) in enumerate(_DRIVES):
        scenario: Scenario = base.model_copy(
            update={
                "plant": "fourteen_dof",
                "speed": base.speed.model_copy(update={"lateral_accel": lateral}),
                "excitation": base.excitation.model_copy(
                    update={"steer": steer, "torque": torque}
                ),
            }
        )
        drive = simulate(scenario, seed=_SEED + number, duration_s=seconds)
        with tempfile.TemporaryDirectory() as folder:
            write_bag(drive, Path(folder) / "bag")
            records.append(read_recording(Path(folder) / "bag").record)
    return records


def train_nominal(
    out: Path, steps: int = STEPS, progress: Callable[[int, int], None] | None = None
) -> KoopmanModel:
    """Train the model with `steps` steps and write its folder `out`."""
    settings = TrainSettings(steps=steps, validate_every=max(1, min(200, steps // 10)))

    def on_step(step: Step) -> None:
        if progress is not None:
            progress(step.step, step.steps)

    seconds = 300.0 if steps > QUICK_STEPS else 100.0
    run_training(nominal_drives(seconds), out, settings, on_step=on_step)
    return artefact.load(out).model
