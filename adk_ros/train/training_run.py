# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Train a model from records: fit, assemble, select hyperparameters, score, save."""

from __future__ import annotations

import glob
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from adk_ros.errors import DataError
from adk_ros.model import artefact
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.training_range import TrainingRange
from adk_ros.model.uncertainty.motion_limits import motion_limits
from adk_ros.signals.channels import Record
from adk_ros.signals.decode import SensorConfig
from adk_ros.train.assemble import assemble
from adk_ros.train.dataset import (
    PARTS,
    TEST,
    TRAIN,
    VALIDATION,
    VEHICLES,
    Split,
    sequences,
    split_records,
)
from adk_ros.train.denoising import observer_filter
from adk_ros.train.held_out import HeldOutScores, score_held_out
from adk_ros.train.hyperparameters import horizon_covariances, select_hyperparameters
from adk_ros.train.network_fit import FittedNetwork, Step, fit
from adk_ros.train.paper_training import fit_paper
from adk_ros.train.train_settings import MIN_TRAINING_S, PaperSettings, TrainSettings
from adk_ros.train.windows import TrainingWindows

Note = Callable[[str, int, int], None]


@dataclass(frozen=True)
class TrainingResult:
    """
    Result of a training.

    `trained` is None in the paper's mode, `test` without held-out data.
    """

    model: KoopmanModel
    split: Split
    trained: FittedNetwork | None
    test: HeldOutScores | None
    facts: dict[str, Any]


def checkpoints_of(out: Path) -> tuple[Path, Path]:
    """
    Return the checkpoint files of a training that writes `out`.

    The training's own comes first, then that of the first training. Noisy data
    need a first training for the observer, see `denoising`.
    """
    return (
        out.with_name(out.name + ".checkpoint.npz"),
        out.with_name(out.name + ".first.checkpoint.npz"),
    )


def run_training(
    records: list[Record],
    out: Path,
    settings: TrainSettings | PaperSettings,
    split_kind: str = "blocks",
    sensors: SensorConfig | None = None,
    on_step: Callable[[Step], None] | None = None,
    note: Note | None = None,
) -> TrainingResult:
    """
    Train on `records` and write the model folder `out`.

    An interrupted run that is started again with the same data and settings resumes from its
    checkpoint, `out` with ".checkpoint.npz" appended, which is removed at the end. `on_step` is
    called after every update of the main training, `note(stage, done, total)` during all other
    stages.
    :raises UsageError, DataError: as `split_records`, `fit` and `artefact.save`.
    """
    split = split_records(records, split_kind)
    return train_on_split(split, out, settings, sensors, on_step, note)


def train_on_split(
    split: Split,
    out: Path,
    settings: TrainSettings | PaperSettings,
    sensors: SensorConfig | None = None,
    on_step: Callable[[Step], None] | None = None,
    note: Note | None = None,
    windows: TrainingWindows | None = None,
    about: Mapping[str, Any] | None = None,
) -> TrainingResult:
    """
    Train on the parts of a split, see `run_training`.

    `windows`: training data that do not fit into memory together; the training part of `split` is
    the first window. Only for the default training. `about`: further facts for the manifest.
    :raises UsageError, DataError: as `fit` and `artefact.save`.
    """
    artefact.check_target(out)
    records = split.records
    train, validation = split.of(TRAIN), split.of(VALIDATION)
    if not validation:
        raise DataError(
            f"{sum(r.duration_s for r in records):.0f} s of data are too short for a validation "
            f"part: give at least {MIN_TRAINING_S:g} s"
        )
    uses_imu = any(bool((r.a == r.a).any()) for r in records)
    trained: FittedNetwork | None = None
    checkpoint, first_checkpoint = checkpoints_of(out)
    if isinstance(settings, PaperSettings):
        built = fit_paper(train, settings, on_step, checkpoint)
        known_commands, held_commands = horizon_covariances(built.model, split)
        model = replace(
            built.model, horizon_covariance=known_commands, held_input_covariance=held_commands
        )
    else:
        if settings.quadratic:

            def first_training(step: Step) -> None:
                if note is not None:
                    note("preparing: fitting the observer", step.step, step.steps)

            filtered = observer_filter(
                train, validation, settings, first_training, first_checkpoint
            )
            train, validation = [filtered(r) for r in train], [filtered(r) for r in validation]
            windows = windows and windows.mapped(filtered)
        trained = fit(train, validation, settings, on_step, checkpoint, windows)
        joined = sequences(train, settings.history, 2, "training")
        built = assemble(trained, joined, uses_imu)
        limited = replace(built.model, motion_limits=motion_limits(split.of(TRAIN)))
        model = select_hyperparameters(limited, split, note, built.refitted)

    def scoring(done: int, total: int) -> None:
        if note is not None:
            note("scoring held-out data", done, total)

    domain = TrainingRange.of(split.of(TRAIN))
    tests = [(r, p == TEST) for r, p in zip(split.records, split.parts, strict=True)]
    test = score_held_out(model, tests, domain, progress=scoring)
    facts: dict[str, Any] = {
        "kind": "default" if trained else "aldk" if uses_imu_loss(settings) else "dk",
        "settings": asdict(settings),
        "sensors": asdict(sensors or SensorConfig()),
        "data": _data_facts(split),
        "split": {"kind": split.kind}
        | {name: round(split.seconds(part), 3) for part, name in enumerate(PARTS)},
        "range": domain.as_json(),
        "fallback": [item.as_json() for item in model.fallback.takeovers()],
        "held_out": test.as_json() if test else None,
    } | dict(about or {})
    if trained is not None:
        facts |= {
            "best_step": trained.best_step,
            "stopped_early": trained.stopped_early,
            "unaugmented": list(trained.unaugmented),
            "single_track": trained.single_track and trained.single_track.as_json(),
        }
    artefact.save(out, built.program, model, facts)
    for path in (checkpoint, first_checkpoint):
        path.unlink(missing_ok=True)
        for part in path.parent.glob(f"{glob.escape(path.stem)}.*.part"):
            # Of a training that was killed while it wrote.
            part.unlink(missing_ok=True)
    return TrainingResult(model, split, trained, test, facts)


def _data_facts(split: Split) -> list[dict[str, Any]]:
    """Return name, duration and use of the IMU of each recording; blocks of one are joined."""
    facts: list[dict[str, Any]] = []
    for record in split.records:
        is_block = split.kind == VEHICLES and facts and facts[-1]["name"] == record.name
        if not is_block:
            facts.append({"name": record.name, "seconds": 0.0, "imu": False})
        facts[-1]["seconds"] = round(facts[-1]["seconds"] + record.duration_s, 3)
        facts[-1]["imu"] |= bool((record.a == record.a).any())
    return facts


def uses_imu_loss(settings: TrainSettings | PaperSettings) -> bool:
    """Return whether the settings have the paper's acceleration loss."""
    return isinstance(settings, PaperSettings) and settings.acceleration
