# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
One tick of the predictor: sample in, prediction out. No clock, no files, no ROS.

    z_k = [x_k, features(x_k .. x_(k-p), u_k .. u_(k-p))]            lift
    e_k = x_k - (prediction for tick k)                              innovation, before the update
    theta <- online method, with the regression pair completed by x_k
    x_(k+1) = x_k + s * (theta phi_k + d),  phi_k = [z_k; u_k; 1]    predict (residual form)
    x_(k+j): the same, lifted anew at each step, u constant, d decaying   horizon

d is the disturbance: exponentially weighted means of the adapted model's one-step residuals. The
live node, the replay and the validation in training all call `Predictor.step`. In what it returns
naive predictors may take over, see `uncertainty.fallback`; the steps above are those of the model.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from adk_ros.errors import UsageError
from adk_ros.model.adaptation.online_methods import METHODS, OnlineSettings
from adk_ros.model.candidate_commands import checked_commands, unpredictable
from adk_ros.model.drivable import is_drivable
from adk_ros.model.initial_errors import (
    PRIOR_ROLLOUTS,
    held_input_errors,
    make_rollout_monitor,
)
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.linearization import LinearizedRollout
from adk_ros.model.model_rollout import ModelRollout
from adk_ros.model.prediction import Prediction, Status
from adk_ros.model.tick_memory import TickMemory, replace_by_naive
from adk_ros.model.tick_steps import (
    IS_TRUSTED,
    IS_USABLE,
    IS_WARMING_UP,
    LEARNS,
    NOT_FINITE,
    PREDICTED,
    WARMING_UP,
    WITHHOLDS,
    TickInput,
    TickParts,
    make_tick_steps,
)
from adk_ros.model.uncertainty.fallback import KNOWN, coast, take_sample
from adk_ros.model.uncertainty.published_horizons import PublishedHorizonErrors
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.channels import TICK_NS, UNLEARNABLE, Flag, Sample

MAX_HORIZON_STEPS = 400
"""10 s. A rollout of 400 steps takes about a millisecond."""
_MAX_WITHHELD = 4
"""Implausible predictions in succession after which the predictor is reset: a single wrong sample
causes one or two. By choice."""
# Plain integers: operations on flags take a microsecond each.
_RESTART, _COASTING, _UNLEARNABLE = int(Flag.RESTART), int(Flag.COASTING), int(UNLEARNABLE)
_ODOMETRY_STALE, _LEVEL_CHANGE = int(Flag.ODOMETRY_STALE), int(Flag.LEVEL_CHANGE)
_REJECTED = int(Flag.REJECTED)
_NAN3 = np.full(3, math.nan)
_NAN3.flags.writeable = False
_NO_GROWTH = np.zeros(3)
_NO_PREDICTION = np.full(3, math.nan)
"""Writable, as predictions are: for a read-only array numba would compile the observer again."""


class Predictor:
    """
    Runs a model over samples and adapts it.

    :param online: settings of the online method; default: the model's own.
    :param horizon_steps: length of the horizon; 0 for none.
    :param max_coast_steps: number of ticks without a measured state, or without a new reading of
        odometry, that are bridged by predictions. Odometry that stays old corrects again then.
    :param withhold_implausible: return no prediction that no vehicle can follow. Not where models
        are scored: what is withheld has no error.
    :raises UsageError: a setting is out of range.
    """

    def __init__(
        self,
        model: KoopmanModel,
        online: OnlineSettings | None = None,
        horizon_steps: int = 80,
        max_coast_steps: int = 40,
        withhold_implausible: bool = False,
    ) -> None:
        if not 0 <= horizon_steps <= MAX_HORIZON_STEPS:
            raise UsageError(
                f"horizon is {horizon_steps} steps of 25 ms: choose 0 to {MAX_HORIZON_STEPS}"
            )
        self.model = model
        self.settings = online or model.online
        self.online = METHODS[self.settings.method](model.theta0, self.settings, model.affine)
        self.horizon_steps = horizon_steps
        self.max_coast_steps = max_coast_steps
        self._memory = TickMemory(model)
        self._tick = self._memory.tick
        self._gains = self._memory.gains
        self._prediction_only_gains = self._gains.copy()
        self._prediction_only_gains[0] = 0.0
        self.rollout_monitor = make_rollout_monitor(model)
        self._published = PublishedHorizonErrors(
            held_input_errors(model, horizon_steps), PRIOR_ROLLOUTS
        )
        self._model_rollout = ModelRollout(model, self._memory)
        self._mixes = bool(self._memory.fallback.weights.shape[2])
        self._takes_samples = bool(horizon_steps or self._mixes)
        parts = TickParts(
            model,
            self._memory,
            self._published,
            self._model_rollout,
            self.online,
        )
        self._tick_flags = WITHHOLDS if withhold_implausible else 0
        self._steps = make_tick_steps(parts, self.rollout_monitor)
        self.implausible = 0
        """Number of predictions withheld because no vehicle can move like that."""
        self.reset()

    def reset(self) -> None:
        """Forget all samples and adaptation; keep the count of implausible predictions."""
        self.online.reset()
        if self.rollout_monitor is not None:
            self.rollout_monitor.reset()
        self._published.reset()
        self.status = Status.WARMING_UP
        self._n_samples = 0
        self._last_ns: int | None = None
        self._coasted = 0
        self._stale_ticks = 0
        self._uncertain_ticks = 0
        self._withheld_in_succession = 0
        self._predicted: FloatArray | None = None
        self._predicted_by_model: FloatArray | None = None
        self._coasted_to: FloatArray | None = None
        self._consecutive_valid_samples = 0
        self._memory.reset()

    @property
    def horizon_covariance(self) -> FloatArray:
        """
        Covariance (steps, 3, 3) of measured minus predicted state under known commands, SI.

        From the monitored rollouts of about the last half minute, initially from validation.
        Scaled to coverage: 90 % of the errors lie within 1.645 standard deviations. Empty for a
        model that has neither.
        """
        if self.rollout_monitor is None:
            return self.model.horizon_covariance
        scale = self.model.scaling.x_scale
        return np.asarray(self.rollout_monitor.covariance * np.outer(scale, scale))

    @property
    def held_input_covariance(self) -> FloatArray:
        """
        Covariance (horizon_steps, 3, 3) of the published horizons, under constant commands, SI.

        From the horizons published in about the last half minute, initially from validation.
        """
        return self._published.covariance

    @property
    def held_input_shrinkage(self) -> FloatArray:
        """Shrinkage (horizon_steps, 3) of the published horizons, see `published_horizons`."""
        return self._published.shrinkage

    @property
    def filtered_state(self) -> FloatArray:
        """The observer's state (3,) after the last sample, SI; while coasting, the model's."""
        return np.array(self._memory.filtered)

    @property
    def present_state(self) -> FloatArray:
        """State (3,) that the prediction starts from, SI: the observer's, or the predicted one."""
        return self.filtered_state if self._coasted_to is None else self._coasted_to.copy()

    @property
    def disturbance(self) -> FloatArray:
        """Disturbance (3,) as acceleration: m/s², m/s², rad/s²."""
        scaling = self.model.scaling
        unit = scaling.step_scale * scaling.x_scale / (TICK_NS * 1e-9)
        return np.asarray(self._memory.disturbance[:2].sum(axis=0) * unit)

    def step(self, sample: Sample, with_horizon: bool = True) -> Prediction | None:
        """
        Take the sample of one tick and return the prediction, or None; `status` says why.

        Samples come in time order. A gap in the grid or a RESTART flag resets the predictor.
        Without `with_horizon` the prediction is one step long, which saves most of the time; the
        tenth one, which is compared with what follows, is complete nevertheless.
        """
        gap = self._last_ns is not None and sample.stamp_ns != self._last_ns + TICK_NS
        if gap or sample.flags & _RESTART:
            self.reset()
        self._last_ns = sample.stamp_ns
        if not (math.isfinite(sample.u[0]) and math.isfinite(sample.u[1])):
            self._lose_state()
            return None
        measured = not sample.flags & _COASTING and math.isfinite(sum(sample.x))
        self._stale_ticks = self._stale_ticks + 1 if sample.flags & _ODOMETRY_STALE else 0
        # Odometry that arrives late at every sample corrects more than nothing does.
        is_new = not self._stale_ticks or self._stale_ticks > self.max_coast_steps
        trusted = measured and is_new and not sample.flags & _REJECTED
        self._uncertain_ticks = 0 if trusted else self._uncertain_ticks + 1
        if measured:
            self._coasted = 0
            self._coasted_to = None
            state = np.array(sample.x)
        else:
            self._coasted += 1
            if self._predicted is None or self._coasted > self.max_coast_steps:
                self._lose_state()
                return None
            state = self._coasted_to = self._predicted
        return self._advance(sample, state, measured, self.horizon_steps if with_horizon else 0)

    def rollout(self, u_ahead: FloatArray) -> FloatArray:
        """
        Predict states (h, 3) under known commands `u_ahead` (h, 2), SI, from the last sample.

        The first command is the one in force at that sample.
        :raises RuntimeError: the last step made no prediction.
        """
        if self._predicted is None or self.status is Status.IMPLAUSIBLE:
            raise RuntimeError("no state to predict from")
        result = self._model_rollout.run(
            self.online.theta,
            self.model.scaling.scale_u(u_ahead),
            u_ahead.shape[0],
            self.rollout_monitor,
        )
        if result is None:
            return np.full((u_ahead.shape[0], 3), math.nan)
        if self._mixes:
            replace_by_naive(result, KNOWN, self._memory.rows)
        return result

    def roll_out_many(self, commands: ArrayLike) -> FloatArray:
        """
        Predict states (k, h, 3) under each of k candidate `commands` (k, h, 2), SI.

        As `rollout`, from the last sample with the adapted model; bit-identical to it, but several
        times as fast, as a sampling planner needs it. The first command of a candidate is the one
        in force at the last sample, so the states are those after it. At standstill, and where the
        limits of predicted motion act, the states are those of `rollout` as well.
        :raises UsageError: the shape is wrong, a command or a predicted state is not finite, or
            the last step made no prediction.
        """
        checked = checked_commands(commands, "(k, h, 2)")
        self._check_state()
        states, bad = self._model_rollout.run_many(
            self.online.theta, checked, self.rollout_monitor
        )
        if bad >= 0:
            raise unpredictable(checked[bad], f"candidate {bad}")
        return states

    def linearized(self, commands: ArrayLike) -> LinearizedRollout:
        """
        Return the local linear model along the rollout under `commands` (h, 2), SI.

        Matrices A (h, n, n), B (h, n, 2) and c (h, n): s_(j+1) = A_j s_j + B_j u_j + c_j, see
        `linearization`. Where a limit of predicted motion acts, they are those of the limit.
        :raises UsageError: as `roll_out_many`; or the model's encoder has no known derivatives.
        """
        checked = checked_commands(commands, "(h, 2)")
        self._check_state()
        result = self._model_rollout.linearized(self.online.theta, checked, self.rollout_monitor)
        if not all(np.isfinite(array).all() for array in result):
            raise unpredictable(checked, "this candidate")
        return result

    def roll_out_gradient(self, commands: ArrayLike, by_state: ArrayLike) -> FloatArray:
        """
        Return the gradient dJ/du (h, 2) of a cost J of the states predicted under `commands`.

        `by_state` (h, 3): dJ/dy at each predicted state, per m/s, m/s and rad/s. The result is per
        N·m and rad; `linearized(commands).jacobian()` is dy/du (h, 3, h, 2).
        :raises UsageError: as `linearized`; or `by_state` has a wrong shape or is not finite.
        """
        return self.linearized(commands).gradient(by_state)

    def _check_state(self) -> None:
        if self._predicted is None or self.status is Status.IMPLAUSIBLE:
            raise UsageError(
                f"no state to predict from ({self.status.value}): give the predictor samples "
                "until a step returns a prediction"
            )

    def _lose_state(self) -> None:
        self.status = Status.NO_STATE
        if self.rollout_monitor is not None:
            self.rollout_monitor.stop()
        self._published.stop()
        self._n_samples = 0
        self._predicted = None
        self._consecutive_valid_samples = 0
        self._memory.lose_state()

    def _advance(
        self, sample: Sample, state: FloatArray, measured: bool, horizon_steps: int
    ) -> Prediction | None:
        usable = measured and not sample.flags & _UNLEARNABLE
        if measured and sample.flags & _LEVEL_CHANGE:
            self._shift_past(state)
        self._n_samples += 1
        self._consecutive_valid_samples = self._consecutive_valid_samples + 1 if usable else 0
        warming_up = self._n_samples <= self.model.history
        predicted, innovation = _NO_PREDICTION, _NO_PREDICTION
        learns = False
        if self._predicted is not None:
            # The observer corrects the model, whoever predicts, and the model goes on alone.
            by_model = self._predicted_by_model
            predicted = self._predicted if by_model is None else by_model
            if measured:
                innovation = state - self._predicted
                # Both lifts of the pair, with their past samples, must be of learnable samples.
                enough = self._consecutive_valid_samples >= self.model.history + 2
                learns = enough and not warming_up
        if self._takes_samples:
            if measured:
                continues = not sample.flags & _LEVEL_CHANGE
                take_sample(state, sample.a, continues, self._memory.fallback)
            else:
                coast(sample.a, self._memory.fallback)
        # A repeated odometry reading says less than the prediction for this tick, for a while.
        corrects = measured and not 0 < self._stale_ticks <= self.max_coast_steps
        flags = self._tick_flags
        flags |= (0 if self._uncertain_ticks else IS_TRUSTED) | (IS_USABLE if usable else 0)
        flags |= (LEARNS if learns else 0) | (IS_WARMING_UP if warming_up else 0)
        gains = self._gains if corrects else self._prediction_only_gains
        given = TickInput(state, predicted, innovation, *sample.u, gains, flags)
        # A horizon to compare with what follows is complete, whatever is asked for.
        due = self._published.is_due(self._uncertain_ticks)
        computed_steps = self.horizon_steps if due else horizon_steps
        horizon = np.empty((max(computed_steps, 1), 3))
        slot = self._published.slot(computed_steps, self._uncertain_ticks)
        outcome = self._steps.advance(given, horizon, computed_steps, slot)
        if outcome == WARMING_UP:
            self.status = Status.WARMING_UP
            return None
        if outcome == NOT_FINITE:
            # Not reachable from finite samples with a valid model; if it happens, start again.
            self.reset()
            return None
        if outcome != PREDICTED:
            self._withhold(state, horizon[0])
            return None
        self._withheld_in_succession = 0
        # A copy: callers may write to what is returned.
        self._predicted = horizon[0].copy()
        if self._mixes:
            self._predicted_by_model = self._memory.fallback.of_model.copy()
        self.status = Status.PREDICTED if measured else Status.COASTING
        return Prediction(
            origin_ns=sample.stamp_ns,
            stamp_ns=sample.stamp_ns + TICK_NS,
            x=horizon[0],
            covariance=self._published_covariance(),
            horizon=horizon[:horizon_steps],
            horizon_covariance=self._published.issue(horizon_steps, self._uncertain_ticks),
            innovation=_NAN3 if innovation is _NO_PREDICTION else innovation,
            status=self.status,
        )

    def _shift_past(self, state: FloatArray) -> None:
        """
        Move the past states by the difference of `state` (3,) from its prediction.

        The jump of a new level is then no increment, which would be taken for a disturbance.
        """
        if self._predicted is not None:
            # The past states are the model's, also those that it predicted while coasting.
            by_model = self._predicted_by_model
            expected = self._predicted if by_model is None else by_model
            past = self._tick.x_past
            past += (state - expected) / self.model.scaling.x_scale
            self._predicted = state
            self._predicted_by_model = None
        # What was predicted before is of the level before.
        self._published.stop()
        if self.rollout_monitor is not None:
            self.rollout_monitor.stop()

    @property
    def uncertain_ticks(self) -> int:
        """Number of ticks since the last measurement that was trusted."""
        return self._uncertain_ticks

    @property
    def uncertainty_growth(self) -> FloatArray:
        """Variance (3,), SI, that ticks without a trusted measurement add to a prediction."""
        # A copy: for a read-only view numba would compile the gate again.
        return np.array(np.diag(self._growth())) if self._uncertain_ticks else _NO_GROWTH

    def _withhold(self, state: FloatArray, predicted: FloatArray) -> None:
        """Count an implausible prediction; discard the adaptation that leads to several."""
        self.implausible += 1
        self._withheld_in_succession += 1
        if self._withheld_in_succession >= _MAX_WITHHELD:
            self.reset()
        else:
            drivable = is_drivable(state, predicted[None])
            self._predicted = predicted.copy() if drivable else state.copy()
        self._predicted_by_model = None
        self.status = Status.IMPLAUSIBLE

    def _published_covariance(self) -> FloatArray:
        # Not the array itself: the predictor goes on to change it.
        covariance = self._memory.covariance
        return covariance + self._growth() if self._uncertain_ticks else covariance.copy()

    def _growth(self) -> FloatArray:
        """Return the covariance (3, 3) that ticks without a trusted measurement have added."""
        table = self.model.horizon_covariance
        if len(table):
            return np.asarray(table[min(self._uncertain_ticks, len(table) - 1)])
        return self._uncertain_ticks * self._memory.covariance
