# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Compiled observer: correct the prediction for a tick with its sample.

    x^_k = p_k + K (x_k - p_k)

K increases while successive innovations are correlated; see `observer_gains`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adk_ros.model.lifting.encoder_kernels import pack_encoder_input, set_command, shift_in
from adk_ros.numerics.arrays import Float32Array, FloatArray
from adk_ros.numerics.numba_cache import strict_kernel

_AUTOCORRELATION_GAIN, _AUTOCORRELATION_LOW, _AUTOCORRELATION_HIGH = 0.03, 0.3, 0.7
"""
Gain per tick of the running means (time constant 33 ticks), and the lag-one autocorrelations
between which K increases. For white innovations the estimate has a deviation of about 0.12, so
0.3 is 2.4 deviations; 0.7 is empirical, not calibrated.
"""


class ScalingArrays(NamedTuple):
    """Offsets and scales of states (3,) and inputs (2,), as in `Scaling`."""

    x_mean: FloatArray
    x_scale: FloatArray
    u_mean: FloatArray
    u_scale: FloatArray


class TickArrays(NamedTuple):
    """
    State of the predictor that every tick updates in place; states and commands are scaled.

    `measured` (3,): the sample; `x_past` (p + 1, 3): observer states, newest first; `u_past` (p,
    2): earlier commands, newest first; `u` (2,): present command; `u_previous` (2,): command of
    the tick before; `row`: encoder input; `autocorrelation` (3, 3): last innovation, running
    means of its product with the one before and of its square.
    """

    measured: FloatArray
    x_past: FloatArray
    u_past: FloatArray
    u: FloatArray
    u_previous: FloatArray
    row: Float32Array
    autocorrelation: FloatArray


@strict_kernel
def observer_update(
    state: FloatArray,
    predicted: FloatArray,
    command: tuple[float, float],
    gains: FloatArray,
    scaling: ScalingArrays,
    tick: TickArrays,
) -> None:
    """
    Take one sample: scale it, run the observer, shift the past, and fill the encoder's input.

    `state` (3,) and `command` (2,) are the sample, `predicted` (3,) the prediction for it, all SI;
    without a prediction it is NaN and the measurement is taken as it is. `gains` (5, 3):
    `ObserverGains.table`.
    """
    x_past, running = tick.x_past, tick.autocorrelation
    tick.u_previous[:] = tick.u
    shift_in(tick.u_past, tick.u)
    for i in range(x_past.shape[0] - 1, 0, -1):
        x_past[i, :] = x_past[i - 1, :]
    for c in range(3):
        tick.measured[c] = (state[c] - scaling.x_mean[c]) / scaling.x_scale[c]
        x_past[0, c] = tick.measured[c]
        if gains[0, c] < 1.0 and np.isfinite(predicted[c]):
            expected = (predicted[c] - scaling.x_mean[c]) / scaling.x_scale[c]
            innovation = tick.measured[c] - expected
            gain = gains[0, c]
            if gain > 0.0:
                last = running[0, c]
                running[0, c] = innovation
                running[1, c] += _AUTOCORRELATION_GAIN * (innovation * last - running[1, c])
                running[2, c] += _AUTOCORRELATION_GAIN * (innovation * innovation - running[2, c])
                autocorrelation = running[1, c] / (running[2, c] + 1e-30)
                gain += (1.0 - gain) * min(
                    max(
                        (autocorrelation - _AUTOCORRELATION_LOW)
                        / (_AUTOCORRELATION_HIGH - _AUTOCORRELATION_LOW),
                        0.0,
                    ),
                    1.0,
                )
            x_past[0, c] = expected + gain * innovation
    for c in range(2):
        tick.u[c] = (command[c] - scaling.u_mean[c]) / scaling.u_scale[c]
    pack_encoder_input(x_past, tick.u_past, tick.row)
    set_command(tick.row, 3 * x_past.shape[0], tick.u[0], tick.u[1])
