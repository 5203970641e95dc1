# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Runs of the surrogate in steps that its size needs.

The slip dynamics of a scale model are faster by the scale of times (`numerics.similarity`): its
steps are divided into as many, and signals of a step are the means over them.
"""

from __future__ import annotations

import math

import numpy as np

from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.mismatch.surrogate.equations_of_motion import integrate
from adk_ros.mismatch.surrogate.run_inputs import (
    ActiveTerms,
    RunBuffers,
    RunInputs,
    run_buffers,
)
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.similarity import length_scale, time_scale

_L_F, _L_R = INDEX["cg_to_front_axle"], INDEX["cg_to_rear_axle"]


def scale_of(parameters: FloatArray) -> float:
    """Return the scale of lengths of a surrogate's parameters (SIZE,); 1 if it is full-size."""
    return length_scale(float(parameters[_L_F] + parameters[_L_R]))


def substeps(parameters: FloatArray) -> int:
    """Return into how many a step is divided: 1 for a full-size vehicle."""
    return math.ceil(1.0 / time_scale(scale_of(parameters)))


def integrate_in_substeps(
    base: FloatArray, terms: ActiveTerms, inputs: RunInputs, buffers: RunBuffers
) -> None:
    """Run the surrogate as `integrate` does, with the steps that its size needs."""
    count = substeps(base)
    if count == 1:
        integrate(base, terms, inputs, buffers)
        return
    steps = buffers.output.shape[1]
    fine = run_buffers(buffers.state, count * steps, buffers.end_states.shape[0] > 0)
    v_x = inputs.prescribed_v_x
    if v_x.size:
        at = np.arange(count * steps + 1) / count
        v_x = np.interp(at, np.arange(v_x.size), v_x)
    integrate(
        base,
        terms._replace(activations=_repeated(terms.activations.T, count).T.copy()),
        RunInputs(
            inputs.commands,
            inputs.start,
            inputs.step / count,
            v_x,
            _measured(inputs.measured, count),
            # Where it is measured at one instant, the correction is made once.
            inputs.observer_gains / (1 if np.isnan(inputs.measured).any() else count),
            _repeated(inputs.extra, count),
        ),
        fine,
    )
    buffers.output[:] = fine.output.reshape(-1, steps, count).mean(axis=2)
    if buffers.end_states.shape[0]:
        buffers.end_states[:] = fine.end_states[::count]


def _repeated(rows: FloatArray, count: int) -> FloatArray:
    return np.ascontiguousarray(np.repeat(rows, count, axis=0))


def _measured(measured: FloatArray, count: int) -> FloatArray:
    """Return measurements (n, 3) in each part of a step; single ones in its last part."""
    if not np.isnan(measured).any():
        n = measured.shape[0]
        at = (np.arange(count * n) + 0.5) / count - 0.5
        return np.column_stack([np.interp(at, np.arange(n), column) for column in measured.T])
    out = np.full((count * measured.shape[0], 3), np.nan)
    out[count - 1 :: count] = measured
    return out
