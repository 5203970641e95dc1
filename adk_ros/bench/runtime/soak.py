# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Endurance test: a looped drive with faults injected at random, at the horizon of the node.

Checks memory growth, finite outputs and numerical drift of the online method. Faults: NaN and
infinite fields, duplicates, messages out of order, stray stamps in the future and in the past,
missing joints, topics silent for seconds, a frozen sensor, and, in the first half, a clock that
jumps back. In the second half nothing resets the window, so that drift has time to accumulate.
"""

from __future__ import annotations

import copy
import math
import os
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import psutil  # type: ignore[import-untyped, unused-ignore]

from adk_ros.bench.paper.criterion import Criterion
from adk_ros.bench.runtime.synthetic_feed import Message, bench_model, endless, simulated_messages
from adk_ros.errors import UsageError
from adk_ros.model.adaptation.online_methods import OnlineSettings, WindowedRidge
from adk_ros.model.pipeline import Pipeline, PipelineSettings
from adk_ros.signals.channels import Source

MIN_TICKS, MAX_TICKS = 1000, 10**10
"""Below 1000 ticks (25 s) neither memory nor drift has time to grow."""
_FAULT_SHARE = 2e-3
"""Probability that a message carries a fault."""
_HORIZON_STEPS = 80
"""The node's default. Every covariance along the horizon is checked, too."""
_SILENCE = 400
"""Messages that a silent topic loses: 2 s of the IMU, 10 s of the commands."""
_FREEZE = 400
"""Messages for which a frozen sensor repeats its value."""
_JUMP_S = 100
"""Backward jump of the clock, s."""
_MAX_DRIFT = 1e-6
"""By choice: a coefficient then moves a prediction by 1e-6 of what its feature does in a step."""
_MAX_GROWTH_MIB = 20.0
"""By choice: above what allocators add; in 24 h a leak of 7 bytes a tick exceeds it."""


def check_soak(ticks: int) -> None:
    """Raise `UsageError` for a number of ticks out of range."""
    if ticks < MIN_TICKS:
        raise UsageError(f"--ticks {ticks} is too few for anything to grow: at least {MIN_TICKS}")
    if ticks > MAX_TICKS:
        raise UsageError(f"--ticks {ticks} is too many: at most {MAX_TICKS}")


def bench_soak(
    model_path: Path | None, ticks: int, progress: Callable[[int, int], None] | None = None
) -> dict[str, Any]:
    """
    Run the test; `drift` is the largest difference of theta from the batch solution.

    Memory is the resident set size after a tenth of the run and at its end, MiB. `criteria` with
    verdict, name and figure.
    :raises UsageError: as `check_soak`.
    """
    check_soak(ticks)
    model = bench_model(model_path)
    online = OnlineSettings("windowed", model.online.window, max(model.online.ridge, 1e-3))
    pipeline = Pipeline(model, PipelineSettings(online=online, horizon_steps=_HORIZON_STEPS))
    faults: Counter[str] = Counter()
    feed = _with_faults(simulated_messages(), pipeline, faults, ticks // 2)
    process = psutil.Process(os.getpid())
    not_finite = predictions = 0
    early, begin_s = 0.0, time.monotonic()
    while pipeline.ticks < ticks:
        source, msg = next(feed)
        for prediction in pipeline.take(source, msg):
            predictions += 1
            not_finite += not prediction.is_finite()
        if not early and pipeline.ticks >= ticks // 10:
            early = process.memory_info().rss / 2**20
        if progress is not None and pipeline.ticks % 1000 == 0:
            progress(pipeline.ticks, ticks)
    elapsed_s = time.monotonic() - begin_s
    method = pipeline.predictor.online
    assert isinstance(method, WindowedRidge)
    result = {
        "ticks": pipeline.ticks,
        "horizon_steps": _HORIZON_STEPS,
        "elapsed_s": round(elapsed_s, 1),
        "hours_for_1e7_ticks": round(elapsed_s / pipeline.ticks * 1e7 / 3600.0, 2),
        "predictions": predictions,
        "not_finite": not_finite,
        "drift": float(np.abs(method.theta - method.batch_solution()).max()),
        "memory_early_mib": round(early, 1),
        "memory_end_mib": round(process.memory_info().rss / 2**20, 1),
        "restarts": pipeline.restarts,
        "online_failures": method.failures,
        "faults": dict(sorted(faults.items())),
        "counts": dict(sorted(pipeline.aligner.counts.items())),
        "refused": sum(pipeline.decoder.refused.values()),
    }
    return result | {"criteria": [vars(item) for item in soak_criteria(result)]}


def soak_criteria(result: dict[str, Any]) -> list[Criterion]:
    """Return the verdicts on a result of `bench_soak`."""
    predictions, drift = result["predictions"], result["drift"]
    grown = result["memory_end_mib"] - result["memory_early_mib"]
    return [
        Criterion.judged(
            predictions > 0 and result["not_finite"] == 0,
            "NaN or infinity in a state or covariance",
            f"{result['not_finite']} of {predictions} predictions (none)",
        ),
        Criterion.judged(
            drift <= _MAX_DRIFT,
            "distance of the adapted model from the batch solution",
            f"{drift:.1e} (at most {_MAX_DRIFT:.0e})",
        ),
        Criterion.judged(
            result["online_failures"] == 0,
            "failed adaptations",
            f"{result['online_failures']} (none)",
        ),
        Criterion.judged(
            grown <= _MAX_GROWTH_MIB,
            "growth of the memory after a tenth of the run",
            f"{grown:.1f} MiB (at most {_MAX_GROWTH_MIB:.0f} MiB)",
        ),
    ]


def _with_faults(
    messages: list[Message], pipeline: Pipeline, faults: Counter[str], jumps_until: int
) -> Iterator[Message]:
    """Yield messages with faults, counted in `faults`; clock jumps end at tick `jumps_until`."""
    random = np.random.default_rng(1)
    silent: dict[Source, int] = {}
    frozen: dict[Source, tuple[int, Any]] = {}
    for source, msg in endless(messages):
        if silent.get(source, 0) > 0:
            silent[source] -= 1
            continue
        if frozen.get(source, (0, None))[0] > 0:
            left, stuck = frozen[source]
            frozen[source] = (left - 1, stuck)
            yield source, _with_stamp(stuck, msg)
            continue
        if random.random() > _FAULT_SHARE:
            yield source, msg
            continue
        kind = str(
            random.choice(
                [
                    "not a number",
                    "infinite",
                    "duplicate",
                    "out of order",
                    "future",
                    "past",
                    "missing joint",
                    "silence",
                    "freeze",
                    "jump back",
                ]
            )
        )
        if kind == "jump back" and pipeline.ticks >= jumps_until:
            kind = "duplicate"
        faults[kind] += 1
        if kind == "silence":
            silent[source] = _SILENCE
        elif kind == "freeze":
            frozen[source] = (_FREEZE, copy.deepcopy(msg))
        elif kind == "jump back":
            for _, other in messages:
                other.header.stamp.sec -= _JUMP_S
            yield source, msg
        else:
            yield from _fault(kind, source, msg)


def _fault(kind: str, source: Source, msg: Any) -> Iterator[Message]:
    if kind in ("not a number", "infinite"):
        value = math.nan if kind == "not a number" else math.inf
        bad = copy.deepcopy(msg)
        if source is Source.IMU:
            bad.angular_velocity.z = value
        elif source is Source.ODOMETRY:
            bad.twist.twist.linear.y = value
        else:
            bad.position[list(bad.name).index("steer")] = value
        yield source, bad
    elif kind == "missing joint" and source is Source.COMMAND:
        bad = copy.deepcopy(msg)
        bad.name = ["drive", "something"]
        yield source, bad
    elif kind in ("future", "past"):
        stray = copy.deepcopy(msg)
        stray.header.stamp.sec += 3600 if kind == "future" else -3600
        yield source, stray
        yield source, msg
    elif kind == "out of order":
        late = copy.deepcopy(msg)
        late.header.stamp.nanosec = max(0, late.header.stamp.nanosec - 30_000_000)
        yield source, msg
        yield source, late
    else:
        yield source, msg
        yield source, msg


def _with_stamp(stuck: Any, msg: Any) -> Any:
    repeated = copy.copy(stuck)
    repeated.header = msg.header
    return repeated
