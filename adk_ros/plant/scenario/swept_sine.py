# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Open-loop steering: a sine whose frequency sweeps periodically between slow and fast.

The paper steers its slalom with "a sinusoidal input with periodical time of 100 s" and shows fast
responses from 15 to 50 s and slow ones afterwards. One wave in 100 s cannot excite fast responses,
so 100 s is interpreted as the period of the sweep.
"""

from __future__ import annotations

import numpy as np
from pydantic import Field, model_validator

from adk_ros.files.yaml_file import FileModel
from adk_ros.numerics.arrays import FloatArray


class SweptSine(FileModel):
    """Swept sine of the road-wheel angle, fast from `fast_from` to `fast_until` of each period."""

    amplitude: float = Field(ge=0.0, le=0.6)
    """Amplitude, rad."""
    slow_hz: float = Field(default=0.05, gt=0.0, le=5.0)
    fast_hz: float = Field(default=0.5, gt=0.0, le=5.0)
    fast_from: float = Field(default=15.0, ge=0.0, le=1e4)
    """Times in s, like all that follow."""
    fast_until: float = Field(default=50.0, ge=0.0, le=1e4)
    blend: float = Field(default=5.0, gt=0.0, le=1e3)
    """Duration of the frequency change, centred on the two times above."""
    period: float = Field(default=100.0, gt=1.0, le=1e4)

    @model_validator(mode="after")
    def _order(self) -> SweptSine:
        half = 0.5 * self.blend
        if not half <= self.fast_from < self.fast_until - self.blend:
            raise ValueError("fast_from must be at least half of blend, and before fast_until")
        if self.fast_until + half > self.period:
            raise ValueError("the fast part must end within the period")
        return self


def steering_angles(sine: SweptSine, t: FloatArray) -> FloatArray:
    """
    Return the steering angle, rad, at equally spaced times `t` (n,), s.

    It starts as a cosine that fades in over a quarter of a wave: the vehicle weaves about its
    initial heading, without an offset to one side.
    """
    within = t % sine.period
    up = np.clip((within - sine.fast_from) / sine.blend + 0.5, 0.0, 1.0)
    down = np.clip((sine.fast_until - within) / sine.blend + 0.5, 0.0, 1.0)
    share = 0.5 - 0.5 * np.cos(np.pi * np.minimum(up, down))
    hertz = sine.slow_hz + (sine.fast_hz - sine.slow_hz) * share
    waves = np.concatenate([[0.0], np.cumsum(0.5 * (hertz[1:] + hertz[:-1]) * np.diff(t))])
    fade = np.clip(4.0 * waves, 0.0, 1.0)
    return np.asarray(sine.amplitude * fade * np.cos(2.0 * np.pi * waves))
