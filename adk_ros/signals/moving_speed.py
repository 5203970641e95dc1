# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The speed from which a car counts as driving, for full-size cars and scale models."""

from __future__ import annotations

MIN_SPEED = 2.0
"""m/s below which a full-size car stands or manoeuvres: the side slip of tight bends and the noise
of odometry then dominate what is compared."""
MIN_SPEED_SHARE = 0.1
"""Share of the usual speed at which a small car manoeuvres, where that is less than `MIN_SPEED`: a
1:10 car drives at 1 to 4 m/s; by choice."""
STANDING_SPEED = 0.3
"""m/s below which the car stands: above the noise of wheel and satellite speeds; by choice."""

_MIN_SPEED_RANGE = 1.0
"""m/s; a smaller range of v_x counts as a constant speed; of scale models, one below their
`moving_speed`."""


def moving_speed(usual_speed: float) -> float:
    """
    Return the speed below which a car stands or manoeuvres, m/s.

    :param usual_speed: that the car drives at, m/s. A value that is too high, such as an outlier,
        yields at most the limit of a full-size car.
    """
    return min(MIN_SPEED, max(MIN_SPEED_SHARE * usual_speed, STANDING_SPEED))


def speed_varies(lowest: float, highest: float) -> bool:
    """Return whether a car with this range of v_x, m/s, has driven at varying speed."""
    fastest = max(abs(lowest), abs(highest))
    limit = moving_speed(fastest)
    return fastest >= limit and highest - lowest >= min(_MIN_SPEED_RANGE, limit)
