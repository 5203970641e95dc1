# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Train a model from records: fit, assemble, select hyperparameters, score, save."""

from __future__ import annotations

from collections.abc import Callable
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
from adk_ros.train.dataset import PARTS, TEST, TRAIN, VALIDATION, Split, sequences, split_records
from adk_ros.train.denoising import observer_filtered
from adk_ros.train.held_out import HeldOutScores, score_held_out
from adk_ros.train.hyperparameters import horizon_covariances, select_hyperparameters
from adk_ros.train.network_fit import FittedNetwork, Step, fit
from adk_ros.train.paper_training import fit_paper
from adk_ros.train.train_settings import MIN_TRAINING_S, PaperSettings, TrainSettings

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
    artefact.check_target(out)
    split = split_records(records, split_kind)
    train, validation = split.of(TRAIN), split.of(VALIDATION)
    if not validation:
        raise DataError(
            f"{sum(r.duration_s for r in records):.0f} s of data are too short for a validation "
            f"part: give at least {MIN_TRAINING_S:g} s"
        )
    uses_imu = any(bool((r.a == r.a).any()) for r in records)
    trained: FittedNetwork | None = None
    if isinstance(settings, PaperSettings):
        built = fit_paper(train, settings, on_step)
        known_commands, held_commands = horizon_covariances(built.model, split)
        model = replace(
            built.model, horizon_covariance=known_commands, held_input_covariance=held_commands
        )
    else:
        checkpoint, first_checkpoint = checkpoints_of(out)
        if settings.quadratic:

            def first_training(step: Step) -> None:
                if note is not None:
                    note("preparing: fitting the observer", step.step, step.steps)

            train, validation = observer_filtered(
                train, validation, settings, first_training, first_checkpoint
            )
        trained = fit(train, validation, settings, on_step, checkpoint)
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
        "data": [
            {"name": r.name, "seconds": round(r.duration_s, 3), "imu": bool((r.a == r.a).any())}
            for r in records
        ],
        "split": {"kind": split_kind}
        | {name: round(split.seconds(part), 3) for part, name in enumerate(PARTS)},
        "range": domain.as_json(),
        "fallback": [item.as_json() for item in model.fallback.takeovers()],
        "held_out": test.as_json() if test else None,
    }
    if trained is not None:
        facts |= {
            "best_step": trained.best_step,
            "stopped_early": trained.stopped_early,
            "unaugmented": list(trained.unaugmented),
        }
    artefact.save(out, built.program, model, facts)
    if trained is not None:
        for path in checkpoints_of(out):
            path.unlink(missing_ok=True)
    return TrainingResult(model, split, trained, test, facts)


def uses_imu_loss(settings: TrainSettings | PaperSettings) -> bool:
    """Return whether the settings have the paper's acceleration loss."""
    return isinstance(settings, PaperSettings) and settings.acceleration
