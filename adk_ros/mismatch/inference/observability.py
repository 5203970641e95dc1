# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Observability: which effects the recorded channels can show.

- Without an IMU, odometry has no second source: sensor faults are not observable, and gravity is
  not distinguishable from a force.
- A drive command that is no torque (a pedal position, an acceleration) carries no information
  about longitudinal forces.
- Without a lateral velocity, the model's own takes its place: forces show in the accelerations and
  the yaw rate alone.
- Without steering, nothing is known of the lateral motion; a coast-down has none. In bends,
  nothing is known of longitudinal forces either: the tyres' side forces slow the car down.
- A published yaw rate may be the low-pass filtered derivative of the heading; its phase lag is
  then not the vehicle's. Without a gyro, the filter is identified by comparing the low-pass
  filtered heading with the integral of the yaw rate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from adk_ros.calibration.scope import Possible, Scope
from adk_ros.mismatch.inference.channel_roles import CHANNEL_ROLES, ChannelRole
from adk_ros.mismatch.inference.decision import Decision
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.result import UNKNOWN, MissingChannel
from adk_ros.mismatch.inference.selection_path import SelectionPath
from adk_ros.mismatch.inference.unmodelled import fit_feature_expansion
from adk_ros.mismatch.library.criteria import (
    MAX_FILTER_MISFIT,
    MAX_NORMALISED_LOSS,
    MIN_SPEED,
    MIN_TORQUE_TO_INERTIA_RATIO,
    MIN_YAW_FILTER_S,
)
from adk_ros.mismatch.library.sensitivity import decided
from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.mismatch.recording.checks import turns
from adk_ros.mismatch.recording.sensor_log import CHANNELS, SensorLog
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.differentiation import savitzky_golay
from adk_ros.numerics.filters import low_pass
from adk_ros.signals.channels import STATE_NAMES

YAW_FILTER_GRID_S = np.arange(0.0, 1.51, 0.025)
"""Time constants that are tried, s."""
_STEP_S = 0.02
_COMPARISON_STEPS = 50
"""Heading changes are compared over 1 s, so that drift of the yaw rate does not count."""
_MIN_COMPARISONS = 10
"""Least number of such intervals in motion."""
_EXTREME_PERCENTILE = 99.0
_PSEUDO_IMU_OFFSET_S, _PSEUDO_IMU_PERIOD_S = 0.005, 0.01

PHASE_LAG_EFFECTS = (
    "steering_delay",
    "steering_lag",
    "steering_backlash",
    "tyre_relaxation",
    "yaw_inertia",
    "clock_offset",
    "odometry_filter",
)
"""Effects that appear as a phase lag of the yaw rate."""


@dataclass(frozen=True)
class ObservableEffects:
    """
    The informative channels of a recording.

    `yaw_filter_s`: time constant of the low-pass filter of the published yaw rate; 0 without one.
    """

    imu: bool = True
    torque: bool = True
    yaw_filter_s: float = 0.0
    v_y: bool = True
    steering: bool = True
    known_bends: bool = True
    """Whether no bend is driven with a torque but without a steering angle."""

    @property
    def is_excited(self) -> bool:
        """Whether a command says what moves the car in some equation."""
        return self.steering or (self.torque and self.known_bends)

    @property
    def _lost(self) -> list[ChannelRole]:
        """What is lost with the channels that are missing."""
        return [role for name, role in CHANNEL_ROLES.items() if not getattr(self, name)]

    @property
    def is_complete(self) -> bool:
        """Whether all channels are available and unfiltered."""
        return not self._lost and self.yaw_filter_s == 0.0

    @property
    def unobservable(self) -> frozenset[str]:
        """Effects, features and equations that the channels do not show."""
        out = frozenset().union(*(role.unobservable for role in self._lost))
        if not self.v_y and not self.imu:
            # Of two lateral equations, one measurement.
            out |= {"v_y"}
        if self.yaw_filter_s > 0.0:
            out = out.union(PHASE_LAG_EFFECTS)
        return out

    def not_predicted(self) -> list[str]:
        """Return the states whose prediction needs a channel that the recording lacks."""
        lost = {state for role in self._lost for state in role.states}
        return [name for name in STATE_NAMES if name in lost]

    def scope(self, rows: Sequence[Scope]) -> list[Scope]:
        """Return what the channels allow, with the states that this analysis does not judge."""
        lacking = {
            f"judge {state.replace('_rate', ' rate')}": role.missing
            for role in self._lost
            for state in role.states
        }
        return [
            replace(
                row,
                possible=Possible.NO,
                why=row.why or f"analysed without {lacking[row.name].what}",
                needs=row.needs or lacking[row.name].what,
            )
            if row.name in lacking
            else row
            for row in rows
        ]

    def missing_channels(self) -> list[MissingChannel]:
        """Return the missing channels, with the consequence and the remedy of each."""
        out = [role.missing for role in self._lost]
        if self.yaw_filter_s > 0.0:
            out.append(
                MissingChannel(
                    "an unfiltered yaw rate",
                    "the published yaw rate is low-pass filtered with a time constant of about "
                    f"{self.yaw_filter_s:.2g} s: the filter is compensated, and delay, lag and yaw"
                    " inertia are not analysed; record a gyro",
                )
            )
        return out

    def withhold_if_underexplained(
        self, decision: Decision, likelihood: Likelihood, path: SelectionPath
    ) -> Decision:
        """
        Return a decision without effects where channels are missing and much is unexplained.

        With all channels the excess loss is evidence in itself; with few, effects fit it.
        """
        normalised_loss = decision.hypothesis.loss / max(path.expected_loss, 1.0)
        if self.is_complete or decided(
            lambda ratio: normalised_loss < ratio, MAX_NORMALISED_LOSS=MAX_NORMALISED_LOSS
        ):
            return decision
        features = fit_feature_expansion(
            likelihood, path.levels[0][0], path.expected_loss, path.null_excess_loss
        )
        return Decision(UNKNOWN, [], features.unexplained(), features.hypothesis, features)

    def lost_channels(self) -> list[int]:
        """Return the indices of the residuals' channels that do not count."""
        lost = {name for role in self._lost for name in role.residuals}
        return [CHANNELS.index(name) for name in sorted(lost)]

    def adapted(self, surrogate: SurrogateModel) -> SurrogateModel:
        """
        Return the surrogate with the recording's yaw-rate filter.

        Without a torque its known error is left out: that depends on the torque.
        """
        if not self.torque:
            surrogate = replace(surrogate, systematic=None)
        if self.yaw_filter_s == 0.0:
            return surrogate
        p = surrogate.parameters.copy()
        p[INDEX["odometry_lag"]] = self.yaw_filter_s
        return replace(surrogate, parameters=p)

    def masked(self, likelihood: Likelihood) -> Likelihood:
        """Return the likelihood with zero weight on uninformative channels."""
        if self.is_complete:
            return likelihood
        weights = likelihood.weights.copy()
        weights[self.lost_channels()] = 0.0
        return replace(likelihood, weights=weights, unobservable=self.unobservable)


def observable_effects(
    recording: SensorLog, mass: float, wheel_radius: float, imu: bool = True
) -> ObservableEffects:
    """
    Return which effects a recording's channels can show, for a car of about this mass.

    `imu`: whether the recording has a real IMU, not one of `with_pseudo_imu`.
    """
    log = recording
    # A torque inferred from a requested acceleration is no evidence about longitudinal forces.
    torque = not log.torque_is_inferred and is_torque(log, mass, wheel_radius)
    steering = bool(np.ptp(log.command[:, 1]) > 0.0)
    filter_s = 0.0 if imu or not steering else yaw_filter(log)
    known_bends = steering or not torque or not turns(log)
    return ObservableEffects(imu, torque, filter_s, log.measures_v_y, steering, known_bends)


def with_pseudo_imu(recording: SensorLog) -> SensorLog:
    """
    Return a recording without an IMU with an IMU computed from odometry.

    Code that needs an IMU then runs; `ObservableEffects.masked` gives it no weight.
    """
    log = recording
    if log.imu_s.size:
        return log
    begin_s, end_s = log.odometry_s[0] + _PSEUDO_IMU_OFFSET_S, log.odometry_s[-1]
    at_s = np.arange(begin_s, end_s, _PSEUDO_IMU_PERIOD_S)
    v_x, v_y, rate = (
        np.interp(at_s, log.odometry_s, savitzky_golay(log.odometry[:, i], log.odometry_period_s))
        for i in range(3)
    )
    imu = [np.gradient(v_x, at_s) - rate * v_y, np.gradient(v_y, at_s) + rate * v_x, rate]
    return replace(log, imu_s=at_s, imu=np.column_stack(imu))


def longest_moving_segment(recording: SensorLog) -> SensorLog:
    """
    Return the longest part of a recording faster than `MIN_SPEED`.

    A stationary car carries no information, and its commands may be arbitrary.
    """
    moving = np.concatenate(
        [[False], recording.odometry[:, 0] > recording.similar(MIN_SPEED), [False]]
    )
    edges = np.flatnonzero(np.diff(moving.astype(np.int8)))
    if not edges.size:
        return recording
    ends = np.append(recording.odometry_s, recording.odometry_s[-1] + 1e-6)
    longest = int(np.argmax(ends[edges[1::2]] - ends[edges[::2]]))
    begin, end = float(ends[edges[2 * longest]]), float(ends[edges[2 * longest + 1]])
    return replace(recording.between(begin, end), duration_s=end)


def is_torque(log: SensorLog, mass: float, wheel_radius: float) -> bool:
    """Whether the command, taken for a torque, accounts for the largest accelerations."""
    if np.ptp(log.command[:, 0]) == 0.0:
        return False
    v_x = savitzky_golay(log.odometry[:, 0], log.odometry_period_s)
    acceleration = np.abs(np.gradient(v_x, log.odometry_s))
    moving = v_x > log.similar(MIN_SPEED)
    measured = (
        float(np.percentile(acceleration[moving], _EXTREME_PERCENTILE)) if moving.any() else 0.0
    )
    torque = float(np.percentile(np.abs(log.command[:, 0]), _EXTREME_PERCENTILE))
    return bool(
        decided(
            lambda ratio: torque / (wheel_radius * mass) > ratio * measured,
            MIN_TORQUE_TO_INERTIA_RATIO=MIN_TORQUE_TO_INERTIA_RATIO,
        )
    )


def yaw_filter(log: SensorLog) -> float:
    """
    Return the time constant in s of the low-pass filter of the yaw rate, 0 without one.

    The integral of a low-pass filtered rate is the low-pass filtered heading. Both are compared
    as changes over a second, so that no derivative is needed.
    """
    at_s = np.arange(log.odometry_s[0], log.odometry_s[-1], _STEP_S)
    heading = np.interp(at_s, log.odometry_s, log.pose[:, 2])
    rate = np.interp(at_s, log.odometry_s, log.odometry[:, 2])
    moving = np.interp(at_s, log.odometry_s, log.odometry[:, 0]) > log.similar(MIN_SPEED)
    counted = moving[_COMPARISON_STEPS:] & moving[:-_COMPARISON_STEPS]
    if np.count_nonzero(counted) < _MIN_COMPARISONS * _COMPARISON_STEPS:
        return 0.0

    def changes(angle: FloatArray) -> FloatArray:
        smooth = savitzky_golay(angle, _STEP_S)
        return np.asarray((smooth[_COMPARISON_STEPS:] - smooth[:-_COMPARISON_STEPS])[counted])

    integrated = changes(np.cumsum(rate) * _STEP_S)
    misfits = [
        float(np.median(np.abs(integrated - changes(low_pass(heading, _STEP_S, float(tau))))))
        for tau in YAW_FILTER_GRID_S
    ]
    best = int(np.argmin(misfits))
    tau = float(YAW_FILTER_GRID_S[best])
    absent = decided(
        lambda least_s, share: tau < least_s or misfits[best] > share * misfits[0],
        MIN_YAW_FILTER_S=MIN_YAW_FILTER_S,
        MAX_FILTER_MISFIT=MAX_FILTER_MISFIT,
    )
    return 0.0 if absent else tau
