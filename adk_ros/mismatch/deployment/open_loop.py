# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Open-loop predictions by the surrogate model, under known commands.

Up to each start the model follows odometry: every message corrects the state by a fixed gain. From
the start on it runs open loop; later measurements are not used, but for v_x where no torque says
what moves the car. Position-dependent terms are evaluated at the predicted position. A yaw rate
that odometry filters is predicted as it is published (`odometry_signals`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from adk_ros.mismatch.deployment.odometry_signals import with_lag, without_lag
from adk_ros.mismatch.deployment.position_terms import PositionTerms
from adk_ros.mismatch.deployment.surrogate_file import SurrogateFile
from adk_ros.mismatch.library.features import feature_matrix
from adk_ros.mismatch.library.parametric_features import has_memory, has_unlimited_memory
from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.surrogate.command_integrals import integrate_commands
from adk_ros.mismatch.surrogate.measured_slopes import slope_terms
from adk_ros.mismatch.surrogate.run_inputs import (
    ActiveTerms,
    RunBuffers,
    RunInputs,
    no_extra,
    open_loop_inputs,
    run_buffers,
)
from adk_ros.mismatch.surrogate.state_index import (
    A_X,
    A_Y,
    E_X,
    S_HEADING,
    S_PLAY,
    S_STEER,
    S_STEER_MORE,
    S_V_X,
    S_V_Y,
    S_X,
    S_Y,
    S_YAW_RATE,
    STATE_SIZE,
    V_X,
    V_Y,
    YAW_RATE,
)
from adk_ros.mismatch.surrogate.substeps import integrate_in_substeps
from adk_ros.numerics.arrays import FloatArray

STEP_S = 0.005
STEPS_PER_TICK = 5
ASSIMILATION_GAINS = np.array([0.1, 0.15, 0.15])
"""Share of the innovation that a message corrects: v_x, v_y, yaw rate. Empirical."""
_WARM_UP_S = 3.0
"""s of measurements assimilated before the first start."""
_MEMORY_S = 20.0
"""
s of signals that features with a memory take into account, and that are assimilated first; wear
takes all signals since the start into account.
"""
_PASSES = 2
"""Runs repeated with the position and features of the run before."""


class OpenLoopPredictor:
    """
    A surrogate's file prepared for predictions along one recording.

    `yaw_filter_s`: time constant of the filter of the recorded yaw rate, None: that of the model.
    `v_x_is_given`: v_x follows the recording, also ahead.
    """

    def __init__(
        self,
        model: SurrogateFile,
        log: SensorLog,
        yaw_filter_s: float | None = None,
        v_x_is_given: bool = False,
    ) -> None:
        self.log = log
        end_s = float(max(log.odometry_s[-1], log.command_s[-1])) + 1.0
        self.commands = integrate_commands(log.command_s, log.command, end_s)
        self.parameters = model.vector_with_terms()
        lag = INDEX["odometry_lag"]
        self._lag_s = float(self.parameters[lag]) if yaw_filter_s is None else yaw_filter_s
        # Removed here from the messages; the run itself has no filter.
        self.parameters[lag] = 0.0
        self._odometry = log.odometry.copy()
        self._odometry[:, 2] = without_lag(log.odometry_s, log.odometry[:, 2], self._lag_s)
        self._v_x_is_given = v_x_is_given
        self._road = log.road
        measured = () if log.road is None else log.road.entries
        self.position_terms = PositionTerms(model, measured)
        self.features, self.coefficients = model.feature_coefficients()
        # What is not measured follows from the rest.
        self._gains = ASSIMILATION_GAINS * [1.0, float(log.measures_v_y), 1.0]
        if v_x_is_given:
            self._gains[0] = 1.0
        self._warm_up_s = _WARM_UP_S
        self._history: dict[str, FloatArray] | None = None
        """Signals before the present start, for features with a memory."""
        self._memory_s = _MEMORY_S
        if any(has_memory(name) for name in self.features):
            if any(has_unlimited_memory(name) for name in self.features):
                self._memory_s = np.inf
            self._warm_up_s, self._history = self._memory_s, {}

    def predict(self, starts_s: FloatArray, ticks: int) -> FloatArray:
        """
        Return (n, ticks, 3): v_x, v_y, yaw rate at 1 to `ticks` ticks after each start.

        `starts_s` (n,) ascending, seconds from the bag's first message.
        """
        out = np.empty((starts_s.shape[0], ticks, 3))
        for i, run in enumerate(self.runs(starts_s, ticks)):
            out[i] = run.end_states[STEPS_PER_TICK::STEPS_PER_TICK, :3]
            if self._lag_s > 0.0:
                rate = self.published_yaw_rate(run, float(starts_s[i]))
                out[i, :, 2] = rate[STEPS_PER_TICK - 1 :: STEPS_PER_TICK]
        return out

    def published_yaw_rate(self, run: RunBuffers, start_s: float) -> FloatArray:
        """Return the yaw rate (n,) that odometry would publish in a run, as it filters it."""
        rate: FloatArray = run.output[YAW_RATE]
        if self._lag_s <= 0.0:
            return rate
        last = _last_before(self.log.odometry_s, start_s)
        age = start_s - float(self.log.odometry_s[last])
        value = float(self.log.odometry[last, 2])
        value += -np.expm1(-age / self._lag_s) * (float(rate[0]) - value)
        return with_lag(rate, value, self._lag_s, STEP_S)

    def runs(self, starts_s: FloatArray, ticks: int) -> Iterator[RunBuffers]:
        """Yield the open-loop run of `ticks` ticks from each start (n,), ascending."""
        now, state = self._initial_state(float(starts_s[0]))
        for start in starts_s:
            n = round((start - now) / STEP_S)
            if n > 0:
                state = self._assimilate(state, now, n)
            now = float(start)
            yield self._predict_from(state, now, ticks * STEPS_PER_TICK)

    def _initial_state(self, first_start: float) -> tuple[float, FloatArray]:
        """Return the time and state (STATE_SIZE,) at which assimilation begins."""
        log = self.log
        earliest = max(first_start - self._warm_up_s, float(log.odometry_s[0]))
        now = first_start - STEP_S * np.floor((first_start - earliest) / STEP_S)
        state = np.zeros(STATE_SIZE)
        state[[S_V_X, S_V_Y, S_YAW_RATE]] = self._odometry[_last_before(log.odometry_s, now)]
        angle = log.command[_last_before(log.command_s, now), 1]
        state[[S_STEER, S_STEER_MORE, S_PLAY]] = angle
        return now, state

    def _predict_from(self, state: FloatArray, now: float, n: int) -> RunBuffers:
        """Return an open-loop run of `n` steps; sets the pose of `state`."""
        at_start = self._distances_at(now)
        travelled = state[S_V_X] * STEP_S * (np.arange(n) + 0.5)
        distances = [s + travelled for s in at_start]
        pose_entries = [S_X, S_Y, S_HEADING]
        state[pose_entries] = self._pose_at(now)
        poses = np.repeat(state[None, pose_entries], n, axis=0)
        poses[:, 0] += travelled * np.cos(poses[:, 2])
        poses[:, 1] += travelled * np.sin(poses[:, 2])
        extra = np.empty((0, 3))
        is_iterative = bool(self.features) or not self.position_terms.is_empty
        for _ in range(1 + (_PASSES if is_iterative else 0)):
            inputs = open_loop_inputs(
                self.commands, self._since_first_command(now), STEP_S, n, extra
            )
            if self._v_x_is_given:
                measured = np.full((n, 3), np.nan)
                measured[:, 0] = self._recorded_v_x(now, n)
                inputs = inputs._replace(measured=measured, observer_gains=self._gains)
            run = self._run(state.copy(), self._terms(distances, poses, now), inputs)
            distances = [s + np.cumsum(run.output[V_X]) * STEP_S for s in at_start]
            poses = run.end_states[:-1, E_X:]
            if self.features:
                extra = self._feature_accelerations(run.output, now)
        return run

    def _assimilate(self, state: FloatArray, now: float, n: int) -> FloatArray:
        """Return the state after `n` steps with the measurements of that time."""
        log = self.log
        measured = np.full((n, 3), np.nan)
        first, last = np.searchsorted(log.odometry_s, [now + 1e-9, now + n * STEP_S + 1e-9])
        # A message counts in the step that contains its stamp, never earlier.
        row = np.clip(((log.odometry_s[first:last] - now) / STEP_S - 1e-6).astype(int), 0, n - 1)
        measured[row] = self._odometry[first:last]
        if self._v_x_is_given:
            measured[:, 0] = self._recorded_v_x(now, n)
        distances = [
            np.full(n, s) + state[S_V_X] * STEP_S * (np.arange(n) + 0.5)
            for s in self._distances_at(now)
        ]
        poses = self._poses_until(np.asarray(now + STEP_S * np.arange(1, n + 1)))
        terms = self._terms(distances, poses, now)
        inputs = RunInputs(
            self.commands,
            self._since_first_command(now),
            STEP_S,
            prescribed_v_x=np.empty(0),
            measured=measured,
            observer_gains=self._gains,
            extra=no_extra(),
        )
        before = state.copy()
        run = self._run(state, terms, inputs)
        if self.features:
            extra = self._feature_accelerations(run.output, now)
            run = self._run(before, terms, inputs._replace(extra=extra))
            self._remember(self._signals(run.output, now))
        return run.state

    def _recorded_v_x(self, now: float, n: int) -> FloatArray:
        """Return the recorded v_x (n,) at the middles of `n` steps from `now`."""
        at_s = now + STEP_S * (np.arange(n) + 0.5)
        return np.asarray(np.interp(at_s, self.log.odometry_s, self.log.odometry[:, 0]))

    def _terms(self, distances: list[FloatArray], poses: FloatArray, now: float) -> ActiveTerms:
        """Return the terms along a run from `now`: of positions, and the measured slopes."""
        terms = self.position_terms.along(distances, poses)
        if self._road is None:
            return terms
        at_s = np.asarray(now + STEP_S * (np.arange(poses.shape[0]) + 0.5))
        return terms.merged_with(slope_terms(self._road, at_s))

    def _run(self, state: FloatArray, terms: ActiveTerms, inputs: RunInputs) -> RunBuffers:
        """Run from `state`, which is advanced in place."""
        buffers = run_buffers(state, terms.activations.shape[1], keep_end_states=True)
        integrate_in_substeps(self.parameters, terms, inputs, buffers)
        return buffers

    def _feature_accelerations(self, output: FloatArray, start: float) -> FloatArray:
        """Return what the features add (n, 4), see `RunInputs.extra`, from an earlier run."""
        signals, n = self._signals(output, start), output.shape[1]
        if self._history:
            signals = _joined(self._history, signals)
        table = feature_matrix(self.features, signals)[-n:]
        return np.ascontiguousarray(table @ self.coefficients)

    def _signals(self, output: FloatArray, start: float) -> dict[str, FloatArray]:
        """Return the signals (n,) of a run that begins at `start`."""
        n = output.shape[1]
        at_s = self._since_first_command(start) + STEP_S * np.arange(n + 1)
        grid_s = self.commands.spacing * np.arange(self.commands.torque.shape[0])
        return {
            "time": start + STEP_S * (np.arange(n) + 0.5),
            "v_x": output[V_X],
            "v_y": output[V_Y],
            "yaw_rate": output[YAW_RATE],
            "a_x": output[A_X],
            "a_y": output[A_Y],
            "torque": np.diff(np.interp(at_s, grid_s, self.commands.torque)) / STEP_S,
            "delta": np.diff(np.interp(at_s, grid_s, self.commands.angle)) / STEP_S,
        }

    def _remember(self, signals: dict[str, FloatArray]) -> None:
        """Append signals to the history, of which the last `_memory_s` are kept."""
        if self._history is None:
            return
        joined = _joined(self._history, signals) if self._history else signals
        kept = round(min(self._memory_s, self.log.duration_s + 1.0) / STEP_S)
        self._history = {name: values[-kept:].copy() for name, values in joined.items()}

    def _since_first_command(self, now: float) -> float:
        return now - float(self.log.command_s[0])

    def _poses_until(self, at_s: FloatArray) -> FloatArray:
        """Return the poses (n, 3) at times, from measurements until the last of them."""
        log = self.log
        last = max(int(np.searchsorted(log.odometry_s, at_s[-1] + 1e-9)), 1)
        first = max(int(np.searchsorted(log.odometry_s, at_s[0])) - 1, 0)
        known = slice(min(first, last - 1), last)
        return np.column_stack(
            [np.interp(at_s, log.odometry_s[known], log.pose[known, i]) for i in range(3)]
        )

    def _pose_at(self, now: float) -> FloatArray:
        """Return the last pose (3,) before `now`, extrapolated by its velocity."""
        log = self.log
        i = _last_before(log.odometry_s, now)
        x, y, heading = log.pose[i]
        age, (v_x, v_y, rate) = now - log.odometry_s[i], log.odometry[i]
        cos, sin = np.cos(heading), np.sin(heading)
        velocity = [v_x * cos - v_y * sin, v_x * sin + v_y * cos, rate]
        return np.asarray([x, y, heading] + age * np.array(velocity))

    def _distances_at(self, now: float) -> list[FloatArray]:
        """Return the distance along each place's lap by the last pose before `now`, or NaN."""
        log = self.log
        i = _last_before(log.odometry_s, now)
        age = now - log.odometry_s[i]
        return self.position_terms.distances_at(log.pose[i], age * log.odometry[i, 0])


def _joined(
    earlier: Mapping[str, FloatArray], later: Mapping[str, FloatArray]
) -> dict[str, FloatArray]:
    """Return signals one after the other."""
    return {name: np.concatenate([earlier[name], values]) for name, values in later.items()}


def _last_before(stamps_s: FloatArray, now: float) -> int:
    """Return the index of the last stamp up to `now`, or 0."""
    return max(int(np.searchsorted(stamps_s, now + 1e-9)) - 1, 0)
