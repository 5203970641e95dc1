# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Real recordings, of which nobody knows what they hold: a known term is taken away and asked for.

The stand-in is calibrated on a drive, in which a pedal is made a torque by the speed's change.
What it leaves counts as its own error. A term is then taken out of it, and the drive is held
against what remains: `adk mismatch` has to name that term and its size. The calibrated stand-in
itself is asked too, and should lack nothing.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from adk_ros.bench.mismatch.acceptance import FAIL, PASS, Criterion
from adk_ros.bench.mismatch.case_score import CaseResult, score_case
from adk_ros.errors import DataError
from adk_ros.mismatch.analysis import identify_mismatch
from adk_ros.mismatch.inference.observability import (
    longest_moving_segment,
    observable_effects,
    with_pseudo_imu,
)
from adk_ros.mismatch.library.surrogate_parameters import HIGH, INDEX, LOW, SIZE
from adk_ros.mismatch.recording.checks import check_recording
from adk_ros.mismatch.recording.nominal_vehicle import NominalVehicle
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.report.result_files import as_dict
from adk_ros.mismatch.surrogate.identification import (
    FITTED_PARAMETERS,
    RESIDUAL_SUBSAMPLING,
    SETTLING_BINS,
    SurrogateModel,
    fit_with_annealed_observer,
)
from adk_ros.mismatch.surrogate.residuals import ResidualProblem, prepare_residual_problem
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.differentiation import savitzky_golay
from adk_ros.numerics.levenberg_marquardt import BoundedParameters

ABLATION_FILE = "real"

Progress = Callable[[float, float, str], None]

_ALSO: dict[str, tuple[float, float]] = {
    # name: (usual spread, step of the differences)
    "steer_offset": (0.02, 2e-4),
    "steer_gain": (0.1, 0.005),
    "torque_gain": (0.2, 0.005),
    "brake_gain": (0.3, 0.01),
    "torque_offset": (200.0, 3.0),
    "yaw_inertia": (200.0, 10.0),
}
_ERROR = np.array([0.3, 0.3, 0.01, 0.1, 0.05, 0.01])
"""What such a model leaves of a real drive, by channel: far more than the sensors' noise."""
_MOST = 3.0
"""Usual spreads by which a parameter may be off its start."""
_MOVING = 3.0


@dataclass(frozen=True)
class Removal:
    """A term to be taken out: `entry` of the vector by `amount`, which is then the effect's."""

    effect: str
    parameter: str
    entry: str
    amount: float
    neutral: float = 0.0

    def out_of(self, plain: SurrogateModel) -> SurrogateModel:
        """Return the stand-in less the term."""
        p = plain.parameters.copy()
        p[INDEX[self.entry]] -= self.amount
        return replace(plain, parameters=p)

    def label(self, start_s: float, end_s: float) -> dict[str, Any]:
        """Return the answer that is wanted."""
        return {"plant": ABLATION_FILE, "effects": [{
            "name": self.effect, "params": {self.parameter: self.neutral + self.amount},
            "kind": "always", "time_intervals_s": [[start_s, end_s]],
        }]}  # fmt: skip


def removals(plain: SurrogateModel) -> tuple[Removal, ...]:
    """Return what is taken out of a calibrated stand-in: all its drag, a third of its steering."""
    drag, gain = (float(plain.parameters[INDEX[name]]) for name in ("drag_area", "steer_gain"))
    return (
        Removal("aero_drag", "cda", "drag_area", drag),
        Removal("steering_ratio", "scale", "steer_gain", gain / 3.0, 1.0),
    )


@dataclass(frozen=True)
class CalibratedSurrogate:
    """A drive with torques, and the stand-in that was calibrated on it."""

    stand_in: SurrogateModel
    drive: SensorLog
    notes: tuple[str, ...]


def with_torque(e: SensorLog, mass: float, radius: float) -> tuple[SensorLog, str]:
    """
    Return a recording whose pedal is made a torque, and in words how.

    m dv_x/dt = k+ p+ / R + k- p- / R - c v_x^2 - d over the moving part, by least squares.
    Raises `DataError` where the pedal does not drive the car.
    """
    pedal = e.command[:, 0]
    v_x = savitzky_golay(e.odometry[:, 0])
    along = np.gradient(v_x, e.odometry_s) - e.odometry[:, 1] * e.odometry[:, 2]
    held = pedal[np.maximum(np.searchsorted(e.command_s, e.odometry_s, side="right") - 1, 0)]
    use = v_x > _MOVING
    rows = np.column_stack(
        [np.maximum(held, 0.0), np.minimum(held, 0.0), -(v_x**2), -np.ones_like(v_x)]
    )
    solved, *_ = np.linalg.lstsq(rows[use], along[use], rcond=None)
    if solved[0] <= 0.0 or solved[1] <= 0.0:
        raise DataError(f"{e.name}: the drive command does not speed the car up and slow it down")
    k = mass * radius * solved[:2]
    torque = np.where(pedal > 0.0, k[0], k[1]) * pedal
    command = np.column_stack([torque, e.command[:, 1]])
    text = f"the pedal is taken for {k[0]:.0f} N m at full throttle, {k[1]:.0f} N m at full brake"
    return replace(e, command=command), text


def calibrate_surrogate(recording: SensorLog, nominal: NominalVehicle) -> CalibratedSurrogate:
    """
    Calibrate a stand-in on a real drive.

    Raises `DataError` for a recording that nothing can be learned from.
    """
    has_imu = recording.imu_s.size > 0
    part = longest_moving_segment(recording)
    notes = []
    scope = observable_effects(part, nominal.mass, nominal.wheel_radius, has_imu)
    if not scope.torque:
        part, text = with_torque(part, nominal.mass, nominal.wheel_radius)
        notes.append(text)
    check_recording(with_pseudo_imu(part))
    scope = observable_effects(part, nominal.mass, nominal.wheel_radius, has_imu)
    start = scope.with_yaw_filter(SurrogateModel(
        nominal.parameters(), np.zeros(6), np.zeros((6, 1)), np.empty((0, SIZE))
    )).parameters  # fmt: skip
    stand_in = _calibrate(prepare_residual_problem(with_pseudo_imu(part)), start, has_imu)
    return CalibratedSurrogate(stand_in, part, tuple(notes))


def _calibrate(course: ResidualProblem, start: FloatArray, has_imu: bool) -> SurrogateModel:
    """Return the stand-in with all that a real car may differ in fitted to a course."""
    fitted = FITTED_PARAMETERS | _ALSO
    names = list(fitted)
    where = np.array([INDEX[name] for name in names])
    spread = np.array([fitted[name][0] for name in names])
    step = np.array([fitted[name][1] for name in names])
    counted = course.weights() > 0.0
    slow = np.interp(course.bin_s, course.middle_s, course.smoothed_odometry[:, 0]) < _MOVING
    counted[:, slow | (course.bin_s < course.start_s + 1.0)] = False
    if not has_imu:
        counted[:3] = False
    mean = start[where].copy()
    low = np.maximum(mean - _MOST * spread, LOW[where])
    high = np.minimum(mean + _MOST * spread, HIGH[where])
    p = start.copy()
    p[where] = fit_with_annealed_observer(
        course,
        p,
        where,
        BoundedParameters(mean, low, high, step, mean, spread),
        RESIDUAL_SUBSAMPLING * counted / _ERROR[:, None],
    ).x
    left = course.residuals(p) * counted
    error = np.sqrt(np.mean(left[:, SETTLING_BINS:] ** 2, axis=1))
    return SurrogateModel(p, error, left[:, SETTLING_BINS:], np.empty((0, SIZE)))


@dataclass(frozen=True)
class AblationResult:
    """
    What was said when a term was taken away, "" for none: its score, and the best single effect.

    `gain` is what the best single effect takes off the loss, as a share of it.
    """

    recording: str
    removed: str
    score: CaseResult
    best: str
    gain: float


def run_ablation(
    recording: SensorLog, nominal: NominalVehicle, progress: Progress | None = None
) -> list[AblationResult]:
    """
    Return what is said of a real drive by its calibrated stand-in, and by it less each term.

    Raises `DataError` for a recording that nothing can be learned from.
    """
    tell = progress or (lambda done, total, text: None)
    tell(0.0, 1.0, f"{recording.name}: calibrating")
    done = calibrate_surrogate(recording, nominal)
    begin, end = float(done.drive.odometry_s[0]), float(done.drive.odometry_s[-1])
    cases: list[Removal | None] = [None, *removals(done.stand_in)]
    out = []
    for i, removal in enumerate(cases):
        name = "" if removal is None else removal.effect
        tell(0.3 + 0.7 * i / len(cases), 1.0, f"{recording.name}: without {name or 'nothing'}")
        stand_in = done.stand_in if removal is None else removal.out_of(done.stand_in)
        label = (
            {"plant": ABLATION_FILE, "effects": []}
            if removal is None
            else removal.label(begin, end)
        )
        started = time.process_time()
        found = identify_mismatch(stand_in, done.drive, nominal)
        result = score_case(
            f"{recording.name}, {name or 'nothing'} removed", label, as_dict(found)
        )
        result.cpu_s = time.process_time() - started
        (_, nothing), (best, least) = (*found.losses, ("", found.losses[0][1]))[:2]
        out.append(AblationResult(recording.name, name, result, best, 1.0 - least / nothing))
    tell(1.0, 1.0, "")
    return out


def ablation_criteria(asked: Sequence[AblationResult]) -> list[Criterion]:
    """Return a bar for each thing that was removed, and for nothing."""
    out = []
    for name in dict.fromkeys(one.removed for one in asked):
        these = [one for one in asked if one.removed == name]
        right = sum(one.score.right == 1.0 for one in these)
        figure = f"{right} of {len(these)} recordings"
        if name:
            first = sum(one.best == name for one in these)
            figure += f", first of the single effects in {first}"
        title = f"real-{name or 'nothing'}-removed"
        out.append(Criterion(
            PASS if right == len(these) else FAIL, title, figure,
            "named in all" if name else "nothing named", len(these),
        ))  # fmt: skip
    return out
