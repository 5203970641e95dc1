# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Grade and bank along a drive, from IMU and odometry alone.

With the specific force (a_x, a_y) of an IMU that includes gravity (REP-145), velocities and yaw
rate r of odometry, and REP-103 axes,

    a_x = dv_x/dt - r v_y + g sin(grade) + disturbances
    a_y = dv_y/dt + r v_x + g sin(bank) + disturbances

with grade positive uphill and bank positive where the left side is higher. The constants of the
disturbances are estimated with the slopes: offset of the IMU; pitch and roll of the body, which
follow the load transfer and thus the specific force; turned axes, lever arm r² x - dr/dt y, delay
of the IMU; and, where v_y is not measured, the sideslip of the reference point, v_y = r l - K r
v_x².
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import GRAVITY, QUANTILE_90
from adk_ros.road.places import (
    Places,
    Track,
    along_the_way,
    find_places,
    match_radius,
)
from adk_ros.road.recorded_drive import (
    MIN_STEPS,
    RecordedDrive,
    Steps,
    in_steps,
    middle,
)
from adk_ros.road.slope_rows import Axis
from adk_ros.road.smoother import MAX_KNOTS, SlopeModel, Slopes, Variances

STANDING_SPEED = 0.3
"""m/s below which the car stands, where wheel speeds have a dead band."""
SPACING_S = 0.25
"""s at the median speed from knot to knot; the walk is continuous over more than one step."""
MIN_POSE_SHARE = 0.5
"""Length of the path of the pose over the distance driven by v_x: less is a pose that does not
follow the car, such as a receiver without a fix."""

OFFSET_PRIOR = 0.35
"""m/s²: offset of an automotive MEMS accelerometer (0.1) and 2° of a housing that is levelled by
eye (0.34), added as variances."""
PITCH_PER_FORCE, ROLL_PER_FORCE = 0.04, 0.07
"""Share of gravity in a_x, a_y per share of specific force, by pitch and roll of the body: 2.3 and
4°/g (T. D. Gillespie, Fundamentals of Vehicle Dynamics, 1992, section 7)."""
FORCE_PRIOR = 0.03
"""Standard deviation of both; covers 0 (an IMU that is levelled) to 0.09, and 3 % of scale."""
TURNED_PRIOR = 0.05
"""rad: mounting yaw of the IMU, 3°."""
LEVER_PRIOR = 1.5
"""m between IMU and odometry's reference point: half of a wheelbase."""
SLIP_PRIOR = 0.005
"""s²/m: sideslip angle per lateral acceleration at a rear axle, m l_f / (C_r l); 0.003 for a
passenger car."""
DELAY_PRIOR = 0.1
"""s between the streams; one period of a satellite receiver at 10 Hz."""
_BODY = 1
"""Index of the share of the specific force among the constants."""
MIN_INFORMATION = 4.0
"""Information on it with shared places over that without: most of it is from repeated places."""
_PRIOR = (OFFSET_PRIOR, FORCE_PRIOR, TURNED_PRIOR, LEVER_PRIOR, LEVER_PRIOR, DELAY_PRIOR)
START = Variances(reading=1e-3, force=1e-3, walk=1e-3)
"""Start of the search for the variances: 0.03 m/s, 0.03 m/s² over 1 s, 0.3 % of grade per m."""


@dataclass(frozen=True)
class SlopeProfile:
    """
    Grade or bank (n,), rad, in the direction of the car, with its 90 % interval (n,).

    Half-widths of 90 % intervals: `level` of its mean, `relative` of the difference from it
    (median), rad; `scale` of a factor on all values, by the pitch or roll of the body;
    `offset_error` of the `offset` of the IMU, m/s².
    """

    value: FloatArray
    low: FloatArray
    high: FloatArray
    level: float
    relative: float
    scale: float
    offset: float
    offset_error: float


@dataclass(frozen=True)
class RoadProfile:
    """
    Grade and bank at the n nodes at which the car moves.

    `at_s`, `distance`, `place` (n,), s and m; `direction` (n,): +1 in the direction of the first
    pass, -1 against it; `x`, `y` (n,), m, None without a pose. `level_by`: what separates the
    level of the grade from the offset of the IMU, empty if nothing does. `assumed`: for the
    person. `repeated`: share of the distance on road that was driven before. `grade_variances`:
    of the noise and of the walk of the grade.
    """

    at_s: FloatArray
    distance: FloatArray
    place: FloatArray
    direction: FloatArray
    x: FloatArray | None
    y: FloatArray | None
    grade: SlopeProfile
    bank: SlopeProfile
    level_by: str
    assumed: tuple[str, ...]
    repeated: float
    grade_variances: Variances


def road_profile(drive: RecordedDrive) -> RoadProfile | None:
    """Return grade and bank along a drive; None if the car moves for less than `MIN_STEPS`."""
    steps = _moving_steps(drive)
    if steps is None:
        return None
    spacing = _spacing(steps)
    places = _places(steps, spacing, True)
    along = _along(steps, drive.v_y is not None)
    variances = _model(along, places, steps, spacing).fitted(START)
    grade = _slopes(along, places, steps, spacing, variances, True)
    # A crowned road falls to the right in either direction: bank is shared in one alone.
    one_way = _places(steps, spacing, False)
    across = _across(steps, drive.v_y is not None)
    bank_variances = _model(across, one_way, steps, spacing).fitted(START)
    bank = _slopes(across, one_way, steps, spacing, bank_variances, False)
    kept = steps.readings > 0
    return RoadProfile(
        steps.at_s[kept],
        steps.distance[kept],
        places.place[kept],
        places.direction[kept],
        None if steps.x is None else steps.x[kept],
        None if steps.y is None else steps.y[kept],
        _profile(grade, kept),
        _profile(bank, kept),
        _level_by(places),
        _assumed(drive),
        places.repeated,
        variances,
    )


def road_grade(drive: RecordedDrive, variances: Variances) -> tuple[FloatArray, FloatArray] | None:
    """
    Return stamps and grade (n,), s and rad, with known variances; None as `road_profile`.

    The search for the variances takes most of the time of a profile.
    """
    steps = _moving_steps(drive)
    if steps is None:
        return None
    spacing = _spacing(steps)
    along = _along(steps, drive.v_y is not None)
    grade = _slopes(along, _places(steps, spacing, True), steps, spacing, variances, True)
    kept = steps.readings > 0
    return steps.at_s[kept], _profile(grade, kept).value


def _moving_steps(drive: RecordedDrive) -> Steps | None:
    steps = in_steps(drive, STANDING_SPEED)
    return None if steps is None or int(steps.used.sum()) < MIN_STEPS else steps


def _spacing(steps: Steps) -> float:
    moving = np.abs(steps.v_x[steps.readings > 0])
    longest = float(steps.distance[-1]) / MAX_KNOTS
    return max(SPACING_S * float(np.median(moving)), longest)


def _places(steps: Steps, spacing: float, both_directions: bool) -> Places:
    ahead = _ahead(steps)
    if steps.x is None or steps.y is None or steps.heading is None:
        return along_the_way(steps.distance, ahead)
    moved = float(np.hypot(np.diff(steps.x), np.diff(steps.y)).sum())
    if moved < MIN_POSE_SHARE * float(steps.distance[-1]):
        return along_the_way(steps.distance, ahead)
    moving = steps.readings > 0
    radius = match_radius(steps.v_x[moving], steps.yaw_rate[moving])
    track = Track(steps.distance, steps.x, steps.y, steps.heading, ahead)
    places = find_places(track, radius, 2.0 * spacing, both_directions)
    if float(places.place.max()) > 2.0 * MAX_KNOTS * spacing:
        # A pose that jumps makes a new stretch each time: it shows no place reliably.
        return along_the_way(steps.distance, ahead)
    return places


def _along(steps: Steps, has_v_y: bool) -> Axis:
    """Return the equation of v_x."""
    columns = [
        np.full(steps.force_x.size, steps.step_s),
        steps.step_s * middle(steps.longitudinal),
        steps.step_s * middle(steps.lateral),
        -steps.yaw_rate_2,
        -np.diff(steps.yaw_rate),
        np.diff(steps.longitudinal),
    ]
    prior = list(_PRIOR)
    if not has_v_y:
        columns.append(steps.yaw_rate_2 * middle(steps.v_x) ** 2)
        prior.append(SLIP_PRIOR)
    gained = steps.force_x + steps.turn_x
    return _axis(steps, steps.v_x, gained, columns, prior, PITCH_PER_FORCE)


def _across(steps: Steps, has_v_y: bool) -> Axis:
    """Return the equation of v_y, whose reading is zero where it is not measured."""
    columns = [
        np.full(steps.force_y.size, steps.step_s),
        steps.step_s * middle(steps.lateral),
        steps.step_s * middle(steps.longitudinal),
        np.diff(steps.yaw_rate),
        -steps.yaw_rate_2,
        np.diff(steps.lateral),
    ]
    prior = list(_PRIOR)
    if not has_v_y:
        columns.append(np.diff(steps.yaw_rate * steps.v_x**2))
        prior.append(SLIP_PRIOR)
    return _axis(steps, steps.v_y, steps.force_y - steps.turn_y, columns, prior, ROLL_PER_FORCE)


def _axis(
    steps: Steps,
    velocity: FloatArray,
    gained: FloatArray,
    columns: list[FloatArray],
    prior: list[float],
    body: float,
) -> Axis:
    expected = np.zeros(len(prior))
    expected[_BODY] = body
    return Axis(
        velocity,
        steps.readings,
        gained,
        np.column_stack(columns),
        expected,
        np.array(prior),
        np.zeros(len(prior), dtype=bool),
        steps.used,
        steps.step_s,
    )


def _model(axis: Axis, places: Places, steps: Steps, spacing: float) -> SlopeModel:
    return SlopeModel(axis, places, np.gradient(steps.distance) * _ahead(steps), spacing)


def _ahead(steps: Steps) -> FloatArray:
    return np.where(steps.v_x < 0.0, -1.0, 1.0)


def _slopes(
    axis: Axis, places: Places, steps: Steps, spacing: float, variances: Variances, is_height: bool
) -> Slopes:
    shared = _model(axis, places, steps, spacing).information(variances)
    once = along_the_way(steps.distance, _ahead(steps))
    single = _model(axis, once, steps, spacing).information(variances)
    # With a driver who slows down uphill, pitch of the body and slope are confounded. Only
    # different accelerations at the same place separate them.
    considered = axis.considered.copy()
    considered[_BODY] = shared[_BODY] < MIN_INFORMATION * single[_BODY]
    model = _model(replace(axis, considered=considered), places, steps, spacing)
    # The car returns to a place within the radius, on a slope of up to 10 %.
    height_sigma = 0.1 * places.radius if is_height and places.returns else None
    return model.slopes(variances, height_sigma)


def _profile(slopes: Slopes, kept: np.ndarray) -> SlopeProfile:
    # Body pitch and roll follow the load transfer, which gravity along the road causes as well.
    body = 1.0 + float(slopes.constants[_BODY])
    theta = slopes.theta[kept] / body
    sigma = np.hypot(slopes.sigma[kept], theta * slopes.constant_sigma[_BODY]) / body

    def angle(values: FloatArray) -> FloatArray:
        return np.asarray(np.arcsin(np.clip(values / GRAVITY, -1.0, 1.0)))

    return SlopeProfile(
        angle(theta),
        angle(theta - QUANTILE_90 * sigma),
        angle(theta + QUANTILE_90 * sigma),
        QUANTILE_90 * slopes.level_sigma / GRAVITY,
        QUANTILE_90 * float(np.median(slopes.relative_sigma[kept])) / GRAVITY,
        QUANTILE_90 * float(slopes.constant_sigma[_BODY]) / body,
        float(slopes.constants[0]),
        QUANTILE_90 * float(slopes.constant_sigma[0]),
    )


def _level_by(places: Places) -> str:
    known = []
    if places.opposite > 0.0:
        known.append(f"both directions ({places.opposite:.0%} of the way)")
    if places.returns:
        known.append("equal heights where the path closes")
    return " and ".join(known)


def _assumed(drive: RecordedDrive) -> tuple[str, ...]:
    out = ["gravity is included in the accelerations"]
    if drive.v_y is None:
        out.append("v_y is not measured and taken as r l - K r v_x²")
    if drive.x is None or drive.heading is None:
        out.append("no pose: a profile over time, no place is known to repeat")
    return tuple(out)
