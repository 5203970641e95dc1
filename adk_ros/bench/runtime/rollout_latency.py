# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Duration of rollouts of many candidates, as a sampling planner asks for in each of its cycles.

Compared in alternation with a loop of single rollouts, back to back and after pauses.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from adk_ros.model.predictor import Predictor
from adk_ros.numerics.arrays import FloatArray

CANDIDATES, STEPS = 1000, 80
"""A common size of sampling planners: 1000 candidates of 2 s."""
PAUSE_S = 25e-3
MAX_MS = 12.0
"""ms that all candidates may take at once (p50): half of a planner's cycle of 25 ms."""


def rollout_times(predictor: Predictor, repetitions: int) -> dict[str, Any]:
    """
    Return {"candidates", "steps", "many", "loop", "gradient", "ratio", "after_pause"}; in ms.

    `many`: `roll_out_many` of all candidates; `loop`: a `rollout` of each; `gradient`:
    `roll_out_gradient` of one. `ratio`: p50 of the loop over that of many. `after_pause`: the
    three after pauses of 25 ms; "is_fast": whether `many` takes at most `MAX_MS` back to back.
    `predictor` has a state to predict from.
    """
    scaling = predictor.model.scaling
    noise = np.random.default_rng(0).normal(size=(CANDIDATES, STEPS, 2))
    commands = scaling.u_mean + scaling.u_scale * noise
    weights = np.ones((STEPS, 3))

    def loop() -> list[FloatArray]:
        return [predictor.rollout(one) for one in commands]

    calls: dict[str, Callable[[], Any]] = {
        "many": lambda: predictor.roll_out_many(commands),
        "loop": loop,
        "gradient": lambda: predictor.roll_out_gradient(commands[0], weights),
    }
    for call in calls.values():
        call()
    hot = _times(calls, repetitions, 0.0)
    return {
        "candidates": CANDIDATES,
        "steps": STEPS,
        **hot,
        "after_pause": _times(calls, repetitions, PAUSE_S),
        "is_fast": hot["many"]["p50_ms"] <= MAX_MS,
    }


def _times(
    calls: dict[str, Callable[[], Any]], repetitions: int, pause_s: float
) -> dict[str, Any]:
    spent = np.empty((len(calls), repetitions))
    for k in range(repetitions):
        for i, call in enumerate(calls.values()):
            if pause_s:
                time.sleep(pause_s)
            started = time.perf_counter_ns()
            call()
            spent[i, k] = (time.perf_counter_ns() - started) * 1e-6
    result: dict[str, Any] = {}
    for name, row in zip(calls, spent, strict=True):
        p50, p99 = np.percentile(row, [50, 99])
        result[name] = {"p50_ms": float(p50), "p99_ms": float(p99), "min_ms": float(row.min())}
    return result | {"ratio": result["loop"]["p50_ms"] / result["many"]["p50_ms"]}
