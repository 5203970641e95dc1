# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Requests of other processes for predictions under many candidate commands."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from adk_ros.errors import UsageError
from adk_ros.model.drivable import is_drivable
from adk_ros.model.pipeline import Pipeline
from adk_ros.model.prediction import Status
from adk_ros.model.predictor import MAX_HORIZON_STEPS
from adk_ros.model.uncertainty.batch_rollout import lanes_of_block
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.numba_cache import strict_kernel
from adk_ros.signals.commands import MAX_DELTA, MAX_DRIVE

MAX_STEPS = 160_000
"""
Most candidates times steps of a request; candidates in whole blocks, which take as long as full.

`adk bench latency` rolls out 80,000 in 6 to 7 ms. The node predicts nothing meanwhile, and twice
as many leave it half of the 25 ms between two samples. Without a compiled encoder the limit is
`MAX_HORIZON_STEPS`: as many as a horizon has that such a model predicts at every sample.
"""
COLUMNS = ("v_x", "v_y", "yaw_rate", "drivable")
"""Of an answer: the state, SI, and 1 where the candidate's motion is drivable, else 0."""
_READY = (Status.PREDICTED, Status.COASTING)


@strict_kernel
def with_drivable(present: FloatArray, states: FloatArray) -> FloatArray:
    """
    Return `states` (k, h, 3) as (k, h, 4), with 1 last if the candidate is drivable, else 0.

    One call for all candidates: a call for each takes longer than the rollout of short ones.

    :param present: state (3,) that all candidates start from, SI.
    """
    answer = np.empty((states.shape[0], states.shape[1], 4))
    for k in range(states.shape[0]):
        drivable = 1.0 if is_drivable(present, states[k]) else 0.0
        for j in range(states.shape[1]):
            for i in range(3):
                answer[k, j, i] = states[k, j, i]
            answer[k, j, 3] = drivable
    return answer


class RefusedRequest(Exception):
    """A request that cannot be answered; its text says why."""


class RolloutRequests:
    """Answers requests to the predictor of a pipeline; `refused` counts refusals by reason."""

    def __init__(self, pipeline: Pipeline) -> None:
        self._pipeline = pipeline
        self.received = 0
        self.refused: Counter[str] = Counter()

    def answer(
        self, shape: Sequence[int], values: ArrayLike, outdated: str = ""
    ) -> tuple[int, FloatArray]:
        """
        Return the stamp of the sample that the answer starts from, ns, and the answer (k, h, 4).

        :param shape: (k, h, 2) of k candidates of h steps of 25 ms: net wheel torque in N·m and
            road-wheel angle in rad, the first one in force at the latest sample.
        :param values: the commands, row-major.
        :param outdated: why the latest state is not that of the vehicle any more, "" if it is.
        :raises RefusedRequest: it has no answer; also counted.
        """
        self.received += 1
        commands = self._commands(tuple(shape), values)
        if outdated:
            raise self._refusal("no state to predict from", outdated)
        prediction = self._pipeline.last_prediction
        predictor = self._pipeline.predictor
        sample = self._pipeline.last_sample
        if prediction is None or sample is None or predictor.status not in _READY:
            raise self._refusal("no state to predict from", predictor.status.value)
        if prediction.origin_ns != sample.stamp_ns:
            raise self._refusal("no state to predict from", "the latest sample has no prediction")
        try:
            states = predictor.roll_out_many(commands)
        except UsageError as error:
            raise self._refusal("not predictable", str(error)) from None
        return prediction.origin_ns, with_drivable(predictor.present_state, states)

    def _commands(self, shape: tuple[int, ...], values: ArrayLike) -> FloatArray:
        if len(shape) != 3 or shape[-1] != 2 or min(shape) < 1:
            detail = f"{list(shape)}: give [candidates, steps, 2]"
            raise self._refusal("the layout has other dimensions", detail)
        self._check_time(*shape[:2])
        data = np.asarray(values, dtype=np.float64).ravel()
        if data.size != shape[0] * shape[1] * 2:
            detail = f"{data.size} for {shape[0]} x {shape[1]} x 2"
            raise self._refusal("another number of values than the layout says", detail)
        if not np.isfinite(data).all():
            first = int(np.argmin(np.isfinite(data)))
            raise self._refusal("a command is not finite", f"number {first}, from 0")
        commands = data.reshape(shape)
        self._check_limits(commands)
        return commands

    def _check_time(self, candidates: int, steps: int) -> None:
        """Refuse a request whose answer takes too long, see `MAX_STEPS`."""
        if steps > MAX_HORIZON_STEPS:
            detail = f"{candidates} x {steps}: give at most {MAX_HORIZON_STEPS} steps"
            raise self._refusal("too many steps", detail)
        model = self._pipeline.predictor.model
        limit, computed = MAX_STEPS, candidates
        if model.relift and model.lifting.compiled is None:
            limit = MAX_HORIZON_STEPS
        else:
            lanes = int(lanes_of_block(candidates))
            computed = -(-candidates // lanes) * lanes
        if computed * steps > limit:
            blocks = "" if computed == candidates else f", computed as {computed} x {steps}"
            detail = f"{candidates} x {steps}{blocks}: give at most {limit} candidates times steps"
            raise self._refusal("too many steps", detail)

    def _check_limits(self, commands: FloatArray) -> None:
        """Refuse finite commands (k, h, 2) beyond the limits of command messages."""
        limits = (("wheel torque", "N·m", MAX_DRIVE), ("road-wheel angle", "rad", MAX_DELTA))
        for c, (name, unit, limit) in enumerate(limits):
            values = commands[..., c]
            k, j = divmod(int(np.abs(values).argmax()), values.shape[1])
            if abs(values[k, j]) > limit:
                detail = f"{values[k, j]:g} {unit}, candidate {k}, step {j}, from 0"
                raise self._refusal(f"a {name} is beyond {limit:g} {unit}", detail)

    def _refusal(self, reason: str, detail: str) -> RefusedRequest:
        self.refused[reason] += 1
        return RefusedRequest(f"{reason} ({detail})")
