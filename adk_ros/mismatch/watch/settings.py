# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Constants of the watch, with their sources.

The threshold of the alarm is calibrated with all others as they are (`adk bench watch
--calibrate`): another value of those "by choice" costs time to the alarm, not false alarms.
"""

from __future__ import annotations

from adk_ros.mismatch.inference.block_scores import BLOCK_S as BLOCK_S
from adk_ros.mismatch.library.criteria import MIN_GAIN

WARM_UP_S = 3.0
"""
s simulated before a block: one in which the surrogate settles (`criteria.SETTLING_S`), then more
than the memory of the whitening filters (1.2 s) and two time constants of the observer (0.5 s).
"""
LOOK_AHEAD_S = 0.5
"""s of data after a block: half the smoothing window (0.25 s), and late messages."""
MAX_LATENESS_S = 2.0
"""
s after which a block is closed although a stream is behind: a hundred periods of odometry at 50
Hz, less than half a block.
"""
MIN_MEASURED_SHARE = 0.5
"""Least share of a block's residuals that must count for the block to be used. By choice: half."""
NOISE_BLOCKS = 4
"""Blocks from which the sensor noise is estimated, once: 20 s, 2000 readings of an IMU."""
REFERENCE_BLOCKS = 24
"""
Blocks with data before the first decision: 2 min, longer than most laps of a town block. The
reference is then the car as it was in this time.
"""
RING_BLOCKS = 36
"""
Latest blocks among which onsets are searched: 3 min, more than the 2 min within which a change is
to be named.
"""
REFERENCE_MEMORY_BLOCKS = 360
"""
Time constant with which older blocks are forgotten: 30 min, so that slow changes that are no
event (warm tyres, fuel) become part of the reference. By choice.
"""
MIN_BLOCKS_AFTER = 2
"""Least blocks after an onset: one block may contain an accident (a pothole, a loose message)."""
HOLD_BLOCKS = 2
"""Successive blocks at which the statistic must exceed the threshold, for the same reason."""
STATIC_SIGMA = 3.0
"""
Prior standard deviation of an effect that the car had before, in materiality thresholds. By
choice: data of the reference dominate it.
"""
ROAD_KNOT_S = 4.0
"""s between knots of a block's unknown grade and bank: 80 m at 20 m/s."""
GRADE_SIGMA, BANK_SIGMA = 0.03, 0.02
"""
Prior standard deviations of grade and bank of an unknown road, rad: half of the 6 % that design
guides of rural roads allow for the grade, and a crown of 2 %.
"""
JUMP_SHARE = 0.3
"""
Share of their prior by which tolerances and offsets may change with an effect: of a change of
10 %, such as 200 kg, `criteria.SYSTEMATIC_ERROR_SHARE` (1.2 %) is 0.12 % of a parameter of the
car, 0.3 times `criteria.TOLERANCE_SIGMA`.
"""
SPREAD_PRIOR_BLOCKS = 12.0
"""Blocks that the prior of the scores' spread counts as. By choice: a minute."""
NAMING_BLOCKS = (0, 6, 12)
"""
Blocks after the alarm at which the change is named: at once, after half a minute, and finally
after a minute, when a new reference begins.
"""
ALARM_THRESHOLD = MIN_GAIN
"""
Statistic of an alarm: the gain that a further effect needs offline. `adk bench watch --calibrate`
gives the threshold of one false alarm in 10 h; this one must not be below.
"""
