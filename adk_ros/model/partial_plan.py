# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The horizon under a plan that covers it only in part.

From the end of a plan on, the commands are as unknown as without one, and to hold the last planned
command is worth as much as to hold the present one: the predicted change from there on is shrunk
as that of a published horizon after as many steps. Where a command is not planned at all, the
published horizon stays, changed by what the other command does in the model.
"""

from __future__ import annotations

import numpy as np

from adk_ros.numerics.arrays import FloatArray, IntArray

_COMMAND_OF = (0, 1, 1)
"""
Index of the command that moves each state most: torque moves v_x, the steering angle moves v_y and
the yaw rate. All covariances take both commands for unknown as soon as one of them is.
"""


def partial_horizon(
    planned: FloatArray,
    unplanned: FloatArray,
    held: FloatArray,
    shrinkage: FloatArray,
    reach: IntArray,
) -> FloatArray:
    """
    Return the horizon (h, 3), SI, under a plan of `reach` (2,) steps of torque and delta.

    Where a reach is h, the states of that command are those of `planned`.

    :param planned: states (h, 3) that the model predicts under the plan, held after its end.
    :param unplanned: those under the present commands, held; used where a reach is 0.
    :param held: published horizon (h, 3) under these.
    :param shrinkage: of published horizons (h, 3), see `uncertainty.shrinkage`.
    """
    out = planned.copy()
    for c, command in enumerate(_COMMAND_OF):
        n = int(reach[command])
        if not n:
            out[:, c] += held[:, c] - unplanned[:, c]
            continue
        # Row h of a held horizon depends on h unknown commands.
        k = shrinkage[1 : len(out) - n + 1, c]
        out[n:, c] = planned[n - 1, c] + k * (planned[n:, c] - planned[n - 1, c])
    return np.asarray(out)


def partial_covariance(planned: FloatArray, held: FloatArray, known: int) -> FloatArray:
    """
    Return the covariance (h, 3, 3), SI, of a horizon whose first `known` steps are planned.

    Beyond, the error is that of the plan's last step and, in addition, that of a held horizon of
    as many steps. So it is no smaller than the latter.

    :param planned: covariance (h, 3, 3) of horizons that are planned throughout.
    :param held: that of published horizons under constant commands.
    """
    if not known:
        return held
    out = planned.copy()
    out[known:] = planned[known - 1] + held[1 : len(held) - known + 1]
    return np.asarray(out)
