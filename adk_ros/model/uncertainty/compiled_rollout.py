# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Rolling a model out over a horizon, compiled; and roll-outs that go on with the ticks.

With a lift anew at each step the state's increment is linear in what the lift's last layer sees:

    theta [x; features; u; 1] = head s + short row + u part + level,

with s what the lift's last layer sees and row the encoder's input, features = w3' s + skip' row +
b3. So
the lift's last layer and theta are multiplied out once (`mix`), and the features never formed.
"""

from __future__ import annotations

import numpy as np

from adk_ros.model.lifting.encoder_kernels import (
    pack_encoder_input,
    penultimate_activations,
    set_command,
)
from adk_ros.model.uncertainty.error_regression import predicted_error
from adk_ros.numerics.numba_cache import fused_kernel, inlined_kernel, strict_kernel

_MAX_SCALED_STATE = 50.0
"""Scaled states are held within this: far outside any data, and finite."""


@fused_kernel
def fold_output_layer(  # type: ignore[no-untyped-def]
    theta, affine, w3, b3, skip, head, short, rest
):
    """Write head (3, h + q), short (3, n) float32 and rest (3, 3): u's two columns and level."""
    n_features = w3.shape[1]
    n_z = 3 + n_features
    for c in range(3):
        for i in range(w3.shape[0]):
            value = 0.0
            for j in range(n_features):
                value += theta[c, 3 + j] * w3[i, j]
            head[c, i] = value
        for i in range(skip.shape[0]):
            # The row begins with the state itself.
            value = theta[c, i] if i < 3 else 0.0
            for j in range(n_features):
                value += theta[c, 3 + j] * skip[i, j]
            short[c, i] = value
        level = theta[c, n_z + 2] if affine else 0.0
        for j in range(n_features):
            level += theta[c, 3 + j] * b3[j]
        rest[c, 0], rest[c, 1], rest[c, 2] = theta[c, n_z], theta[c, n_z + 1], level


@inlined_kernel
def rollout_step(  # type: ignore[no-untyped-def]
    row,
    x,
    push,
    u0,
    u1,
    n_x,
    step_scale,
    residual,
    correction,
    w1,
    b1,
    w2,
    b2,
    columns,
    reach,
    directions,
    head,
    short,
    rest,
    first,
    second,
):
    """
    One step: `row` (n,), scaled state `x` (3,) and disturbances `push` (2, 3) are moved on.

    `u0`, `u1` are the command in force, scaled; the first `n_x` of the row's columns are states.
    """
    n, seen = short.shape[1], head.shape[1]
    set_command(row, n_x, u0, u1)
    penultimate_activations(row, w1, b1, w2, b2, columns, reach, directions, first, second)
    # All three at once: a sum of its own each would wait for itself.
    s0 = s1 = s2 = np.float32(0.0)
    for i in range(seen):
        s0 += head[0, i] * second[i]
        s1 += head[1, i] * second[i]
        s2 += head[2, i] * second[i]
    for i in range(n):
        s0 += short[0, i] * row[i]
        s1 += short[1, i] * row[i]
        s2 += short[2, i] * row[i]
    for c in range(3):
        lifted = s0 if c == 0 else s1 if c == 1 else s2
        value = rest[c, 2] + lifted + rest[c, 0] * u0 + rest[c, 1] * u1
        value += push[0, c] + push[1, c]
        push[0, c] *= correction[2, c]
        push[1, c] *= correction[4, c]
        value = value * step_scale[c] + (x[c] if residual else 0.0)
        x[c] = min(max(value, -_MAX_SCALED_STATE), _MAX_SCALED_STATE)
    for i in range(n_x - 1, 2, -1):
        row[i] = row[i - 3]
    for i in range(n - 1, n_x + 1, -1):
        row[i] = row[i - 2]
    for c in range(3):
        row[c] = x[c]


@fused_kernel
def rollout_lifting(  # type: ignore[no-untyped-def]
    x_past,
    u_past,
    theta,
    step_scale,
    residual,
    affine,
    u_ahead,
    disturbance,
    correction,
    w1,
    b1,
    w2,
    b2,
    w3,
    b3,
    skip,
    columns,
    reach,
    directions,
    out,
):
    """
    Predict len(out) steps, lifting anew at each: out (h, 3) scaled.

    `u_ahead` (up to h, 2) scaled, its last row held; `theta` (n_z, n_phi), of which the state's
    three rows are used; `disturbance` (2, 3) is added to the increments and decays as `correction`
    (5, 3) says, see `correction.Correction`.
    """
    n, seen = w1.shape[0], w3.shape[0]
    n_x, last = 3 * x_past.shape[0], u_ahead.shape[0] - 1
    row = np.empty(n, dtype=np.float32)
    pack_encoder_input(x_past, u_past, row)
    first = np.empty(seen + n, dtype=np.float32)
    second = np.empty(seen, dtype=np.float32)
    head, short = np.empty((3, seen), dtype=np.float32), np.empty((3, n), dtype=np.float32)
    rest = np.empty((3, 3))
    fold_output_layer(theta, affine, w3, b3, skip, head, short, rest)
    x, push = x_past[0].copy(), disturbance.copy()
    for step in range(out.shape[0]):
        u0, u1 = u_ahead[min(step, last), 0], u_ahead[min(step, last), 1]
        rollout_step(
            row,
            x,
            push,
            u0,
            u1,
            n_x,
            step_scale,
            residual,
            correction,
            w1,
            b1,
            w2,
            b2,
            columns,
            reach,
            directions,
            head,
            short,
            rest,
            first,
            second,
        )
        out[step] = x


@strict_kernel
def rollout_linear(z, theta, u_ahead, out):  # type: ignore[no-untyped-def]
    """Predict in the lifted space, z+ = A z + B u (eq. 5): as above, no lift on the way."""
    n_z = z.shape[0]
    last = u_ahead.shape[0] - 1
    now = z.copy()
    new = np.empty(n_z)
    for step in range(out.shape[0]):
        u = u_ahead[min(step, last)]
        for c in range(n_z):
            value = theta[c, n_z] * u[0] + theta[c, n_z + 1] * u[1]
            for j in range(n_z):
                value += theta[c, j] * now[j]
            new[c] = min(max(value, -_MAX_SCALED_STATE), _MAX_SCALED_STATE)
        now[:] = new
        out[step, :] = now[:3]


@strict_kernel
def to_si(  # type: ignore[no-untyped-def]
    states, base, disturbance, weights, trust, x_mean, x_scale
):
    """
    Unscale states (h, 3) in place; return whether all are finite.

    To the change since `base` (3,), scaled, is added what is foreseen of its error by `weights`
    (k, 3, K + 1) from `disturbance` (1, 3, 3), see `hindsight`; of that a share `trust` (k, 3) is
    kept. Both by step, the last row from there on; the change is left as it is if k is 0.
    """
    finite = True
    last = trust.shape[0] - 1
    for i in range(states.shape[0]):
        for c in range(3):
            value = states[i, c]
            if last >= 0:
                h = min(i, last)
                value += predicted_error(h, c, 0, weights, disturbance)
                # Before it is held within bounds, which would make a number of what is none.
                finite = finite and np.isfinite(value)
                value = min(max(value, -_MAX_SCALED_STATE), _MAX_SCALED_STATE)
                value = base[c] + trust[h, c] * (value - base[c])
            states[i, c] = value * x_scale[c] + x_mean[c]
            finite = finite and np.isfinite(states[i, c])
    return finite
