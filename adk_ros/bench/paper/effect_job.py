# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The job of the benchmark that examines the effect of the paper's online method."""

from __future__ import annotations

from pathlib import Path

from adk_ros.bench.paper import cases
from adk_ros.bench.paper.online_effect import epochs_of, study
from adk_ros.bench.paper.training_jobs import BenchPlan, NoteProgress, Outcome, TrainingJob
from adk_ros.model.adaptation.online_methods import RCOND
from adk_ros.model.koopman import KoopmanModel
from adk_ros.train.network_fit import Step
from adk_ros.train.paper_training import fit_paper
from adk_ros.train.train_settings import PaperSettings


def effect_job(job: TrainingJob, plan: BenchPlan, folder: Path, tell: NoteProgress) -> Outcome:
    """Train ALDK with several numbers of epochs and adapt it in every reading of the paper."""
    outcome = Outcome(job)
    train = cases.training_record(folder, job.variant, plan.drives)
    test = cases.record_of_test(folder, cases.NOMINAL, job.variant, plan.drives)
    default = (PaperSettings().window, RCOND)

    def fit(epochs: int, tell: NoteProgress) -> KoopmanModel:
        with outcome.clocked("training"):
            settings = plan.paper_training(acceleration=True, epochs=epochs)
            checkpoint = plan.checkpoint_of(job, epochs)

            def on_step(step: Step) -> None:
                tell(step.step / step.steps)

            return fit_paper([train], settings, on_step, checkpoint).model

    with outcome.clocked("predicting"):
        epochs = tuple(epochs_of(plan.paper_epochs))
        outcome.readings += study(fit, epochs, train, test, default, tell)
    outcome.seconds["predicting"] -= outcome.seconds["training"]
    return outcome
