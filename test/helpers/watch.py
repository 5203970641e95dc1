# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A drive of the surrogate itself that changes on the way, and a watch of it."""

from __future__ import annotations

from functools import cache

import numpy as np

from adk_ros.bench.mismatch.watch_drives import readings_of
from adk_ros.mismatch.library.surrogate_parameters import INDEX, SIZE
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.mismatch.surrogate.run_inputs import ActiveTerms, no_terms
from adk_ros.mismatch.watch.change import Change
from adk_ros.mismatch.watch.watch import Watch
from helpers.mismatch_drive import STEP_S, drive_of, simulated_car

ONSET_S = 160.0


@cache
def changing_drive(
    seconds: float = 240.0, onset_s: float = ONSET_S, seed: int = 1, **changes: float
) -> SensorLog:
    """Recording of the simulated car whose parameters change by `changes` at the onset."""
    n = round(seconds / STEP_S)
    terms = no_terms(n)
    if changes:
        late = (STEP_S * np.arange(n) >= onset_s).astype(np.float64)
        terms = ActiveTerms(
            np.array([INDEX[name] for name in changes]),
            np.array(list(changes.values())),
            np.ones(len(changes), dtype=np.int64),
            np.vstack([np.ones(n), late]),
        )
    return drive_of(simulated_car(), terms, seconds, seed, pose_noise_m=0.01)


def surrogate() -> SurrogateModel:
    """The simulated car, with an error of a thousandth of the noise."""
    noise = np.array([0.025, 0.025, 1e-3, 0.014, 0.014, 1.4e-3])
    residuals = 1e-3 * noise[:, None] * np.ones((6, 100))
    return SurrogateModel(simulated_car(), np.zeros(6), residuals, np.empty((0, SIZE)))


def watched(log: SensorLog, until_s: float = np.inf) -> tuple[Watch, list[Change]]:
    """A watch after a log, or its part before a time, and what it reported."""
    changes: list[Change] = []
    watch = Watch(surrogate(), changes.append)
    for reading, pose in readings_of(log):
        if reading.stamp_ns > 1e9 * (until_s + 1.0):
            break
        watch.push(reading, pose)
        watch.run()
    return watch, changes
