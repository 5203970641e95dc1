# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Open-loop predictions by the stand-in: from what was measured so far, under known commands.

Up to each start the model runs along with odometry, drawn towards each message by a fixed gain;
from there on it runs alone. Measurements after a start are not used by it. A place is where the
car comes to by its own predicted speed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adk_ros.errors import DataError
from adk_ros.mismatch.deployment.surrogate_file import SurrogateFile
from adk_ros.mismatch.inference.likelihood import MIN_SPEED
from adk_ros.mismatch.library.features import feature_matrix
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.surrogate.activation import inside_segments
from adk_ros.mismatch.surrogate.equations_of_motion import integrate
from adk_ros.mismatch.surrogate.lap import distance_on_lap
from adk_ros.mismatch.surrogate.residuals import COMMAND_GRID_S, cumulative_command
from adk_ros.mismatch.surrogate.state_index import (
    A_X,
    A_Y,
    OUTPUTS,
    S_HEADING,
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
from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.signals.channels import TICK_NS

FIRST_START_S = 2.0
STEP_S = 0.005
STEPS_PER_TICK = 5
ASSIMILATION_GAINS = np.array([0.1, 0.15, 0.15])
"""Share of a message's difference that is made up at once: v_x, v_y, yaw rate."""
_MAX_DISTANCE_TO_LINE_M = 30.0
"""m; farther than this from a place's line, the car is somewhere else."""
_PASSES = 2
_ROAD_STRIDE = 20
"""Steps between two places of the road that are looked up."""
_BACKLASH_STATE = S_STEER_MORE + 1


@dataclass(frozen=True)
class _TermsAtActivation:
    """Terms at places: entries, amounts, and of each which place."""

    index: IntArray
    amount: FloatArray
    gate: IntArray


class OpenLoopPredictor:
    """A stand-in's file ready to predict along one drive."""

    def __init__(self, model: SurrogateFile, evidence: SensorLog) -> None:
        self.model = model
        self.evidence = evidence
        e = evidence
        end = float(max(e.odometry_s[-1], e.command_s[-1])) + 1.0
        self.torques = cumulative_command(e.command_s, e.command[:, 0], COMMAND_GRID_S, end)
        self.angles = cumulative_command(e.command_s, e.command[:, 1], COMMAND_GRID_S, end)
        placed = [term for term in model.terms if term.where.kind == "place"]
        self.places = [term.where for term in placed]
        base = model.vector()
        index, amount, gate = [], [], []
        for term in placed:
            for i, size in term.amounts(base):
                index.append(i)
                amount.append(size)
                gate.append(1 + self.places.index(term.where))
        self.road = model.road()
        if self.road is not None:
            # The curves along the simulator's road, in rows of gates after the places'.
            index += [int(i) for i in self.road.index]
            amount += [1.0] * len(self.road.entries)
            gate += [1 + len(self.places) + k for k in range(len(self.road.entries))]
        self.vector = model.acting()
        self.gated = _TermsAtActivation(
            np.array(index, dtype=np.int64),
            np.array(amount, dtype=np.float64),
            np.array(gate, dtype=np.int64),
        )
        self.names, self.coefficients = model.coefficients()
        self.lines = [np.array(place.line) for place in self.places]

    def _gates(self, s_of: list[FloatArray], poses: FloatArray) -> FloatArray:
        n = poses.shape[0]
        gates = np.ones((1 + len(self.places), n))
        for row, (place, s) in enumerate(zip(self.places, s_of, strict=True), start=1):
            where = tuple((a, b) for a, b in place.stretches)
            gates[row] = np.nan_to_num(inside_segments(s, where, place.lap or 1.0, place.edge))
        if self.road is None:
            return gates
        return np.vstack([gates, self.road.values_along(poses, _ROAD_STRIDE)])

    def _run(
        self,
        state: FloatArray,
        start: float,
        n: int,
        measured: FloatArray,
        gates: FloatArray,
        extra: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        out, states = np.empty((OUTPUTS, n)), np.empty((n + 1, 6))
        integrate(
            self.vector,
            self.gated.index,
            self.gated.amount,
            self.gated.gate,
            gates,
            self.torques,
            self.angles,
            COMMAND_GRID_S,
            start - float(self.evidence.command_s[0]),
            STEP_S,
            np.empty(0),
            measured,
            ASSIMILATION_GAINS,
            extra,
            state,
            out,
            states,
        )
        return out, states

    def _extra(self, out: FloatArray, start: float) -> FloatArray:
        """Return the correction (n, 3) along a run that was made without it, or with an older."""
        n = out.shape[1]
        at = start - float(self.evidence.command_s[0]) + STEP_S * np.arange(n + 1)
        grid = COMMAND_GRID_S * np.arange(self.torques.shape[0])
        torque = np.diff(np.interp(at, grid, self.torques)) / STEP_S
        delta = np.diff(np.interp(at, grid, self.angles)) / STEP_S
        signals = {
            "v_x": out[V_X],
            "v_y": out[V_Y],
            "yaw_rate": out[YAW_RATE],
            "a_x": out[A_X],
            "a_y": out[A_Y],
            "torque": torque,
            "delta": delta,
        }
        return np.ascontiguousarray(feature_matrix(self.names, signals) @ self.coefficients)

    def predict(self, starts_s: FloatArray, ticks: int, ticks_phase_s: float = 0.0) -> FloatArray:
        """
        Return (n, ticks, 3): v_x, v_y, yaw rate at 1 to `ticks` ticks after each start.

        `starts_s` (n,) ascending, seconds from the bag's first message.
        """
        e = self.evidence
        out = np.empty((starts_s.shape[0], ticks, 3))
        now = max(float(starts_s[0]) - 3.0, float(e.odometry_s[0]))
        now = float(starts_s[0]) - STEP_S * np.floor((float(starts_s[0]) - now) / STEP_S)
        state = np.zeros(STATE_SIZE)
        first = max(int(np.searchsorted(e.odometry_s, now + 1e-9)) - 1, 0)
        state[[S_V_X, S_V_Y, S_YAW_RATE]] = e.odometry[first]
        angle = e.command[max(int(np.searchsorted(e.command_s, now + 1e-9)) - 1, 0), 1]
        state[[S_STEER, S_STEER_MORE, _BACKLASH_STATE]] = angle
        ahead = ticks * STEPS_PER_TICK
        silent = np.full((ahead, 3), np.nan)
        none = np.empty((0, 3))
        for i, start in enumerate(starts_s):
            n = round((start - now) / STEP_S)
            if n > 0:
                state = self._assimilate(state, now, n)
            now = float(start)
            s0 = self._places_at(now)
            way = state[S_V_X] * STEP_S * (np.arange(ahead) + 0.5)
            along = [s + way for s in s0]
            state[[S_X, S_Y, S_HEADING]] = self._pose_at(now)
            poses = np.repeat(state[None, [S_X, S_Y, S_HEADING]], ahead, axis=0)
            poses[:, 0] += way * np.cos(poses[:, 2])
            poses[:, 1] += way * np.sin(poses[:, 2])
            extra = none
            bound = self.places or self.names or self.road is not None
            for _ in range(1 + (_PASSES if bound else 0)):
                run, states = self._run(
                    state.copy(), now, ahead, silent, self._gates(along, poses), extra
                )
                along = [s + np.cumsum(run[V_X]) * STEP_S for s in s0]
                poses = states[:-1, 3:]
                if self.names:
                    extra = self._extra(run, now)
            out[i] = states[STEPS_PER_TICK::STEPS_PER_TICK, :3]
        return out

    def _assimilate(self, state: FloatArray, now: float, n: int) -> FloatArray:
        """Return the state after `n` steps along with the measurements of that time."""
        e = self.evidence
        measured = np.full((n, 3), np.nan)
        first, last = np.searchsorted(e.odometry_s, [now + 1e-9, now + n * STEP_S + 1e-9])
        # A message counts in the step that it falls into: never before it is there.
        row = np.clip(((e.odometry_s[first:last] - now) / STEP_S - 1e-6).astype(int), 0, n - 1)
        measured[row] = e.odometry[first:last]
        along = [
            np.full(n, s) + state[S_V_X] * STEP_S * (np.arange(n) + 0.5)
            for s in self._places_at(now)
        ]
        gates = self._gates(
            along, self._poses_until(np.asarray(now + STEP_S * np.arange(1, n + 1)))
        )
        before = state.copy()
        out, _ = self._run(state, now, n, measured, gates, np.empty((0, 3)))
        if self.names:
            state = before
            self._run(state, now, n, measured, gates, self._extra(out, now))
        return state

    def _poses_until(self, at_s: FloatArray) -> FloatArray:
        """Return the poses (n, 3) at times, by what was measured until the last of them."""
        e = self.evidence
        last = max(int(np.searchsorted(e.odometry_s, at_s[-1] + 1e-9)), 1)
        first = max(int(np.searchsorted(e.odometry_s, at_s[0])) - 1, 0)
        seen = slice(min(first, last - 1), last)
        return np.column_stack(
            [np.interp(at_s, e.odometry_s[seen], e.pose[seen, i]) for i in range(3)]
        )

    def _pose_at(self, now: float) -> FloatArray:
        """Return the last pose (3,) before `now`, moved on by its velocity since."""
        e = self.evidence
        i = max(int(np.searchsorted(e.odometry_s, now + 1e-9)) - 1, 0)
        x, y, heading = e.pose[i]
        since, (v_x, v_y, rate) = now - e.odometry_s[i], e.odometry[i]
        cos, sin = np.cos(heading), np.sin(heading)
        moved = [v_x * cos - v_y * sin, v_x * sin + v_y * cos, rate]
        return np.asarray([x, y, heading] + since * np.array(moved))

    def _places_at(self, now: float) -> list[FloatArray]:
        """Return the distance along each place's lap by the last pose before `now`, or NaN."""
        e = self.evidence
        i = max(int(np.searchsorted(e.odometry_s, now + 1e-9)) - 1, 0)
        since = now - e.odometry_s[i]
        return [
            np.asarray(
                distance_on_lap(line, place.lap or 1.0, e.pose[i], _MAX_DISTANCE_TO_LINE_M)
                + since * e.odometry[i, 0]
            )
            for place, line in zip(self.places, self.lines, strict=True)
        ]


def start_times_of(evidence: SensorLog, ticks: int, stride_s: float, from_s: float) -> FloatArray:
    """
    Return starts (n,): every `stride_s` from `from_s` on, on the tick grid, commands known.

    Raises `DataError` where there is none.
    """
    phase = (-evidence.start_ns % TICK_NS) * 1e-9
    tick = TICK_NS * 1e-9
    last = min(evidence.duration_s, float(evidence.command_s[-1]) + 2.0 * tick) - ticks * tick
    wanted = np.arange(from_s, last + 1e-9, stride_s)
    starts = np.unique(phase + tick * np.ceil((wanted - phase) / tick - 1e-6))
    starts = starts[starts <= last + 1e-9]
    # A start needs a measurement just before it.
    before = np.searchsorted(evidence.odometry_s, starts + 1e-9) - 1
    fresh = (before >= 0) & (starts - evidence.odometry_s[np.maximum(before, 0)] < 0.1)
    starts = starts[fresh]
    if starts.size == 0:
        raise DataError(
            f"{evidence.name}: from no start after {from_s:g} s are commands known for "
            f"{ticks * tick:g} s: give a longer bag, or a shorter --horizon"
        )
    return np.asarray(starts)


def horizon_rmse(
    model: SurrogateFile,
    evidence: SensorLog,
    horizon_s: float,
    from_s: float,
    stride_s: float = 0.5,
) -> FloatArray:
    """
    Return the root mean square error (3,) at the end of the horizon, on a part of a drive.

    Of a car that moves; NaN where it stands all the time.
    """
    ticks = round(horizon_s / (TICK_NS * 1e-9))
    starts = start_times_of(evidence, ticks, stride_s, max(from_s, FIRST_START_S))
    predicted = OpenLoopPredictor(model, evidence).predict(starts, ticks)[:, -1]
    at = starts + horizon_s
    inside = at <= evidence.odometry_s[-1]
    measured = np.column_stack(
        [np.interp(at, evidence.odometry_s, evidence.odometry[:, i]) for i in range(3)]
    )
    begun = np.interp(starts, evidence.odometry_s, evidence.odometry[:, 0])
    inside &= np.minimum(np.abs(measured[:, 0]), np.abs(begun)) > MIN_SPEED
    if not inside.any():
        return np.full(3, np.nan)
    return np.asarray(np.sqrt(np.mean((predicted - measured)[inside] ** 2, axis=0)))
