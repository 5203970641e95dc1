# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The horizon under planned commands.

A prediction's horizon holds the present command. Where a plan reaches, the commands of the plan
take its place, channel by channel; after its last point they are held. The first step has the
command in force at the sample, whatever was planned for it. Beyond the reach of a plan the horizon
is worth no more than one under held commands, see `partial_plan`.

A plan is worth following only while the vehicle does what it says. Each planned command is
compared with the command in force when its time has come, and so is the command that was held: a
channel whose plan was not half as far off as holding is held.
"""

from __future__ import annotations

import math
from enum import Enum

import numpy as np

from adk_ros.model.drivable import is_drivable
from adk_ros.model.initial_errors import PRIOR_ROLLOUTS, held_input_errors
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.partial_plan import partial_covariance, partial_horizon
from adk_ros.model.prediction import Prediction
from adk_ros.model.predictor import Predictor
from adk_ros.model.uncertainty.published_horizons import (
    PublishedHorizonErrors,
    compare_and_publish,
)
from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.signals.channels import TICK_NS, UNLEARNABLE, Flag, Sample
from adk_ros.signals.command_plan import CommandPlan

COMPARED_STEPS = 10
"""Steps ahead at which plans are compared with what happened: 0.25 s, if they reach that far."""
_GAIN = 0.05
"""Gain per tick of the mean squared deviations: time constant 0.5 s. By choice."""
_NEGLIGIBLE = 0.1
"""
Deviation, as a share of the command's spread in training, that contradicts no plan. By choice: a
steering actuator's offset is of that size, while the command it follows changes by the spread.
"""
_LEAST_GAIN = 0.25
"""
Mean squared deviation of a plan over that of holding, above which the plan is not carried out:
half the deviation. By choice; two unrelated drives reach one at times.
"""
_UNLEARNABLE, _COMMAND_STALE = int(UNLEARNABLE), int(Flag.COMMAND_STALE)
_NO_NAIVE = np.empty((0, 3))
"""Under a plan, IMU integration has no say."""


class PlanStatus(Enum):
    """What a channel of the horizon does with the latest plan."""

    NONE = "no plan"
    FOLLOWED = "followed"
    NOT_PLANNED = "held: the plan has no such command"
    STALE = "held: the plan is older than plan_timeout_s"
    NOT_BEGUN = "held: the plan begins later than it can be compared with the commands"
    OUT_OF_REACH = "held: the plan does not reach beyond the present sample"
    CONTRADICTED = "held: the commands in force contradict the plan"
    NOT_DRIVABLE = "held: under the plan the prediction is not drivable"


class PlannedHorizon:
    """
    Follows plans for one predictor.

    `status` of each channel; `commands` (steps, 2) of the latest horizon, SI, None if it holds the
    present ones.

    :param timeout_s: age of a plan, s, from which it is not followed.
    """

    def __init__(self, model: KoopmanModel, horizon_steps: int, timeout_s: float) -> None:
        self._steps = horizon_steps
        self._timeout_ns = round(timeout_s * 1e9)
        self._u_scale = np.asarray(model.scaling.u_scale, dtype=np.float64)
        self._after_ns = TICK_NS * np.arange(horizon_steps, dtype=np.int64)
        errors = model.horizon_covariance
        if len(errors):
            errors = errors[np.minimum(np.arange(horizon_steps), len(errors) - 1)]
        else:
            errors = held_input_errors(model, horizon_steps)
        # Under a plan that is carried out, what the model predicts need not be shrunk.
        self._errors = PublishedHorizonErrors(
            np.ascontiguousarray(errors), PRIOR_ROLLOUTS, shrinks=False
        )
        self._plan: CommandPlan | None = None
        self._taken_ns: int | None = None
        self._due: dict[int, FloatArray] = {}
        self._deviations = np.zeros((2, 2))
        self.commands: FloatArray | None = None
        self.reset()

    def take(self, plan: CommandPlan) -> None:
        """Follow a plan from the next sample on, instead of the one before."""
        self._plan, self._taken_ns = plan, None

    def reset(self) -> None:
        """Forget the plan, and what earlier ones were worth."""
        self._plan = self._taken_ns = self.commands = None
        self._errors.reset()
        self._forget_deviations()
        self.status = [PlanStatus.NONE, PlanStatus.NONE]

    def restart(self, stamp_ns: int) -> None:
        """
        Begin afresh at a sample after a pause or a jump of the clock.

        A plan of this time stays: a planner may send one only when it changes.
        """
        plan = self._plan
        self.reset()
        if plan is not None and abs(stamp_ns - plan.stamp_ns) <= self._timeout_ns:
            self._plan = plan

    def interrupt(self) -> None:
        """Note a sample without a prediction: horizons on both sides are not compared."""
        self._errors.stop()
        self._forget_deviations()

    def apply(self, predictor: Predictor, prediction: Prediction, sample: Sample) -> Prediction:
        """
        Return a prediction whose horizon follows the plan as far as it is to be followed.

        `prediction` is the predictor's latest, made from `sample`.
        """
        self.commands = None
        if not len(prediction.horizon) or not self._has_plan(sample.stamp_ns):
            return prediction
        self._compare(sample)
        commands, reach = self._commands(sample, len(prediction.horizon))
        if not reach.any():
            self._learn(sample, None)
            return prediction
        horizon = self._horizon(predictor, prediction, commands, reach)
        state = np.array(sample.x if math.isfinite(sum(sample.x)) else prediction.x)
        if not (np.isfinite(horizon).all() and is_drivable(state, horizon)):
            for c in np.flatnonzero(reach):
                self.status[c] = PlanStatus.NOT_DRIVABLE
            self._learn(sample, None)
            return prediction
        self.commands = commands
        return prediction._replace(
            horizon=horizon,
            horizon_covariance=self._covariance(predictor, prediction, sample, horizon, reach),
            planned_steps=(int(reach[0]), int(reach[1])),
        )

    def _horizon(
        self,
        predictor: Predictor,
        prediction: Prediction,
        commands: FloatArray,
        reach: IntArray,
    ) -> FloatArray:
        """Return the horizon (steps, 3), SI, of `commands` (steps, 2) planned up to `reach`."""
        planned = predictor.rollout(commands)
        if reach.min() == len(planned):
            return planned
        # Needed only where a command is held throughout; it takes as long as the rollout above.
        held = np.repeat(commands[:1], len(commands), axis=0)
        unplanned = planned if reach.all() else predictor.rollout(held)
        shrinkage = predictor.held_input_shrinkage
        return partial_horizon(planned, unplanned, prediction.horizon, shrinkage, reach)

    def _covariance(
        self,
        predictor: Predictor,
        prediction: Prediction,
        sample: Sample,
        horizon: FloatArray,
        reach: IntArray,
    ) -> FloatArray:
        """
        Return the covariance (steps, 3, 3), SI, to publish with `horizon`.

        Errors are learned from the steps that are planned for both commands, and from no others.
        """
        known, coasted = int(reach.min()), predictor.uncertain_ticks
        if not known:
            self._learn(sample, None)
            return prediction.horizon_covariance
        slot = self._errors.slot(len(horizon), coasted)
        self._learn(sample, horizon, slot, known)
        planned = self._errors.issue(len(horizon), coasted)
        return partial_covariance(planned, prediction.horizon_covariance, known)

    def _has_plan(self, stamp_ns: int) -> bool:
        """
        Return whether there is a plan; forget one that ended `timeout_s` ago.

        The end is at least as long after its receipt as it is after the plan's stamp: a planner
        whose clock is behind sends plans that have all ended, which its status has to say.
        """
        if self._plan is None:
            return False
        if self._taken_ns is None:
            self._taken_ns = stamp_ns
        end_ns = int(self._plan.times_ns[-1])
        end_ns = max(end_ns, self._taken_ns + end_ns - self._plan.stamp_ns)
        if stamp_ns > end_ns + self._timeout_ns:
            self._plan = None
            self.interrupt()
            self.status = [PlanStatus.NONE, PlanStatus.NONE]
        return self._plan is not None

    def _commands(self, sample: Sample, steps: int) -> tuple[FloatArray, IntArray]:
        """Return the commands (steps, 2) of the horizon, and how many of each (2,) are planned."""
        assert self._plan is not None
        held = np.array(sample.u)
        out = np.repeat(held[None], steps, axis=0)
        planned = self._plan.at(sample.stamp_ns + self._after_ns[:steps])
        planned[0] = held
        reach = np.zeros(2, dtype=np.int64)
        stale = sample.stamp_ns - self._plan.stamp_ns > self._timeout_ns
        if stale:
            # Of a planner that has paused, the next plans show what it is worth.
            self._forget_deviations()
        else:
            self._promise(sample, planned)
        for c in range(2):
            known = np.flatnonzero(np.isfinite(planned[1:, c])) + 1
            self.status[c] = self._status(c, stale, known)
            if self.status[c] is not PlanStatus.FOLLOWED:
                continue
            out[known, c] = planned[known, c]
            out[known[-1] + 1 :, c] = planned[known[-1], c]
            reach[c] = known[-1] + 1
        return out, reach

    def _status(self, c: int, stale: bool, known: IntArray) -> PlanStatus:
        assert self._plan is not None
        if not np.isfinite(self._plan.commands[:, c]).any():
            return PlanStatus.NOT_PLANNED
        if stale:
            return PlanStatus.STALE
        if not known.size:
            return PlanStatus.OUT_OF_REACH
        if known[0] > COMPARED_STEPS:
            # Its clock may be ahead: what it says would never be checked.
            return PlanStatus.NOT_BEGUN
        planned, held = self._deviations[:, c]
        if planned > max(_LEAST_GAIN * held, _NEGLIGIBLE**2):
            return PlanStatus.CONTRADICTED
        return PlanStatus.FOLLOWED

    def _promise(self, sample: Sample, planned: FloatArray) -> None:
        """Keep what a plan and what holding say of a command soon, until its time comes."""
        known = np.flatnonzero(np.isfinite(planned).any(axis=1))
        ahead = min(COMPARED_STEPS, int(known[-1]) if known.size else 0)
        if ahead:
            said = np.array([planned[ahead], sample.u])
            self._due[sample.stamp_ns + ahead * TICK_NS] = said

    def _compare(self, sample: Sample) -> None:
        """Compare the commands in force with what was said of them."""
        said = self._due.pop(sample.stamp_ns, None)
        # Whatever the state is known from: a stale command alone says nothing of the plan.
        if said is None or sample.flags & _COMMAND_STALE:
            return
        # Beyond the spread in training, more says no more, and would be remembered for longer.
        squared = np.minimum(np.square((said - np.array(sample.u)) / self._u_scale), 1.0)
        known = np.isfinite(squared).all(axis=0)
        self._deviations[:, known] += _GAIN * (squared - self._deviations)[:, known]

    def _learn(
        self, sample: Sample, horizon: FloatArray | None, slot: int = -1, known: int = 0
    ) -> None:
        """Compare the state with earlier horizons; store `known` rows of a new one in `slot`."""
        usable = not sample.flags & _UNLEARNABLE
        rows = np.zeros((self._steps, 3)) if horizon is None else horizon
        state = np.array(sample.x)
        compare_and_publish(state, usable, state, _NO_NAIVE, rows, known, slot, self._errors.rows)

    def _forget_deviations(self) -> None:
        self._due.clear()
        self._deviations[:] = 0.0
