# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Compiled observer: one tick's sample, corrected by the prediction that was made for it.

    x^_k = p_k + K (x_k - p_k)

K opens where successive innovations are correlated, see `observer_gains`.
"""

from __future__ import annotations

import numpy as np

from adk_ros.model.lifting.encoder_kernels import pack_encoder_input, set_command, shift_in
from adk_ros.numerics.numba_cache import strict_kernel

_AUTOCORRELATION_GAIN, _AUTOCORRELATION_LOW, _AUTOCORRELATION_HIGH = 0.03, 0.3, 0.7
"""Gain of the running means, and the lag-one autocorrelations between which K opens."""


@strict_kernel
def observer_update(  # type: ignore[no-untyped-def]
    state,
    predicted,
    correction,
    command,
    x_mean,
    x_scale,
    u_mean,
    u_scale,
    measured,
    x_past,
    u_past,
    u_now,
    row,
    whiteness,
):
    """
    Scale a state (3,) and command (2,), shift both pasts, fill the encoder's input row.

    `measured` (3,) is the state scaled, and x_past's first row what the observer makes of it and
    of what was `predicted` (3,) for it, SI, NaN if nothing was. `correction` (5, 3) as
    `Correction.table` gives it. `whiteness` (3, 3): the last innovation, and running means of its
    product with the one before and of its square, by which the observer's gain goes up; see
    `correction`.
    """
    shift_in(u_past, u_now)
    for i in range(x_past.shape[0] - 1, 0, -1):
        x_past[i, :] = x_past[i - 1, :]
    for c in range(3):
        measured[c] = (state[c] - x_mean[c]) / x_scale[c]
        x_past[0, c] = measured[c]
        if correction[0, c] < 1.0 and np.isfinite(predicted[c]):
            expected = (predicted[c] - x_mean[c]) / x_scale[c]
            innovation = measured[c] - expected
            gain = correction[0, c]
            if gain > 0.0:
                last = whiteness[0, c]
                whiteness[0, c] = innovation
                whiteness[1, c] += _AUTOCORRELATION_GAIN * (innovation * last - whiteness[1, c])
                whiteness[2, c] += _AUTOCORRELATION_GAIN * (
                    innovation * innovation - whiteness[2, c]
                )
                alike = whiteness[1, c] / (whiteness[2, c] + 1e-30)
                gain += (1.0 - gain) * min(
                    max(
                        (alike - _AUTOCORRELATION_LOW)
                        / (_AUTOCORRELATION_HIGH - _AUTOCORRELATION_LOW),
                        0.0,
                    ),
                    1.0,
                )
            x_past[0, c] = expected + gain * innovation
    for c in range(2):
        u_now[c] = (command[c] - u_mean[c]) / u_scale[c]
    pack_encoder_input(x_past, u_past, row)
    set_command(row, 3 * x_past.shape[0], u_now[0], u_now[1])
