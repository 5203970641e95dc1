# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What a recording's channels can carry, and what is therefore not asked of it.

Without an IMU there is nothing to hold odometry against, so that no sensor's fault can be found,
and gravity cannot be told from a force. A drive command that is no torque (a pedal, a
share) says nothing of forces along the car. And a published yaw rate may be a low-pass of the
heading's change: what comes late in it need not come late in the car. The filter is looked for
where there is no gyro to compare with: the heading, passed through a low-pass, against the
integral of the yaw rate.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from adk_ros.errors import DataError
from adk_ros.mismatch.inference.decision import Decision
from adk_ros.mismatch.inference.forward_selection import SelectionPath
from adk_ros.mismatch.inference.likelihood import MIN_SPEED, Likelihood
from adk_ros.mismatch.inference.result import UNKNOWN, MissingChannel, UnexplainedResidual
from adk_ros.mismatch.inference.unmodelled import fit_feature_expansion
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.features import FEATURES
from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.mismatch.recording.sensor_log import CHANNELS, SensorLog
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.differentiation import savitzky_golay

YAW_FILTER_GRID_S = np.arange(0.0, 1.51, 0.025)
"""Time constants that are tried, s."""
MIN_YAW_FILTER_S = 0.1
_MAX_FILTER_MISFIT = 0.5
"""A filter must leave no more than this share of the difference."""
_STEP_S = 0.02
_COMPARISON_STEPS = 50
"""Steps over which turns are compared: drift of the yaw rate does not count."""
_MIN_SPEED = 3.0
MIN_TORQUE_TO_INERTIA_RATIO = 0.2
"""A torque makes for at least this share of the largest accelerations."""

GRAVITY_EFFECTS = ("road_grade", "road_bank")
"""Effects that only an accelerometer, which does not feel them, tells from a force."""
MAX_NORMALISED_LOSS = 2.0
"""Where this many times a perfect model's loss is left, no effect is named of a narrow scope."""

PHASE_LAG_EFFECTS = (
    "steering_delay",
    "steering_lag",
    "steering_backlash",
    "tyre_relaxation",
    "yaw_inertia",
    "clock_offset",
    "odometry_filter",
)
"""Effects that show as a yaw rate that comes late."""


@dataclass(frozen=True)
class ObservableEffects:
    """`yaw_filter_s`: time constant with which the published yaw rate is low-passed, if it is."""

    imu: bool = True
    torque: bool = True
    yaw_filter_s: float = 0.0

    @property
    def is_complete(self) -> bool:
        """Whether nothing is lacking."""
        return self.imu and self.torque and self.yaw_filter_s == 0.0

    @property
    def unobservable(self) -> frozenset[str]:
        """Return the effects, features and equations that are not asked for."""
        out: set[str] = set()
        if not self.imu:
            out |= {e.name for e in EFFECTS.values() if e.sensor} | set(GRAVITY_EFFECTS)
        if not self.torque:
            out |= {e.name for e in EFFECTS.values() if "v_x" in e.equations}
            out |= {name for name in FEATURES if "torque" in name}
            out.add("v_x")
        if self.yaw_filter_s > 0.0:
            out |= set(PHASE_LAG_EFFECTS)
        return frozenset(out)

    def missing_channels(self) -> list[MissingChannel]:
        """Return what is lacking, what follows from it, and what would make more possible."""
        out = []
        if not self.imu:
            out.append(
                MissingChannel(
                    "an IMU",
                    "the recording has no IMU: odometry alone is judged, and what only an"
                    " accelerometer or a gyro tells (slopes, banks, faults of sensors) is not; record"
                    " sensor_msgs/msg/Imu",
                )
            )
        if not self.torque:
            out.append(
                MissingChannel(
                    "a torque command",
                    "the drive command is no torque (it is a requested acceleration, or far too small"
                    " to move the car, like a pedal's position): nothing is claimed of forces along"
                    " the car; record the wheel torque in N m",
                )
            )
        if self.yaw_filter_s > 0.0:
            out.append(
                MissingChannel(
                    "an unfiltered yaw rate",
                    "the published yaw rate is the heading's change through a low-pass of about "
                    f"{self.yaw_filter_s:.2g} s: it was taken into account, and no delay, lag or yaw"
                    " inertia is read from it; record a gyro",
                )
            )
        return out

    def withhold_if_underexplained(
        self, verdict: Decision, likelihood: Likelihood, found: SelectionPath
    ) -> Decision:
        """
        Return a verdict that names no effects where much is left that they do not explain.

        With all channels, what is left is itself evidence; with few, effects bend to take it in.
        """
        left = verdict.hypothesis.cost / max(found.expected_loss, 1.0)
        if self.is_complete or left < MAX_NORMALISED_LOSS:
            return verdict
        rest = fit_feature_expansion(
            likelihood, found.levels[0][0], found.expected_loss, found.null_excess_loss
        )
        said = UnexplainedResidual(
            rest.equations, round(rest.share, 3), rest.text(), rest.expression(), rest.terms
        )
        return Decision(UNKNOWN, [], said, rest.hypothesis, rest)

    def with_yaw_filter(self, plain: SurrogateModel) -> SurrogateModel:
        """Return a stand-in whose odometry reports as the recording's does."""
        if self.yaw_filter_s == 0.0:
            return plain
        p = plain.parameters.copy()
        p[INDEX["odometry_lag"]] = self.yaw_filter_s
        return replace(plain, parameters=p)

    def masked(self, likelihood: Likelihood) -> Likelihood:
        """Return a likelihood that is silent on what is not asked for."""
        if self.is_complete:
            return likelihood
        weights = likelihood.weights.copy()
        if not self.imu:
            weights[:3] = 0.0
        if not self.torque:
            weights[[CHANNELS.index("imu_a_x"), CHANNELS.index("v_x")]] = 0.0
        return replace(likelihood, weights=weights, unobservable=self.unobservable)


def observable_effects(
    recording: SensorLog, mass: float, wheel_radius: float, imu: bool = True
) -> ObservableEffects:
    """
    Return what a recording's channels can carry, for a car of about this mass.

    `imu`: whether it has one of its own, and not been `filled`.

    Raises `DataError` where it has neither an IMU nor steering that it could be judged by.
    """
    e = recording
    # A torque inferred from a requested acceleration is no evidence about longitudinal forces.
    torque = not e.torque_is_inferred and _is_torque(e, mass, wheel_radius)
    if not torque and np.ptp(e.command[:, 1]) == 0.0:
        raise DataError(
            f"{e.name}: the drive command is no torque and the steering is constant: there is "
            "nothing that the car's motion could be held against; record the wheel torque in N m"
        )
    return ObservableEffects(imu, torque, 0.0 if imu else yaw_filter(e))


def with_pseudo_imu(recording: SensorLog) -> SensorLog:
    """
    Return a recording without an IMU as if it had one that says what odometry implies.

    What computes with an IMU then has one; `Scope.narrowed` gives it no weight.
    """
    e = recording
    if e.imu_s.size:
        return e
    at = np.arange(e.odometry_s[0] + 0.005, e.odometry_s[-1], 0.01)
    v_x, v_y, rate = (
        np.interp(at, e.odometry_s, savitzky_golay(e.odometry[:, i])) for i in range(3)
    )
    implied = [np.gradient(v_x, at) - rate * v_y, np.gradient(v_y, at) + rate * v_x, rate]
    return replace(e, imu_s=at, imu=np.column_stack(implied))


def longest_moving_segment(recording: SensorLog) -> SensorLog:
    """
    Return the longest part of a recording in which the car moves.

    Standing it tells nothing, and what it is told to do then may be anything.
    """
    moves = np.concatenate([[False], recording.odometry[:, 0] > MIN_SPEED, [False]])
    edges = np.flatnonzero(np.diff(moves.astype(np.int8)))
    if not edges.size:
        return recording
    ends = np.append(recording.odometry_s, recording.odometry_s[-1] + 1e-6)
    longest = int(np.argmax(ends[edges[1::2]] - ends[edges[::2]]))
    begin, end = float(ends[edges[2 * longest]]), float(ends[edges[2 * longest + 1]])
    return replace(recording.between(begin, end), duration_s=end)


def _is_torque(e: SensorLog, mass: float, wheel_radius: float) -> bool:
    v_x = savitzky_golay(e.odometry[:, 0])
    along = np.abs(np.gradient(v_x, e.odometry_s))
    felt = float(np.percentile(along[v_x > _MIN_SPEED], 99.0)) if (v_x > _MIN_SPEED).any() else 0.0
    most = float(np.percentile(np.abs(e.command[:, 0]), 99.0)) / (wheel_radius * mass)
    return most > MIN_TORQUE_TO_INERTIA_RATIO * felt


def yaw_filter(e: SensorLog) -> float:
    """
    Return the time constant in s with which the yaw rate is a low-pass of the heading's change.

    Zero where a plain rate fits as well: r = d psi/dt, low-passed, is the change of psi,
    low-passed, so that both are compared over turns of a second without a derivative.
    """
    at = np.arange(e.odometry_s[0], e.odometry_s[-1], _STEP_S)
    heading = np.interp(at, e.odometry_s, e.pose[:, 2])
    rate = np.interp(at, e.odometry_s, e.odometry[:, 2])
    moving = np.interp(at, e.odometry_s, e.odometry[:, 0]) > _MIN_SPEED
    turned = savitzky_golay(np.cumsum(rate) * _STEP_S)
    use = moving[_COMPARISON_STEPS:] & moving[:-_COMPARISON_STEPS]
    if np.count_nonzero(use) < 10 * _COMPARISON_STEPS:
        return 0.0
    turns = (turned[_COMPARISON_STEPS:] - turned[:-_COMPARISON_STEPS])[use]
    left = []
    for tau in YAW_FILTER_GRID_S:
        passed = savitzky_golay(_low_pass(heading, float(tau)))
        left.append(
            float(
                np.median(
                    np.abs(turns - (passed[_COMPARISON_STEPS:] - passed[:-_COMPARISON_STEPS])[use])
                )
            )
        )
    best = int(np.argmin(left))
    if YAW_FILTER_GRID_S[best] < MIN_YAW_FILTER_S or left[best] > _MAX_FILTER_MISFIT * left[0]:
        return 0.0
    return float(YAW_FILTER_GRID_S[best])


def _low_pass(values: FloatArray, tau: float) -> FloatArray:
    """Return a first-order low-pass of evenly sampled values (n,)."""
    if tau <= 0.0:
        return values
    keep = float(np.exp(-_STEP_S / tau))
    out = np.empty_like(values)
    now = float(values[0])
    for k, value in enumerate(values.tolist()):
        now = value + (now - value) * keep
        out[k] = now
    return out
