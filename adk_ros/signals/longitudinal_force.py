# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Compare the IMU's longitudinal specific force with the acceleration that odometry shows.

With theta the grade, g gravity and b the offset of the IMU,

    a_x = dv_x/dt - r v_y + g sin(theta) + b.

Means over blocks of 1 s leave out noise and vibration; differences of successive blocks leave out
the offset and the grade, of which only the change within 1 s remains. On a road at speed v that is
at most g a_v / v, where a_v is the vertical acceleration of a crest or a sag, 0.3 m/s² for comfort
(AASHTO, A Policy on Geometric Design, 2018, section 3.4.6): 0.3 m/s² at 10 m/s. Only changes of at
least `_MIN_CHANGE` count, three times as much. They come from the driver, and a_x must show them:
the slope of one on the other should be 1.
"""

from __future__ import annotations

from adk_ros.numerics.constants import GRAVITY
from adk_ros.numerics.running_slope import Slope

_BLOCK_NS = 1_000_000_000
"""ns of a mean: long against the noise and delay of odometry, short against a manoeuvre."""
_MAX_BLOCK_NS = 1_500_000_000
"""ns of a block above which odometry paused within it, for 0.5 s or longer: it does not count."""
_MIN_CHANGE = 1.0
"""m/s²; smallest change of acceleration between blocks that counts: three times what a road's
grade contributes at 10 m/s, eight times what noise of 0.05 m/s in v_x does."""
_FORGETTING = 0.95
"""Forgetting factor per change that counts: a memory of 20. Time alone forgets nothing, so that a
recording that ends at a standstill or at constant speed is judged as well."""
_MIN_COUNT = 9.5
"""Weight of the changes that a warning requires, reached by 13: with the correlation below, chance
yields it with a probability below 0.1 % (t test, 12 degrees of freedom)."""
_MIN_CORRELATION = 0.8
"""Correlation that a warning requires, as in `plausibility`."""
_FLIPPED_SLOPE = -0.3
"""Slope below which the axis is reported as flipped: between 0 and -1."""
_SLOPE_RANGE = (0.5, 2.0)
"""Slopes that are right: a factor of two around 1. Pitch of the body adds up to 10 %."""
_G_SLOPE_RANGE = (0.05, 0.2)
"""Slopes for which the accelerometer is reported in g: a factor of two around 0.102."""


class LongitudinalForce:
    """Running comparison of changes of a_x with changes of the acceleration by odometry."""

    def __init__(self) -> None:
        self._slope = Slope(_FORGETTING)
        self._count = 0.0
        self.interrupt()

    def interrupt(self) -> None:
        """End the present block: its next sample does not follow the last one."""
        self._begin: tuple[int, float] | None = None
        self._before: tuple[float, float] | None = None
        self._sum, self._samples = 0.0, 0

    def add(self, stamp_ns: int, v_x: float, centripetal: float, a_x: float) -> None:
        """
        Take over a sample of the 25 ms grid.

        :param stamp_ns: stamp of the latest reading of odometry.
        :param v_x: of that reading, m/s.
        :param centripetal: r v_y, m/s².
        :param a_x: specific force, m/s².
        """
        if self._begin is None:
            self._begin = stamp_ns, v_x
            return
        self._sum += a_x + centripetal
        self._samples += 1
        elapsed_ns = stamp_ns - self._begin[0]
        if 0 <= elapsed_ns < _BLOCK_NS:
            return
        if not 0 < elapsed_ns <= _MAX_BLOCK_NS:
            self.interrupt()
            return
        block = (v_x - self._begin[1]) / (elapsed_ns * 1e-9), self._sum / self._samples
        before, self._before = self._before, block
        self._begin = stamp_ns, v_x
        self._sum, self._samples = 0.0, 0
        if before is not None and abs(block[0] - before[0]) >= _MIN_CHANGE:
            self._slope.add(block[0] - before[0], block[1] - before[1])
            self._count = _FORGETTING * self._count + 1.0

    @property
    def factor(self) -> float | None:
        """Slope of a_x on the acceleration by odometry; None while it is not known."""
        if self._count < _MIN_COUNT or abs(self._slope.correlation) < _MIN_CORRELATION:
            return None
        return self._slope.value

    @property
    def is_in_g(self) -> bool:
        """Whether a_x looks like g."""
        factor = self.factor
        return factor is not None and _G_SLOPE_RANGE[0] < factor < _G_SLOPE_RANGE[1]

    def warnings(self) -> list[str]:
        """Return a line if the sign or the unit is wrong."""
        factor = self.factor
        if factor is None or _SLOPE_RANGE[0] <= factor <= _SLOPE_RANGE[1]:
            return []
        if factor < _FLIPPED_SLOPE:
            return [
                "the IMU's longitudinal acceleration has the opposite sign of the change of "
                "odometry's v_x: x must point forward; `adk check` proposes imu_rotation if the "
                "IMU is turned"
            ]
        if self.is_in_g:
            return [
                f"the IMU's longitudinal acceleration is {factor:.3f} of the change of odometry's "
                f"v_x: it looks like g, the topic must carry m/s² (1 g = {GRAVITY} m/s²)"
            ]
        return [
            f"the IMU's longitudinal acceleration is {factor:.2g} times the change of odometry's "
            "v_x: check the units of both, `adk check` names a wrong one"
        ]
