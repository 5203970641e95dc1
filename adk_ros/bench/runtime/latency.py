# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Latency of one tick: decode, align, lift, adapt and roll out the messages of one 25 ms step.

The baseline, timed in alternation in the same run, is padasip's FilterRLS updating 15 outputs of
17 regressors: the cost of the adaptation alone with a common library.

Both are timed back to back, and each after a pause of 25 ms. On a vehicle every tick follows a
pause, in which code and data leave the caches. So are the rollouts that a planner asks for.
"""

from __future__ import annotations

import gc
import importlib.util
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from adk_ros.bench.runtime.rollout_latency import rollout_times
from adk_ros.bench.runtime.synthetic_feed import Message, bench_model, endless, simulated_messages
from adk_ros.errors import UsageError
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.pipeline import Pipeline

MIN_TICKS, MAX_TICKS = 1000, 10**8
"""A 99th percentile needs at least ten samples above it; 10^8 times of 8 bytes fit in memory."""
_WARM_UP_TICKS = 500
_BLOCK = 1000
"""Ticks between two blocks of baseline updates."""
_STAGE_TICKS = 10_000
"""Ticks of the second pass, which times the stages."""

PAUSE_S = 25e-3
"""The period of ticks."""
PAUSES = 400
"""Ticks timed after a pause, 20 s in all."""
ROLLOUT_REPETITIONS = 50
"""Calls of a planner, each timed back to back and after a pause."""

Progress = Callable[[int, int], None]


def check_latency(ticks: int) -> None:
    """
    Check the number of ticks and the installation, without doing any work.

    :raises UsageError: ticks out of range, or padasip is not installed.
    """
    if ticks < MIN_TICKS:
        raise UsageError(f"--ticks {ticks} is too few for a 99th percentile: at least {MIN_TICKS}")
    if ticks > MAX_TICKS:
        raise UsageError(f"--ticks {ticks} is too many: at most {MAX_TICKS}")
    if importlib.util.find_spec("padasip") is None:
        raise UsageError(
            "adk bench latency compares with padasip, which is not installed:"
            " run `make bench`, which installs it, or `python -m pip install padasip`"
        )


def bench_latency(
    model_path: Path | None, ticks: int, progress: Progress | None = None
) -> dict[str, Any]:
    """
    Return {"tick", "padasip_rls15", "ratio", "after_pause", "rollouts", "stages", "ticks"}.

    Times are in µs, those of `rollouts` as `rollout_times` returns them. `ratio`: p50 of the tick
    over that of the baseline. `after_pause` has the first three after pauses. The times of the
    stages come from a shorter pass with a clock around each stage.
    :raises UsageError: as `check_latency`.
    """
    check_latency(ticks)
    baseline = _padasip_tick()
    model = bench_model(model_path)
    messages = simulated_messages()
    feed = endless(messages)
    pipeline = Pipeline(model)
    for _ in range(_WARM_UP_TICKS):
        _tick(pipeline, feed)
        baseline()
    gc.collect()
    # The node collects garbage between ticks, outside of the measured time.
    gc.disable()
    times, baseline_times = np.empty(ticks), []
    for i in range(ticks):
        times[i] = _tick(pipeline, feed)
        if i % _BLOCK == 0:
            # In blocks: if the two alternated, each would run on caches filled by the other.
            for _ in range(_BLOCK // 10):
                started = time.perf_counter_ns()
                baseline()
                baseline_times.append(time.perf_counter_ns() - started)
        if progress is not None and i % 500 == 0:
            progress(i, ticks + _STAGE_TICKS)
    after_pause = _after_pauses(pipeline, feed, baseline)
    rollouts = rollout_times(pipeline.predictor, ROLLOUT_REPETITIONS)
    stages = _stages(model, simulated_messages(), ticks, progress)
    gc.enable()
    return {
        **_compared(times, np.array(baseline_times)),
        "after_pause": after_pause,
        "rollouts": rollouts,
        "stages": stages,
        "ticks": ticks,
        "horizon_steps": pipeline.settings.horizon_steps,
        "method": model.online.method,
    }


def _tick(pipeline: Pipeline, feed: Iterator[Message]) -> int:
    """Feed messages until a prediction comes out; return the time spent on them, ns."""
    spent = 0
    while True:
        source, msg = next(feed)
        started = time.perf_counter_ns()
        predictions = pipeline.take(source, msg)
        spent += time.perf_counter_ns() - started
        if predictions:
            return spent


def _after_pauses(
    pipeline: Pipeline, feed: Iterator[Message], baseline: Callable[[], None]
) -> dict[str, Any]:
    """Return the times of tick and baseline, each after a pause, in alternation."""
    times = np.empty((2, PAUSES))
    for i in range(PAUSES):
        time.sleep(PAUSE_S)
        times[0, i] = _tick(pipeline, feed)
        time.sleep(PAUSE_S)
        started = time.perf_counter_ns()
        baseline()
        times[1, i] = time.perf_counter_ns() - started
    return _compared(*times) | {"pause_ms": 1e3 * PAUSE_S, "ticks": PAUSES}


def _compared(times_ns: np.ndarray[Any, Any], baseline_ns: np.ndarray[Any, Any]) -> dict[str, Any]:
    tick, baseline = _summary(times_ns), _summary(baseline_ns)
    return {
        "tick": tick | {"max_us": float(times_ns.max()) * 1e-3},
        "padasip_rls15": baseline,
        "ratio": tick["p50_us"] / baseline["p50_us"],
    }


def _padasip_tick() -> Callable[[], None]:
    from padasip.filters import FilterRLS

    filters = [FilterRLS(n=17, mu=0.98) for _ in range(15)]
    random = np.random.default_rng(0)
    x, y = random.normal(size=(256, 17)), random.normal(size=(256, 15))
    count = 0

    def update() -> None:
        nonlocal count
        row, targets = x[count % 256], y[count % 256]
        count += 1
        for item, target in zip(filters, targets, strict=True):
            item.adapt(target, row)

    return update


class _Stopwatch:
    """Accumulates the time spent in a callable, ns, until reset."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.spent = 0

    def wrap(self, function: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*arguments: Any) -> Any:
            started = time.perf_counter_ns()
            result = function(*arguments)
            self.spent += time.perf_counter_ns() - started
            return result

        return timed


def _stages(
    model: KoopmanModel, messages: list[Message], before: int, progress: Progress | None
) -> dict[str, dict[str, float]]:
    names = ("decode", "align", "model", "rest")
    watches = {name: _Stopwatch(name) for name in names}
    pipeline = Pipeline(model)
    decoder: Any = pipeline.decoder
    aligner: Any = pipeline.aligner
    predictor: Any = pipeline.predictor
    decoder.decode = watches["decode"].wrap(decoder.decode)
    take = aligner.take
    # Samples are formed, and their readings judged, when they are asked for.
    aligner.take = watches["align"].wrap(lambda reading: list(take(reading)))
    predictor._steps.advance = watches["model"].wrap(predictor._steps.advance)
    feed = endless(messages)
    rows = []
    for i in range(_WARM_UP_TICKS + _STAGE_TICKS):
        total = _tick(pipeline, feed)
        parts = [watches[name].spent for name in names[:-1]]
        for watch in watches.values():
            watch.spent = 0
        if i >= _WARM_UP_TICKS:
            rows.append([*parts, total - sum(parts)])
        if progress is not None and i % 500 == 0:
            progress(before + i, before + _STAGE_TICKS)
    table = np.array(rows)
    total = table.sum()
    return {
        name: _summary(table[:, i]) | {"share": float(table[:, i].sum() / total)}
        for i, name in enumerate(names)
    }


def _summary(times_ns: np.ndarray[Any, Any]) -> dict[str, float]:
    p50, p99 = np.percentile(times_ns, [50, 99]) * 1e-3
    return {"p50_us": float(p50), "p99_us": float(p99)}
