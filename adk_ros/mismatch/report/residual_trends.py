# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Select the residual channel and the variable that show an effect most clearly.

A variable u of the recording is cut into bins of equal count. For a channel with residual e and
noise s, the score of a figure is the sum over bins of n (mean(e_before)² - mean(e_after)²) / s²:
the reduction of the binned means by the correction, in units of the noise. The figure shows the
channel with the highest score, and the variable with the highest score of those in `EXPLAINS`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from adk_ros.mismatch.inference.feature_effect import state_equations
from adk_ros.mismatch.inference.result import IdentifiedEffect, ResidualSeries
from adk_ros.mismatch.library.effect import PLACE
from adk_ros.mismatch.library.features import feature
from adk_ros.mismatch.recording.sensor_log import CHANNELS
from adk_ros.mismatch.report.vocabulary import unit_text
from adk_ros.mismatch.surrogate.feature_terms import FeatureTerm
from adk_ros.mismatch.surrogate.residuals import BIN_S
from adk_ros.numerics.arrays import BoolArray, FloatArray

BINS = 20
"""Bins of equal count along a variable."""
PLACE_BINS = 60
"""Bins of equal count along the lap."""
SETTLING_BINS = 25
"""40 ms bins at the beginning that are not shown: the simulation is settling."""
SPREAD_PERCENTILES = (16.0, 84.0)
"""Percentiles of the residuals in a bin between which their spread is drawn."""


def _rate(values: FloatArray) -> FloatArray:
    return np.asarray(np.gradient(values, BIN_S))


class Variable(NamedTuple):
    """A variable to draw residuals against: axis label, and its values for a series."""

    label: str
    of: Callable[[ResidualSeries], FloatArray]


VARIABLES: dict[str, Variable] = {
    "time": Variable("time (s)", lambda s: s.time_s),
    "speed": Variable("speed (m/s)", lambda s: s.signals["v_x"]),
    "speed_squared": Variable("speed squared (m²/s²)", lambda s: s.signals["v_x"] ** 2),
    "torque": Variable("commanded wheel torque (N·m)", lambda s: s.signals["torque"]),
    "power": Variable(
        "commanded wheel torque times speed (N·m²/s)",
        lambda s: s.signals["torque"] * s.signals["v_x"],
    ),
    "torque_rate": Variable(
        "rate of the commanded wheel torque (N·m/s)", lambda s: _rate(s.signals["torque"])
    ),
    "angle": Variable("commanded road-wheel angle (rad)", lambda s: s.signals["delta"]),
    "angle_rate": Variable(
        "rate of the commanded road-wheel angle (rad/s)", lambda s: _rate(s.signals["delta"])
    ),
    "lateral": Variable("lateral acceleration (m/s²)", lambda s: s.signals["a_y"]),
    "lateral_fast": Variable(
        "lateral acceleration times speed squared (m³/s⁴)",
        lambda s: s.signals["a_y"] * s.signals["v_x"] ** 2,
    ),
    "lateral_rate": Variable(
        "rate of the lateral acceleration (m/s³)", lambda s: _rate(s.signals["a_y"])
    ),
    "yaw_rate": Variable("yaw rate (rad/s)", lambda s: s.signals["yaw_rate"]),
    "yaw_acceleration": Variable(
        "yaw acceleration (rad/s²)", lambda s: _rate(s.signals["yaw_rate"])
    ),
}

EXPLAINS: dict[str, tuple[str, ...]] = {
    "aero_drag": ("speed_squared",),
    "headwind": ("speed",),
    "rolling_resistance": ("speed",),
    "crosswind": ("speed",),
    "aero_downforce": ("lateral_fast",),
    "low_friction": ("lateral",),
    "front_tyre_stiffness": ("angle", "lateral"),
    "rear_tyre_stiffness": ("lateral",),
    "tyre_relaxation": ("angle_rate", "lateral_rate"),
    "load_sensitivity": ("lateral",),
    "payload": ("torque", "yaw_acceleration"),
    "cg_shift": ("lateral",),
    "yaw_inertia": ("yaw_acceleration", "angle_rate"),
    "rotating_inertia": ("torque",),
    "steering_offset": ("speed",),
    "steering_ratio": ("angle", "lateral"),
    "steering_delay": ("angle_rate",),
    "steering_lag": ("angle_rate",),
    "steering_backlash": ("angle_rate",),
    "compliance_steer": ("lateral",),
    "rear_wheel_steer": ("angle", "lateral"),
    "drive_torque_gain": ("torque",),
    "brake_torque_gain": ("torque",),
    "drive_torque_delay": ("torque_rate",),
    "drive_torque_lag": ("torque_rate",),
    "torque_offset": ("torque",),
    "power_limit": ("power",),
    "wheel_radius": ("torque",),
    "brake_drag_one_side": ("speed",),
    "clock_offset": ("torque_rate", "angle_rate"),
    "imu_bias": ("time",),
    "imu_tilt": ("time",),
    "imu_lever_arm": ("yaw_acceleration", "yaw_rate"),
    "gyro_scale": ("yaw_rate",),
    "imu_delay": ("lateral_rate", "torque_rate"),
    "odometry_scale": ("speed",),
    "odometry_filter": ("yaw_acceleration",),
}
"""Effect -> candidate variables to draw it against; an effect that is missing here: all."""

_OF_EQUATION = {
    "v_x": ("imu_a_x", "v_x"),
    "v_y": ("imu_a_y", "v_y"),
    "yaw_rate": ("imu_yaw_rate", "yaw_rate"),
    "imu": ("imu_a_x", "imu_a_y", "imu_yaw_rate"),
    "odometry": ("v_x", "v_y", "yaw_rate"),
}
_SAME_SCALE = 1e-9


@dataclass(frozen=True)
class Trend:
    """
    A residual in k bins of a variable, before and after the correction.

    `at`, `before`, `after`: (k,) bin means of the variable and of the residuals; `before_sides`,
    `after_sides`: (2, k) the percentiles `SPREAD_PERCENTILES`; `noise` of a 40 ms bin.
    """

    channel: str
    label: str
    at: FloatArray
    before: FloatArray
    after: FloatArray
    before_sides: FloatArray
    after_sides: FloatArray
    noise: float
    score: float


def trend(
    series: ResidualSeries,
    channel: str,
    label: str,
    u: FloatArray,
    use: BoolArray,
    bins: int = BINS,
    without: str = "",
) -> Trend:
    """
    Average the residual of a channel in bins of the variable u (b,), over the bins in `use` (b,).

    "Before" is the corrected model without the effect named `without` if several effects are
    identified, and the uncorrected surrogate otherwise.
    """
    row = CHANNELS.index(channel)
    uncorrected = series.without.get(without, series.before)
    before, after = uncorrected[row][use], series.after[row][use]
    order = np.argsort(u[use], kind="stable")
    parts = [part for part in np.array_split(order, bins) if part.size]
    counts = np.array([part.size for part in parts], dtype=np.float64)

    def means(values: FloatArray) -> FloatArray:
        return np.array([values[part].mean() for part in parts])

    def sides(values: FloatArray) -> FloatArray:
        return np.asarray(
            np.array([np.percentile(values[part], SPREAD_PERCENTILES) for part in parts]).T
        )

    noise = max(float(series.noise[row]), _SAME_SCALE)
    mean_before, mean_after = means(before), means(after)
    score = float(np.sum(counts * (mean_before**2 - mean_after**2))) / noise**2
    return Trend(
        channel,
        label,
        means(u[use]),
        mean_before,
        mean_after,
        sides(before),
        sides(after),
        noise,
        score,
    )


def best_trend(
    series: ResidualSeries,
    variables: Sequence[tuple[str, FloatArray]],
    equations: Sequence[str],
    use: BoolArray,
    bins: int = BINS,
    without: str = "",
) -> Trend:
    """Return the trend with the highest score over channels of `equations` and variables."""
    channels = [c for equation in equations for c in _OF_EQUATION.get(equation, ())] or CHANNELS
    trends = [
        trend(series, channel, label, u, use, bins, without)
        for channel in channels
        for label, u in variables
    ]
    return max(trends, key=lambda item: item.score)


def active_bins(series: ResidualSeries, intervals: Sequence[Sequence[float]]) -> BoolArray:
    """Return which 40 ms bins (b,) lie in one of the intervals and after settling."""
    inside = np.zeros(series.time_s.shape[0], dtype=np.bool_)
    for begin, end in intervals:
        inside |= (series.time_s >= begin) & (series.time_s <= end)
    inside[:SETTLING_BINS] = False
    return inside


def effect_residual_trend(series: ResidualSeries, identified: IdentifiedEffect) -> Trend:
    """Return the trend of an effect where it is active; along the lap if it is local."""
    if identified.kind == PLACE and series.distance is not None:
        use = active_bins(series, [[-np.inf, np.inf]])
        along = [("distance along the lap (m)", series.distance)]
        name = identified.effect.name
        return best_trend(series, along, identified.effect.equations, use, PLACE_BINS, name)
    use = active_bins(series, identified.time_intervals_s)
    if np.count_nonzero(use) < 2 * BINS:
        use = active_bins(series, [[-np.inf, np.inf]])
    names = EXPLAINS.get(identified.effect.name, tuple(VARIABLES))
    variables = [(VARIABLES[name].label, VARIABLES[name].of(series)) for name in names]
    return best_trend(
        series, variables, identified.effect.equations, use, without=identified.effect.name
    )


def feature_residual_trend(series: ResidualSeries, term: FeatureTerm) -> Trend:
    """Return the trend of one feature term of the unexplained residual."""
    definition = feature(term.feature)
    u = definition.function(series.signals)
    if float(np.ptp(u)) == 0.0:
        label, u = "time (s)", series.time_s
    else:
        label = (
            f"{definition.description}, {unit_text(definition.expression)} "
            f"({unit_text(definition.unit)})"
        )
    use = active_bins(series, [[-np.inf, np.inf]])
    name = f"{term.equation}:{term.feature}"
    return best_trend(series, [(label, u)], state_equations(term.equation), use, without=name)
