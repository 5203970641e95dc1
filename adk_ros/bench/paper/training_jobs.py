# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Independent jobs of the benchmark: fit a predictor and evaluate it on all tests.

A job reads the simulated drives from a folder and returns scores; one-step predictions, which the
figures need, are written to the same folder.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from adk_ros.bench.paper import cases
from adk_ros.bench.paper.baseline_libraries import Peers
from adk_ros.bench.paper.error_sources import EstimatedStartOracle, reduced_predictors
from adk_ros.bench.paper.linear_models import LeastSquares
from adk_ros.bench.paper.online_effect import VALIDATED_FROM, Reading
from adk_ros.bench.paper.predictor_protocol import BenchPredictor
from adk_ros.bench.paper.predictors import (
    ADK_ROS,
    DK,
    LINEAR,
    LINEAR_ADAPTED,
    METHODS,
    MF,
    MF_CHOSEN,
    MF_PLAIN,
    MF_TUNED,
    NAIVE,
    KoopmanPredictor,
    NaivePredictor,
    OraclePredictor,
    run,
)
from adk_ros.bench.paper.scores import CaseScore, score_case
from adk_ros.bench.paper.seven_dof_predictor import SevenDof
from adk_ros.errors import AdkError
from adk_ros.model import artefact
from adk_ros.model.adaptation.online_methods import OnlineSettings
from adk_ros.numerics.arrays import FloatArray
from adk_ros.plant.scenario.sensor_simulation import SimulatedDrive
from adk_ros.plant.vehicle.vehicle_parameters import Vehicle, load_vehicle
from adk_ros.signals.channels import Record
from adk_ros.train.network_fit import Step
from adk_ros.train.paper_training import fit_paper
from adk_ros.train.train_settings import PaperSettings, TrainSettings
from adk_ros.train.training_run import run_training

ADAPTED = OnlineSettings("windowed", window=2000, ridge=300.0)
"""Online method of the least squares without lifting: the window of the default predictor."""
TRAINED_SHARE = 0.8
"""Share of a job's progress bar for the training; cosmetic."""

NoteProgress = Callable[[float], None]


@dataclass(frozen=True)
class BenchPlan:
    """
    Tests to run, of which drives, and training effort; `left_out`: kinds of jobs.

    `device` and `checkpoints`, a folder of unfinished and finished trainings, are for DK and ALDK.
    `sources`: also run the rows of `error_sources`.
    """

    quick: bool = False
    seeds: int = 3
    tests: tuple[str, ...] = cases.TESTS
    drives: cases.DriveSet = cases.PAPER_DRIVES
    left_out: tuple[str, ...] = ()
    train: TrainSettings = field(default_factory=TrainSettings)
    paper_epochs: int = 200
    paper_batch: int = 20
    stride: int = 20
    durations: cases.Durations = field(default_factory=cases.Durations)
    peers: bool = True
    recordings: tuple[Path, ...] = ()
    device: str = "cpu"
    checkpoints: Path | None = None
    sources: bool = False

    def paper_training(self, acceleration: bool, epochs: int) -> PaperSettings:
        """Return the settings of a training of DK, or of ALDK with `acceleration`."""
        return PaperSettings(
            acceleration=acceleration, epochs=epochs, batch=self.paper_batch, device=self.device
        )

    def checkpoint_of(self, job: TrainingJob, epochs: int) -> Path | None:
        """Return the checkpoint file of a training of DK or ALDK, if checkpoints are kept."""
        if self.checkpoints is None:
            return None
        kind = "dk" if job.kind == "dk" else "aldk"
        return self.checkpoints / f"{kind}_{job.variant}_{epochs}_epochs.npz"


@dataclass(frozen=True)
class TrainingJob:
    """A job of one of `KINDS`; `about` is a test to simulate, or the name of a recording."""

    kind: str
    variant: str = cases.CLEAN
    seed: int = 0
    about: str = ""

    @property
    def name(self) -> str:
        """Name in the progress bar and in the table of times."""
        seed = f" seed {self.seed}" if self.kind in ("default", "recording") else ""
        where = self.about if self.kind in ("simulate", "recording") else self.variant
        return f"{self.kind} {where}{seed}"


@dataclass
class Outcome:
    """
    Result of a job: (test, predictor, score), readings of the paper, notes, seconds by phase.

    `failed`: the reason of a failure that does not end the run, or "".
    """

    job: TrainingJob
    scores: list[tuple[str, str, CaseScore]] = field(default_factory=list)
    readings: list[Reading] = field(default_factory=list)
    notes: dict[str, str] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    failed: str = ""

    @contextmanager
    def clocked(self, part: str) -> Iterator[None]:
        """Add the duration of the block to the seconds of a phase."""
        started = time.monotonic()
        try:
            yield
        finally:
            self.seconds[part] = self.seconds.get(part, 0.0) + time.monotonic() - started


def series_path(folder: Path, variant: str, test: str, name: str) -> Path:
    """Return the file of the one-step predictions of a test, for the figures."""
    return folder / f"{variant}_{test}_{name.replace(' ', '_')}.npy"


def simulate_job(job: TrainingJob, plan: BenchPlan, folder: Path, tell: NoteProgress) -> Outcome:
    """Simulate one drive."""
    outcome = Outcome(job)
    other = plan.drives.others.get(job.about)
    with outcome.clocked("simulating"):
        if other is not None:
            cases.write_truth(folder, job.about, other.truth(job.about, plan.durations.test))
            return outcome
        driven, _ = cases.simulate_test(
            job.about, plan.durations, lambda done, total: tell(done / total), plan.drives
        )
        cases.write_truth(folder, job.about, driven)
    return outcome


def naive_job(job: TrainingJob, plan: BenchPlan, folder: Path, tell: NoteProgress) -> Outcome:
    """Run the predictors with little or no training: naive, least squares, nominal physics."""
    outcome = Outcome(job)
    train = cases.training_record(folder, job.variant, plan.drives)
    with outcome.clocked("fitting"):
        linear = LeastSquares.fit([train], name=LINEAR)
        adapted = LeastSquares.fit([train], ADAPTED, LINEAR_ADAPTED)
    nominal = SevenDof(*_given(plan), MF)
    plain = nominal.without_resistances(MF_PLAIN)
    everybody: list[BenchPredictor] = [NaivePredictor(name) for name in NAIVE]
    _evaluate_on_all_tests(
        outcome, [*everybody, linear, adapted, nominal, plain], plan, folder, tell
    )
    return outcome


def _given(plan: BenchPlan) -> tuple[Vehicle, float]:
    """Return the car and the friction of the training drive, which physics models are given."""
    training = plan.drives.scenario(cases.NOMINAL)
    return load_vehicle(training.vehicle), training.mu


def tuned_job(job: TrainingJob, plan: BenchPlan, folder: Path, tell: NoteProgress) -> Outcome:
    """
    Run the seven-degree-of-freedom model with parameters identified on the training drive.

    On a hilly drive they may be worse than the given ones, since the model's road is flat. The
    better ones are chosen on the last fifth, with parameters identified on the rest.
    """
    outcome = Outcome(job)
    train = cases.training_record(folder, job.variant, plan.drives)
    with outcome.clocked("fitting"):
        vehicle, friction = _given(plan)
        tuned = SevenDof.tuned(vehicle, [train], friction, MF_TUNED)
        cut = int(VALIDATED_FROM * len(train))
        early = SevenDof.tuned(vehicle, [train.rows(slice(0, cut))], friction)
        given = SevenDof(vehicle, friction)
        best = early.better_of(given, train.rows(slice(cut, None)), cases.AHEAD)
        chosen = replace(given if best is given else tuned, name=MF_CHOSEN)
        outcome.notes[MF_CHOSEN] = "given parameters" if best is given else "identified ones"
    tell(0.5)
    _evaluate_on_all_tests(
        outcome, [tuned, chosen], plan, folder, lambda share: tell(0.5 + 0.5 * share)
    )
    return outcome


def paper_job(job: TrainingJob, plan: BenchPlan, folder: Path, tell: NoteProgress) -> Outcome:
    """Train and run DK, or ALDK with its three online methods."""
    outcome = Outcome(job)
    train = cases.training_record(folder, job.variant, plan.drives)
    settings = plan.paper_training(job.kind == "aldk", plan.paper_epochs)

    def on_step(step: Step) -> None:
        tell(TRAINED_SHARE * step.step / step.steps)

    with outcome.clocked("training"):
        checkpoint = plan.checkpoint_of(job, plan.paper_epochs)
        built = fit_paper([train], settings, on_step, checkpoint)
        # Via the model folder, as in normal use.
        where = folder / f"{job.kind}_{job.variant}"
        artefact.save(where, built.program, built.model, {"kind": job.kind})
    model = artefact.load(where).model
    methods = METHODS if settings.acceleration else {DK: "constant"}
    everybody = [
        KoopmanPredictor(name, model, replace(model.online, method=method))
        for name, method in methods.items()
    ]
    _evaluate_on_all_tests(outcome, everybody, plan, folder, _evaluation_rest(tell))
    return outcome


def default_job(job: TrainingJob, plan: BenchPlan, folder: Path, tell: NoteProgress) -> Outcome:
    """
    Train and run the adk_ros model with one seed; a tenth of the drive is for validation.

    With `BenchPlan.sources` also reduced ones, and with the first seed the plant from its state.
    """
    outcome = Outcome(job)
    train = cases.training_record(folder, job.variant, plan.drives)
    full = train_default(outcome, [train], plan, folder, tell)
    everybody = [full, *(reduced_predictors(full) if plan.sources else [])]
    _evaluate_on_all_tests(outcome, everybody, plan, folder, _evaluation_rest(tell))
    if plan.sources and job.seed == 0:
        _run_oracles(
            outcome,
            lambda drive, begin: EstimatedStartOracle(drive, begin, full.model),
            plan, folder, _nothing,
        )  # fmt: skip
    return outcome


def train_default(
    outcome: Outcome, records: list[Record], plan: BenchPlan, folder: Path, tell: NoteProgress
) -> KoopmanPredictor:
    """Return the adk_ros predictor, trained on pieces of `records`."""
    job = outcome.job

    def on_step(step: Step) -> None:
        tell(0.6 * TRAINED_SHARE * step.step / step.steps)

    def note(what: str, done: int, total: int) -> None:
        if what.startswith("selecting"):
            tell(TRAINED_SHARE * (0.6 + 0.4 * done / max(total, 1)))

    cut = [piece for record in records for piece in cases.pieces(record)]
    where = folder / job.name.replace(" ", "_")
    with outcome.clocked("training"):
        settings = replace(plan.train, seed=job.seed)
        run_training(cut, where, settings, "bags", None, on_step, note)
    return KoopmanPredictor(ADK_ROS, artefact.load(where).model)


def peers_job(job: TrainingJob, plan: BenchPlan, folder: Path, tell: NoteProgress) -> Outcome:
    """Fit and run the baseline libraries in their separate environment."""
    outcome = Outcome(job)
    train = cases.training_record(folder, job.variant, plan.drives)
    try:
        with outcome.clocked("fitting"):
            peers = Peers([train], scratch=folder)
        with peers:
            tell(0.5)
            for peer in peers.predictors:
                outcome.notes[peer.name] = peer.settings
            _evaluate_on_all_tests(
                outcome, peers.predictors, plan, folder, lambda share: tell(0.5 + 0.5 * share)
            )
    except AdkError as error:
        # An external library in a separate environment: its failure must not end the run.
        return Outcome(job, failed=str(error), seconds=outcome.seconds)
    return outcome


def floor_job(job: TrainingJob, plan: BenchPlan, folder: Path, tell: NoteProgress) -> Outcome:
    """Run the oracle: the plant itself, restarted from the same measurements."""
    outcome = Outcome(job)
    _run_oracles(outcome, OraclePredictor, plan, folder, tell)
    return outcome


def _run_oracles(
    outcome: Outcome,
    oracle: Callable[[SimulatedDrive, int], BenchPredictor],
    plan: BenchPlan,
    folder: Path,
    tell: NoteProgress,
) -> None:
    """Run a predictor that restarts the plant: made of a drive and the row of its test."""
    for number, test in enumerate(plan.tests):
        if test in plan.drives.others:
            continue
        with outcome.clocked("simulating"):
            driven, begin = cases.simulate_test(test, plan.durations, drives=plan.drives)
        one = replace(plan, tests=(test,))
        _evaluate_on_all_tests(outcome, [oracle(driven, begin)], one, folder, _nothing)
        tell((number + 1) / len(plan.tests))


def _evaluate_on_all_tests(
    outcome: Outcome,
    everybody: Sequence[BenchPredictor | KoopmanPredictor],
    plan: BenchPlan,
    folder: Path,
    tell: NoteProgress,
) -> None:
    """Run and score each predictor on all tests; keep one-step predictions for the figures."""
    job = outcome.job
    total = len(plan.tests) * len(everybody)
    done = 0
    for test in plan.tests:
        record = cases.record_of_test(folder, test, job.variant, plan.drives)
        rows, starts = cases.rows_of(record, plan.stride)
        for predictor in everybody:

            def within(share: float, done: int = done) -> None:
                tell((done + share) / total)

            started = time.monotonic()
            with outcome.clocked("predicting"):
                passed = run(predictor, record, rows, starts, within)
            seconds = time.monotonic() - started
            item = score_case(record, rows, starts, passed, seconds)
            outcome.scores.append((test, predictor.name, item))
            if job.variant == cases.CLEAN and job.seed == 0:
                np.save(series_path(folder, job.variant, test, predictor.name), passed.one)
            done += 1
            tell(done / total)


def _evaluation_rest(tell: NoteProgress) -> NoteProgress:
    return lambda share: tell(TRAINED_SHARE + (1.0 - TRAINED_SHARE) * share)


def _nothing(share: float) -> None:
    """Ignore the progress."""


def read_series(folder: Path, plan: BenchPlan, test: str, name: str) -> tuple[FloatArray, ...]:
    """Return time (n,) s, truth and one-step prediction (n, 3) SI; raise KeyError if not run."""
    path = series_path(folder, cases.CLEAN, test, name)
    if not path.is_file():
        raise KeyError(name)
    record = cases.record_of_test(folder, test, cases.CLEAN, plan.drives)
    rows, _ = cases.rows_of(record, plan.stride)
    time_s = (record.stamp_ns[rows + 1] - record.stamp_ns[0]) * 1e-9
    return time_s, record.x_ref[rows + 1], np.load(path)
