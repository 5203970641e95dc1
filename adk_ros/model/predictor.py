# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
One tick of the predictor: sample in, prediction out. No clock, no files, no ROS.

    z_k = [x_k, features(x_k .. x_(k-p), u_(k-1) .. u_(k-p))]        lift
    e_k = x_k - (prediction made a tick ago)                         innovation, before the update
    theta <- online method, fed with the pair that has just become known
    x_(k+1) = x_k + s * (theta phi_k + d),  phi_k = [z_k; u_k; 1]    predict (residual form)
    x_(k+j): the same, lifted anew at each step, u held, d decaying  horizon

d is the disturbance: an exponentially weighted mean of what the adapted model left of the
increments. The live node, the replay and the trainer's validation all call `Predictor.step`.
"""

from __future__ import annotations

import math

import numpy as np

from adk_ros.errors import UsageError
from adk_ros.model.adaptation.online_methods import METHODS, OnlineSettings
from adk_ros.model.estimation.disturbance import ewma_covariance, regression_pair
from adk_ros.model.estimation.observer import observer_update
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.lifting.encoder import Float32Array, input_size
from adk_ros.model.lifting.encoder_kernels import (
    pack_encoder_input,
    pack_regressor,
    set_command,
    shift_in,
)
from adk_ros.model.prediction import Prediction, Status
from adk_ros.model.uncertainty import compiled_rollout
from adk_ros.model.uncertainty.error_regression import N_REGRESSORS
from adk_ros.model.uncertainty.published_horizons import PublishedHorizonErrors
from adk_ros.model.uncertainty.rollout_monitor import RolloutMonitor
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.channels import TICK_NS, UNLEARNABLE, Flag, Sample

_COVARIANCE_GAIN = 0.01
_MAX_PAIR = 1e3
_PRIOR_ROLLOUTS = 5.0
_NO_SHRINKAGE = np.ones((0, 3))
_NO_ERROR_REGRESSION = np.zeros((0, 3, N_REGRESSORS + 1))
# Plain integers: operations on flags themselves cost a microsecond each.
_RESTART, _COASTING, _UNLEARNABLE = int(Flag.RESTART), int(Flag.COASTING), int(UNLEARNABLE)
_ODOMETRY_STALE = int(Flag.ODOMETRY_STALE)
_NAN3 = np.full(3, math.nan)
_NAN3.flags.writeable = False


class Predictor:
    """
    Runs a model over samples, adapting it.

    :param online: settings of the online method; the model's own by default.
    :param horizon_steps: length of the horizon; 0 for none.
    :param max_coast_steps: without a measured state, go on from predictions for so many ticks.
    :raises UsageError: a setting is out of range.
    """

    def __init__(
        self,
        model: KoopmanModel,
        online: OnlineSettings | None = None,
        horizon_steps: int = 80,
        max_coast_steps: int = 40,
    ) -> None:
        if not 0 <= horizon_steps <= 400:
            raise UsageError(f"horizon is {horizon_steps} steps of 25 ms: choose 0 to 400")
        self.model = model
        self.settings = online or model.online
        self.online = METHODS[self.settings.method](model.theta0, self.settings)
        self.horizon_steps = horizon_steps
        self.max_coast_steps = max_coast_steps
        self._x_past = np.zeros((model.history + 1, 3))
        self._u_past = np.zeros((model.history, 2))
        self._row = np.zeros(input_size(model.history), dtype=np.float32)
        self._u = np.zeros(2)
        self._measured = np.zeros(3)
        self._observer_gains = model.observer_gains.table()
        self._prediction_only_gains = self._observer_gains.copy()
        self._prediction_only_gains[0] = 0.0
        self._phi = np.zeros(model.theta0.shape[1])
        self._y = np.zeros(model.n_z)
        # A view: the command now, as commands ahead that hold it.
        self._u_held = self._u[None]
        self._encoder = model.lifting.twin.arrays() if model.lifting.twin is not None else None
        self.rollout_monitor = _rollout_monitor(model)
        self._published = PublishedHorizonErrors(
            _held_input_errors(model, horizon_steps), _PRIOR_ROLLOUTS
        )
        self.reset()

    def reset(self) -> None:
        """Forget all samples and adaptation."""
        self.online.reset()
        if self.rollout_monitor is not None:
            self.rollout_monitor.reset()
        self._published.reset()
        self.status = Status.WARMING_UP
        self._known = 0
        self._last_ns: int | None = None
        self._coasted = 0
        self._predicted: FloatArray | None = None
        self._consecutive_valid_samples = 0
        # Slow and fast, and a running mean that is no part of the prediction.
        self._disturbance = np.zeros((3, 3))
        self._whiteness = np.zeros((3, 3))
        self._covariance = self._initial_covariance()

    def _initial_covariance(self) -> FloatArray:
        if len(self.model.horizon_covariance):
            return np.array(self.model.horizon_covariance[0])
        return np.diag(np.square(self.model.scaling.x_scale * self.model.scaling.step_scale))

    @property
    def horizon_covariance(self) -> FloatArray:
        """
        Covariance (steps, 3, 3) of measured less predicted state, by horizon, SI.

        What the trials of the last half minute showed, at first what validation found; under
        commands that are known, and calibrated: 90 % of the errors lie within 1.645 deviations.
        Empty for a model without either.
        """
        if self.rollout_monitor is None:
            return self.model.horizon_covariance
        scale = self.model.scaling.x_scale
        return np.asarray(self.rollout_monitor.covariance * np.outer(scale, scale))

    @property
    def held_input_covariance(self) -> FloatArray:
        """
        The same (horizon_steps, 3, 3) of the horizon as it is published, under held commands.

        What the horizons published in the last half minute showed, at first what validation found.
        """
        return self._published.covariance

    @property
    def filtered_state(self) -> FloatArray:
        """State (3,) as the observer has it after the last sample, SI."""
        return np.asarray(self._x_past[0] * self.model.scaling.x_scale + self.model.scaling.x_mean)

    @property
    def disturbance(self) -> FloatArray:
        """Disturbance (3,) as acceleration: m/s^2, m/s^2, rad/s^2."""
        scaling = self.model.scaling
        unit = scaling.step_scale * scaling.x_scale / (TICK_NS * 1e-9)
        return np.asarray(self._disturbance[:2].sum(axis=0) * unit)

    def step(self, sample: Sample) -> Prediction | None:
        """
        Take the sample of one tick; return the prediction, or None where there is none to make.

        Samples come in time order; a gap in the grid or a RESTART flag resets everything: the past
        no longer tells anything. `status` says why there is no prediction.
        """
        gap = self._last_ns is not None and sample.stamp_ns != self._last_ns + TICK_NS
        if gap or sample.flags & _RESTART:
            self.reset()
        self._last_ns = sample.stamp_ns
        if not (math.isfinite(sample.u[0]) and math.isfinite(sample.u[1])):
            self._lose_state()
            return None
        measured = not sample.flags & _COASTING and math.isfinite(sum(sample.x))
        if measured:
            self._coasted = 0
            state = np.array(sample.x)
        else:
            self._coasted += 1
            if self._predicted is None or self._coasted > self.max_coast_steps:
                self._lose_state()
                return None
            state = self._predicted
        return self._advance(sample, state, measured)

    def _lose_state(self) -> None:
        self.status = Status.NO_STATE
        if self.rollout_monitor is not None:
            self.rollout_monitor.stop()
        self._published.stop()
        self._known = 0
        self._predicted = None
        self._consecutive_valid_samples = 0

    def _advance(self, sample: Sample, state: FloatArray, measured: bool) -> Prediction | None:
        model, scaling = self.model, self.model.scaling
        # Until the sample is taken, this is the command of the tick that has passed.
        u_passed = self._u.copy()
        expected = _NAN3 if self._predicted is None else self._predicted
        # A held velocity tells less than what was predicted for this tick.
        held = sample.flags & _ODOMETRY_STALE
        observer_update(
            state,
            expected,
            self._prediction_only_gains if held else self._observer_gains,
            sample.u,
            scaling.x_mean,
            scaling.x_scale,
            scaling.u_mean,
            scaling.u_scale,
            self._measured,
            self._x_past,
            self._u_past,
            self._u,
            self._row,
            self._whiteness,
        )
        if self.rollout_monitor is not None:
            self.rollout_monitor.update(
                self._measured,
                u_passed,
                measured and not sample.flags & _UNLEARNABLE,
                3 * (model.history + 1),
                scaling.step_scale,
                model.residual,
                self._observer_gains,
            )
        self._known += 1
        self._consecutive_valid_samples = (
            self._consecutive_valid_samples + 1
            if measured and not sample.flags & _UNLEARNABLE
            else 0
        )
        if self._known <= model.history:
            self.status = Status.WARMING_UP
            return None
        features = self._lift()
        innovation = _NAN3
        if self._predicted is not None and measured:
            innovation = state - self._predicted
            # Both lifts of the pair, pasts included, must be of samples that may be learned from.
            if self._consecutive_valid_samples >= model.history + 2:
                self._learn(features, innovation)
        pack_regressor(self._x_past, features, self._u, model.affine, self._phi)
        if self.rollout_monitor is not None and measured:
            self.rollout_monitor.start(
                self._x_past, self._u_past, self.online.theta, model.affine, self._disturbance
            )
        horizon = self._rollout(self._u_held, max(self.horizon_steps, 1))
        if horizon is None:
            # Nothing here can yield this from finite samples; if it does, start afresh.
            self.reset()
            return None
        ahead = horizon[: self.horizon_steps]
        # A copy: what is handed out may be written to.
        self._predicted = horizon[0].copy()
        self.status = Status.PREDICTED if measured else Status.COASTING
        return Prediction(
            origin_ns=sample.stamp_ns,
            stamp_ns=sample.stamp_ns + TICK_NS,
            x=horizon[0],
            covariance=self._published_covariance(),
            horizon=ahead,
            horizon_covariance=self._published.tick(
                state, measured and not sample.flags & _UNLEARNABLE, ahead, self._coasted
            ),
            innovation=innovation,
            status=self.status,
        )

    def _lift(self) -> Float32Array:
        return self.model.lifting(self._row)

    def _learn(self, features: Float32Array, innovation: FloatArray) -> None:
        model = self.model
        usable = regression_pair(
            self._measured,
            features,
            self._phi,
            self.online.theta,
            model.scaling.step_scale,
            model.residual,
            self._observer_gains,
            self._disturbance,
            self._y,
            _MAX_PAIR,
        )
        if usable:
            self.online.update(self._phi, self._y)
            ewma_covariance(self._covariance, innovation, _COVARIANCE_GAIN)

    def _rollout(self, u_ahead: FloatArray, steps: int) -> FloatArray | None:
        """Scaled commands ahead, the last held -> states (steps, 3), SI; None if not finite."""
        model = self.model
        out = np.empty((steps, 3))
        theta = self.online.theta
        if not model.relift:
            compiled_rollout.rollout_linear(self._phi[: model.n_z], theta, u_ahead, out)
        elif self._encoder is not None:
            compiled_rollout.rollout_lifting(
                self._x_past,
                self._u_past,
                theta,
                model.scaling.step_scale,
                model.residual,
                model.affine,
                u_ahead,
                self._disturbance,
                self._observer_gains,
                *self._encoder,
                out,
            )
        else:
            self._rollout_by_torch(u_ahead, out)
        trials, scaling = self.rollout_monitor, model.scaling
        trust = _NO_SHRINKAGE if trials is None else trials.shrinkage
        weights = _NO_ERROR_REGRESSION if trials is None else trials.error_regression.weights
        finite = compiled_rollout.to_si(
            out,
            self._x_past[0],
            self._disturbance[None],
            weights,
            trust,
            scaling.x_mean,
            scaling.x_scale,
        )
        return out if finite else None

    def _rollout_by_torch(self, u_ahead: FloatArray, out: FloatArray) -> None:
        model = self.model
        x_past, u_past = self._x_past.copy(), self._u_past.copy()
        row, phi, push = self._row.copy(), self._phi.copy(), self._disturbance[:2].copy()
        for step in range(out.shape[0]):
            u = u_ahead[min(step, u_ahead.shape[0] - 1)]
            pack_encoder_input(x_past, u_past, row)
            set_command(row, 3 * x_past.shape[0], u[0], u[1])
            phi[:3] = x_past[0]
            phi[3 : model.n_z] = model.lifting(row)
            phi[model.n_z : model.n_z + 2] = u
            change = (self.online.theta[:3] @ phi + push.sum(axis=0)) * model.scaling.step_scale
            push *= self._observer_gains[[2, 4]]
            new = np.clip(change + x_past[0] if model.residual else change, -50.0, 50.0)
            shift_in(x_past, new)
            shift_in(u_past, u)
            out[step] = new

    def rollout(self, u_ahead: FloatArray) -> FloatArray:
        """
        Predict under known commands, u_ahead (h, 2) in SI units, from the last sample taken.

        Return (h, 3); the first command is the one in force at that sample.
        :raises RuntimeError: the last step made no prediction.
        """
        if self._predicted is None:
            raise RuntimeError("no state to predict from")
        result = self._rollout(self.model.scaling.scale_u(u_ahead), u_ahead.shape[0])
        return np.full((u_ahead.shape[0], 3), math.nan) if result is None else result

    def _published_covariance(self) -> FloatArray:
        covariance: FloatArray = self._covariance.copy()
        if self._coasted:
            table = self.model.horizon_covariance
            if len(table):
                covariance += table[min(self._coasted, len(table) - 1)]
            else:
                covariance *= 1.0 + self._coasted
        return covariance


def _rollout_monitor(model: KoopmanModel) -> RolloutMonitor | None:
    """Trials for a model that can have them: lifted anew at each step, by the compiled twin."""
    if model.lifting.twin is None or not model.relift or not len(model.mean_square_change):
        return None
    scale = model.scaling.x_scale
    change = model.mean_square_change / scale**2
    errors = change[:, :, None] * np.eye(3)
    if len(model.horizon_covariance):
        errors = model.horizon_covariance / np.outer(scale, scale)
    return RolloutMonitor(model.lifting.twin.arrays(), errors, _PRIOR_ROLLOUTS)


def _held_input_errors(model: KoopmanModel, steps: int) -> FloatArray:
    """
    Covariance (steps, 3, 3), SI, that the horizon under held commands begins with.

    The model's, its last row held where the horizon is longer; if it has none, of so many usual
    steps.
    """
    for table in (model.held_input_covariance, model.horizon_covariance):
        if len(table):
            return np.asarray(table[np.minimum(np.arange(steps), len(table) - 1)])
    usual = np.square(model.scaling.x_scale * model.scaling.step_scale)
    return np.asarray(np.diag(usual) * np.arange(1, steps + 1)[:, None, None])
