# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
How soon and how rightly the watch names changes, how often it errs, and its threshold.

Three sets of drives share no car, route or noise: those of the calibration, the clean drives, and
the drives with an event. A drive is on one of three plants, none of which has equations of the
surrogate model.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from adk_ros.bench.mismatch.case_score import shares
from adk_ros.bench.mismatch.watch_drives import EVENTS, WatchedDrive, readings_of
from adk_ros.mismatch.inference.result import EXPLAINED
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.watch.change import WITHDRAWN, Change
from adk_ros.mismatch.watch.settings import ALARM_THRESHOLD, HOLD_BLOCKS
from adk_ros.mismatch.watch.watch import WATCHING, Watch

CALIBRATION, CLEAN, EVENT = 7101, 7202, 7303
"""First numbers of the seeds of the three sets."""
CLEAN_DRIVE_S = 1800.0
"""Duration of a clean drive, s: more takes too much memory to simulate."""
ONSET_S, EVENT_DRIVE_S = 220.0, 345.0
"""Onset of an event and duration of its drive, s: 2 min are learnt, 2 min follow."""
NAMED_WITHIN_S = 120.0
"""s after the onset within which a change is to be named."""
FALSE_ALARMS_PER_HOUR = 0.1
"""Required rate of false alarms: one in 10 h."""
TARGET_NAMED = 0.9
"""Required share of events that are named right."""
_SEGMENT_BLOCKS = 60
"""Decisions over which a maximum is taken: 5 min, far longer than the memory of the statistic."""
_PLACES = (
    ("fourteen_dof", "track"),
    ("spring_car", "town"),
    ("seven_dof", "track"),
    ("spring_car", "track"),
    ("fourteen_dof", "town"),
    ("seven_dof", "town"),
)

Progress = Callable[[float, float], None]


@dataclass(frozen=True)
class EventResult:
    """
    One event: what was injected and what was named within `NAMED_WITHIN_S`.

    `credit`: as in `case_score`, 0 if wrong. `delay_s`: from the
    onset to the alarm; `covered`: whether the 90 % interval of the first parameter holds.
    """

    event: str
    plant: str
    road_style: str
    strength: float
    effect: str
    named: str
    alternatives: tuple[str, ...]
    verdict: str
    credit: float
    delay_s: float
    onset_error_s: float
    error: float
    covered: bool
    false_alarms: int


@dataclass(frozen=True)
class CleanResult:
    """A clean drive: hours watched, alarms, segment maxima of the statistic, share of a core."""

    plant: str
    road_style: str
    hours: float
    alarms: tuple[str, ...]
    maxima: tuple[float, ...]
    cpu_share: float


def clean_drives(first: int, hours: float) -> list[WatchedDrive]:
    """Return clean drives of about so many hours; `first`: first number of their seeds."""
    count = max(1, round(3600.0 * hours / CLEAN_DRIVE_S))
    return [
        WatchedDrive(plant, first, i, CLEAN_DRIVE_S, style)
        for i, (plant, style) in zip(range(count), _cycle(), strict=False)
    ]


def event_drives(strengths: Sequence[float], rounds: int) -> list[tuple[str, WatchedDrive]]:
    """Return `rounds` drives of each event and strength, on changing plants and roads."""
    out, places = [], _cycle()
    for round_ in range(rounds):
        for strength in strengths:
            for i, (event, effect) in enumerate(EVENTS.items()):
                plant, style = next(places)
                seed = 1000 * round_ + 100 * round(10.0 * strength) + i
                out.append(
                    (
                        event,
                        WatchedDrive(
                            plant, EVENT, seed, EVENT_DRIVE_S, style, effect, strength, ONSET_S
                        ),
                    )
                )
    return out


def _cycle() -> Iterator[tuple[str, str]]:
    while True:
        yield from _PLACES


def run_clean(drive: WatchedDrive, threshold: float = ALARM_THRESHOLD) -> CleanResult:
    """Watch a clean drive."""
    surrogate, log = drive.simulate()
    changes: list[Change] = []
    watch = Watch(surrogate, changes.append, threshold)
    held: list[float] = []
    last, decided = 0.0, 0
    begin_s = process_time()
    for reading, pose in readings_of(log):
        watch.push(reading, pose)
        while watch.step():
            if watch.state == WATCHING and watch.blocks_used != decided:
                decided = watch.blocks_used
                held.append(min(last, watch.statistic))
                last = watch.statistic
    share = (process_time() - begin_s) / log.duration_s
    maxima = [
        max(held[i : i + _SEGMENT_BLOCKS])
        for i in range(0, len(held) - _SEGMENT_BLOCKS + 1, _SEGMENT_BLOCKS)
    ]
    alarms = {c.number: f"{c.best.effect.name} ({c.verdict})" for c in changes}
    return CleanResult(
        drive.plant,
        drive.road_style,
        log.duration_s / 3600.0,
        tuple(alarms.values()),
        tuple(round(x, 2) for x in maxima),
        round(share, 4),
    )


def run_event(event: str, drive: WatchedDrive) -> EventResult:
    """Watch a drive with an event, and score the last report within `NAMED_WITHIN_S`."""
    surrogate, log = drive.simulate()
    changes: list[Change] = []
    watch = Watch(surrogate, changes.append)
    for reading, pose in readings_of(log):
        watch.push(reading, pose)
        watch.run()
    # Readings begin one second after the zero of the log's stamps, and the watch at the first.
    offset_s = (watch.buffer.start_ns or 0) * 1e-9 - 1.0 - log.start_ns * 1e-9
    onset_s = drive.onset_s - offset_s
    before = {c.number for c in changes if c.alarm_s < onset_s}
    late_s = onset_s + NAMED_WITHIN_S
    after = [c for c in changes if c.number not in before and c.until_s <= late_s]
    truth = drive.injected()[drive.effect]
    last = after[-1] if after and after[-1].state != WITHDRAWN else None
    if last is None:
        nothing = ("nothing", (), "none", 0.0, np.nan, np.nan, np.nan, False)
        return EventResult(
            event, drive.plant, drive.road_style, drive.strength, drive.effect, *nothing,
            len(before),
        )  # fmt: skip
    name, first = drive.effect, EFFECTS[drive.effect].parameters[0]
    named, alternatives = last.best.effect.name, tuple(last.best.alternatives)
    credit = 0.0
    if last.verdict == EXPLAINED:
        credit = shares(name, [{"name": named, "alternatives": alternatives}])
    value = truth[first.name]
    error, covered = np.nan, False
    if named == name:
        interval = last.best.parameters[first.name]
        error = abs(interval.value - value) / abs(value - first.neutral)
        covered = interval.low <= value <= interval.high
    return EventResult(
        event,
        drive.plant,
        drive.road_style,
        drive.strength,
        name,
        named,
        alternatives,
        last.verdict,
        credit,
        after[0].alarm_s - onset_s,
        last.onset_s - onset_s,
        float(error),
        covered,
        len(before),
    )


def calibrated_threshold(maxima: Sequence[float]) -> tuple[float, float]:
    """
    Return the threshold of `FALSE_ALARMS_PER_HOUR`, and the rate at the present one, 1/h.

    The maxima of segments follow Gumbel's distribution if the tail of the statistic is
    exponential, as that of a chi-square is (E. J. Gumbel, "Statistics of Extremes", 1958); its
    parameters are those of the moments.
    """
    values = np.asarray(maxima)
    scale = max(float(values.std(ddof=1)) * np.sqrt(6.0) / np.pi, 1e-9)
    location = float(values.mean()) - np.euler_gamma * scale
    hours = _SEGMENT_BLOCKS * 5.0 / 3600.0
    allowed = FALSE_ALARMS_PER_HOUR * hours
    threshold = location - scale * np.log(-np.log1p(-allowed))
    present = -np.expm1(-np.exp(-(ALARM_THRESHOLD - location) / scale)) / hours
    return float(threshold), float(present)


def run_all(
    jobs: Sequence[Callable[[], Any]], progress: Progress | None, each: Callable[[Any], None]
) -> list[Any]:
    """Run jobs one after the other; `each` is called with every result."""
    out = []
    for i, job in enumerate(jobs):
        if progress is not None:
            progress(i, len(jobs))
        out.append(job())
        each(out[-1])
    if progress is not None:
        progress(len(jobs), len(jobs))
    return out


def calibration_lines(results: Sequence[CleanResult]) -> list[str]:
    """Return what the calibration says of `ALARM_THRESHOLD`."""
    maxima = [x for result in results for x in result.maxima]
    hours = sum(result.hours for result in results)
    if len(maxima) < 3:
        return [f"{hours:.1f} h are too few to calibrate"]
    threshold, rate = calibrated_threshold(maxima)
    return [
        f"ALARM_THRESHOLD {ALARM_THRESHOLD:g}: {len(maxima)} maxima of {_SEGMENT_BLOCKS} "
        f"decisions in {hours:.1f} h of clean driving: median {np.median(maxima):.1f}, "
        f"largest {max(maxima):.1f}",
        f"one false alarm in {1.0 / FALSE_ALARMS_PER_HOUR:g} h at {threshold:.1f}; "
        f"{rate:.2g} per hour at the present threshold",
    ]


def clean_lines(results: Sequence[CleanResult]) -> list[str]:
    """Return the false alarms of clean drives, and the computing time."""
    hours = sum(result.hours for result in results)
    alarms = [f"{r.plant} {x}" for r in results for x in r.alarms]
    largest = max((x for r in results for x in r.maxima), default=0.0)
    share = max((r.cpu_share for r in results), default=0.0)
    named = f": {'; '.join(alarms)}" if alarms else ""
    return [
        f"false alarms: {len(alarms)} in {hours:.1f} h of clean driving{named}; largest "
        f"statistic {largest:.1f} of {ALARM_THRESHOLD:g}, held over {HOLD_BLOCKS} blocks",
        f"computing: at most {100.0 * share:.1f} % of a core",
    ]


def event_line(x: EventResult) -> str:
    """Return a one-line summary of an event."""
    ties = f" or {', '.join(x.alternatives)}" if x.alternatives else ""
    return (
        f"{x.credit:.2f}  {x.event}, strength {x.strength:g}, {x.plant} {x.road_style}: "
        f"{x.named}{ties} ({x.verdict}), alarm after {x.delay_s:.0f} s, onset "
        f"{x.onset_error_s:+.1f} s, size error {100.0 * x.error:.1f} %"
    )


def event_lines(results: Sequence[EventResult]) -> list[str]:
    """Return the shares of events that are named right, by strength."""
    out = []
    for strength in sorted({x.strength for x in results}, reverse=True):
        chosen = [x for x in results if x.strength == strength]
        share = float(np.mean([x.credit for x in chosen]))
        sized = [x for x in chosen if np.isfinite(x.error)]
        delays = [x.delay_s for x in chosen if np.isfinite(x.delay_s)]
        verdict = "PASS" if share >= TARGET_NAMED else "FAIL"
        out.append(
            f"{verdict} strength {strength:g}: {share:.3f} of {len(chosen)} events named right "
            f"within {NAMED_WITHIN_S:g} s (>= {TARGET_NAMED:g}); "
            f"median delay of the alarm {np.median(delays) if delays else np.nan:.0f} s, "
            f"median size error {100.0 * np.median([x.error for x in sized]):.1f} %, "
            f"{sum(x.covered for x in sized)} of {len(sized)} intervals hold"
            if sized
            else f"{verdict} strength {strength:g}: {share:.3f} of {len(chosen)} events named"
        )
    alarms = sum(x.false_alarms for x in results)
    out.append(f"false alarms before the events: {alarms} in {len(results)} drives")
    return out


def write_results(path: Path, results: Sequence[Any]) -> None:
    """Write results as JSON lines."""
    lines = [json.dumps(asdict(result)) for result in results]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
