# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What one run of the equations of motion reads and writes, as structures that numba takes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adk_ros.mismatch.surrogate.command_integrals import CommandIntegrals
from adk_ros.mismatch.surrogate.state_index import END_STATE_SIZE, OUTPUTS
from adk_ros.numerics.arrays import FloatArray, IntArray


class ActiveTerms(NamedTuple):
    """
    Terms added to the parameter vector along a run.

    Term j adds `amounts[j]` times row `rows[j]` of `activations` (g, n) to entry `entries[j]` of
    the vector. Row 0 of the activations is one throughout.
    """

    entries: IntArray
    amounts: FloatArray
    rows: IntArray
    activations: FloatArray

    def between(self, steps: slice) -> ActiveTerms:
        """Return the terms of some steps of a run."""
        return self._replace(activations=np.ascontiguousarray(self.activations[:, steps]))

    def merged_with(self, other: ActiveTerms) -> ActiveTerms:
        """Return the terms of both; the activations of `other` follow these."""
        first = self.activations.shape[0] - 1
        return ActiveTerms(
            np.concatenate([self.entries, other.entries]),
            np.concatenate([self.amounts, other.amounts]),
            np.concatenate([self.rows, np.where(other.rows > 0, other.rows + first, 0)]),
            np.vstack([self.activations, other.activations[1:]]),
        )


def no_extra() -> FloatArray:
    """Return that nothing is added to accelerations and road-wheel angle."""
    return np.empty((0, 4))


def no_terms(steps: int) -> ActiveTerms:
    """Return terms that add nothing in a run of `steps` steps."""
    none = np.zeros(0, dtype=np.int64)
    return ActiveTerms(none, np.zeros(0), none, np.ones((1, steps)))


class RunInputs(NamedTuple):
    """
    Signals that drive a run of n steps of `step` seconds.

    `start`: seconds from the first value of the command integrals to the first step.
    `prescribed_v_x` (n + 1,): v_x at the ends of the steps, m/s; empty: v_x is integrated.
    `measured` (n, 3): v_x, v_y, yaw rate at the middle of each step, NaN where not measured.
    `observer_gains` (3,): share of the innovation that corrects the state at once.
    `extra` (n, 4): added to the accelerations (a_x, a_y, yaw) and to the road-wheel angle, SI; may
    be empty.
    """

    commands: CommandIntegrals
    start: float
    step: float
    prescribed_v_x: FloatArray
    measured: FloatArray
    observer_gains: FloatArray
    extra: FloatArray


class RunBuffers(NamedTuple):
    """
    Arrays that a run writes.

    `state` (STATE_SIZE,): start in, end out. `output` (OUTPUTS, n): values at the middles of the
    steps. `end_states` (n + 1, END_STATE_SIZE): values at the ends of the steps, unless empty.
    """

    state: FloatArray
    output: FloatArray
    end_states: FloatArray


def run_buffers(state: FloatArray, steps: int, keep_end_states: bool = False) -> RunBuffers:
    """Return buffers for a run of `steps` steps from `state`, which the run advances in place."""
    rows = steps + 1 if keep_end_states else 0
    return RunBuffers(state, np.empty((OUTPUTS, steps)), np.empty((rows, END_STATE_SIZE)))


def open_loop_inputs(
    commands: CommandIntegrals,
    start: float,
    step: float,
    steps: int,
    extra: FloatArray | None = None,
) -> RunInputs:
    """Return the inputs of a run without measurements: all states are integrated."""
    return RunInputs(
        commands,
        start,
        step,
        prescribed_v_x=np.empty(0),
        measured=np.full((steps, 3), np.nan),
        observer_gains=np.zeros(3),
        extra=no_extra() if extra is None else extra,
    )
