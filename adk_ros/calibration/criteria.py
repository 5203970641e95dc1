# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Constants that decide what `adk check` calls a finding.

The rule, for every estimated quantity: with d its distance from the nominal value,

- finding: |d| is at least `SIGNIFICANCE` standard errors and at least the material size;
- ok: no finding, and the 90 % interval is at most the material size to either side;
- not decidable: neither; the data do not tell.

"By choice" marks a convention without a derivation.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from adk_ros.numerics.constants import GRAVITY

PERIOD_S = 0.02
"""Period of the common grid, s: that of odometry at 50 Hz; by choice."""
BLOCK_S = 5.0
"""Length of a bootstrap block, s: longer than the memory of a car's response (yaw below 0.5 s,
speed control about 2 s), as H. R. Künsch (Annals of Statistics 17, 1989, 1217) requires."""
LONGER_BLOCKS_S = (BLOCK_S, 2.0 * BLOCK_S, 4.0 * BLOCK_S, 8.0 * BLOCK_S)
"""Lengths of blocks, s, among which the data choose where a sensor's errors last longer than a
car's response (satellite receivers, pressure sensors); doubled each time, by choice."""
USUAL_BLOCKS = 24
"""Blocks that a comparison of two recordings wants: a variance of 24 has an error of 30 %. Short
recordings get shorter blocks."""
MIN_BLOCK_S = 2.0
"""s: the shortest block; the memory of the speed control, the longest response of a car."""
RESAMPLES = 300
"""Bootstrap resamples: the standard error of a standard deviation is 4 %."""
MIN_SPARE_BLOCKS = 4
"""Blocks beyond the number of coefficients: with fewer, the scatter has no usable variance."""
SIGNIFICANCE = 3.5
"""Standard errors: two-sided 5e-4, which over 25 checks is a false alarm in about 1 % of bags."""
MIN_MOVING_S = 20.0
"""s of driving below which nothing is estimated: four blocks, the least of `MIN_SPARE_BLOCKS`."""

MAX_STANDING_SHARE = 0.3
"""Share of the recording at a standstill above which it is a finding; by choice."""
MIN_SPEED_CHANGE = 1.0
"""m/s (RMS) in a block from which a scale of acceleration is estimated: 20 times the noise of an
odometry of 0.05 m/s, which then lowers the scale by 0.25 %. Of a full-size car: speeds of a scale
model are compared with it times `similarity.time_scale`, where such noise lowers the scale of a
1:10 car by 2 %, a seventh of what is material."""
MAX_LATERAL = 4.0
"""m/s²: range of linear steering and tyre behaviour (ISO 4138, 2021)."""

MIN_RATE_HZ = 20.0
"""Hz; ten times the bandwidth of a car's yaw and speed response of about 2 Hz, the usual least
sampling rate (K. J. Åström, B. Wittenmark, Computer-Controlled Systems, 1997, section 7)."""
MIN_GAP_S, MIN_GAP_PERIODS = 0.2, 5.0
"""A gap lasts this long and this many periods at least: any network loses single messages."""
FROZEN_S = 0.5
"""s of identical readings while moving from which a sensor is frozen; half of the node's
`frozen_after_s`, by choice. Chance must also fail to explain the run (see `FROZEN_CHANCE`)."""
FROZEN_CHANCE = 0.01
"""Probability, per channel and bag, of a run of repeated readings that chance explains."""
GUARD_S = 0.5
"""s to either side of a gap, jump or frozen stretch that are not used: the smoothing window."""

JUMP_DISTANCE, JUMP_ANGLE = 0.5, math.radians(3.0)
"""m and rad: smallest pose jump. Above the corrections of a working localisation; by choice. The
distance is that of a full-size car, and of one of unknown size."""
JUMP_SIGMAS = 10.0
"""Robust standard deviations of a pose step that a jump exceeds."""

MIN_CORRELATION = 0.8
"""Correlation from which two channels measure the same thing, up to sign and unit; by choice."""
MIN_AXIS_CORRELATION = 0.6
"""The same for a single axis of the accelerometer, which also senses vibration and slope."""
MAX_UNIT_ERROR = 0.25
"""|ln| of the distance from a unit factor, half of that from km/h to mph; by choice."""
UNIT_FACTORS = {
    "deg": 180.0 / math.pi,
    "km/h": 3.6,
    "mph": 2.23694,
    "g": 1.0 / GRAVITY,
    "kN m": 1e-3,
    "ft": 1.0 / 0.3048,
}
"""Factor of each unit that is not SI: reading in that unit over reading in SI."""

MAX_LAG_S, LAG_STEP_S = 0.6, 0.04
"""s: range and step of the search for delays; MAX_LAG_S is that of the effect catalogue, and a
parabola through three steps is exact enough for signals below 2 Hz."""
MIN_LAG_S = 0.01
"""s: a shorter lag is none; half the period of odometry at 50 Hz."""
MIN_FORM_GAIN = 0.1
"""Relative reduction of the unexplained variance (1 - correlation²) for which a second parameter
(delay and filter) is preferred to one, or a filter to a delay; by choice."""
FORM_CONFIDENCE = 0.95
"""Share of the resamples in which a form must fit better than the other; by choice."""
MIN_LAG_CORRELATION = 0.9
"""Correlation of the aligned signals below which their lag is not decided; by choice."""


class Material(NamedTuple):
    """Smallest size of a finding, in the unit of the quantity; smaller ones are not material."""

    size: float
    unit: str


MATERIAL = {
    # One period of odometry at 50 Hz; by choice.
    "time_offset": Material(0.02, "s"),
    # A filter's delay is its time constant at low frequency, the same in its effect.
    "filter": Material(0.03, "s"),
    # Power steering (0.03 s), hold of the command (0.0125 s at 40 Hz), and as much in reserve.
    "steering_delay": Material(0.08, "s"),
    # The same without v_y, where the yaw dynamics near the limit count as well; by choice.
    "steering_response": Material(0.2, "s"),
    # The single-track model is off by up to 3 % on simulated cars with 14 degrees of freedom,
    # whose body rolls (`adk simulate gusts`).
    "steering_ratio": Material(0.03, "1"),
    # 0.15 deg: a 5 m wide lane is left within 2 km; by choice.
    "steering_offset": Material(0.0025, "rad"),
    "odometry_scale": Material(0.01, "1"),
    # 0.2°; a crown of 2.5 % (see a_y_offset) turns the velocity of a car by 0.0015 rad at a
    # compliance of its rear axle of 0.0062 rad s²/m (`adk check bags/handling --evidence`).
    "odometry_rotation": Material(0.0035, "rad"),
    # As that against the pose; a grade of 10 % between horizontal and travelled way is 0.5 %.
    "gps_scale": Material(0.01, "1"),
    # One period of a receiver at 10 Hz.
    "gps_delay": Material(0.1, "s"),
    # As a tilt; at 20 m/s it is 0.35 m/s of lateral velocity.
    "gps_heading": Material(math.radians(1.0), "rad"),
    # 0.2° of 1°, the sideslip of usual driving; by choice.
    "gps_sideslip": Material(0.2, "1"),
    "gyro_scale": Material(0.01, "1"),
    # Turn-on bias of an automotive MEMS gyro: about 0.1 deg/s.
    "gyro_bias": Material(0.002, "rad/s"),
    # Against an acceleration the scale also has the pitch and roll of the body: up to 10 %.
    "acceleration_scale": Material(0.15, "1"),
    # As a grade follows from the acceleration.
    "height_scale": Material(0.15, "1"),
    # 1.5 % of g; above the bias of an automotive MEMS accelerometer (0.01 g).
    "a_x_offset": Material(0.15, "m/s²"),
    # Crown of a road: up to 2.5 % on one side (AASHTO, A Policy on Geometric Design, 2018).
    "a_y_offset": Material(0.3, "m/s²"),
    "tilt": Material(math.radians(1.0), "rad"),
    # The roll of the body moves the estimate by up to 0.33 m (`adk simulate slalom --seed 1`).
    # This and the next are lengths of a full-size car, times the length scale of a scale model.
    "imu_position": Material(0.5, "m"),
    "reference_point": Material(0.4, "m"),
    "wheel_radius": Material(0.02, "1"),
    # Body roll and yaw misalignment of a housing fitted by eye: 2 deg; by choice.
    "imu_yaw": Material(math.radians(2.5), "rad"),
    "gravity": Material(0.5, "m/s²"),
    # As the offsets of a_x and a_y: 1.5 % and 3 % of g.
    "road_grade": Material(0.015, "1"),
    "road_bank": Material(0.03, "1"),
}

MAX_ODDS = 20.0
"""Likelihood ratio from which one of two explanations is excluded: "strong" evidence (R. E. Kass,
A. E. Raftery, Journal of the American Statistical Association 90, 1995, 773)."""

MAX_COPY = 1e-6
"""Unexplained share of the power of a channel below which it is computed from another: the noise
of a sensor is above 1/1000 of its signal."""
MIN_LINEAR_SHARE = 0.75
"""Share of the driving in the linear range of the tyres, below which the steering of two
recordings is compared over all driving; by choice."""
SAME_COURSE_SHARE = 0.8
"""Share of a drive near places of another, from which both are on the same course; by choice."""
SAME_PLACE_S = 1.0
"""Places count as the same that lie within the distance driven in this time, s; by choice."""
