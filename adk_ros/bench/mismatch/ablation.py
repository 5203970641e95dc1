# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Ablation on real recordings: remove a known term from a calibrated surrogate and recover it.

The ground truth of a real recording is unknown. So a surrogate model is calibrated on the
recording (a pedal position is converted to a torque from the acceleration), and its residual
counts as its model error. Then one term is removed from the surrogate, and `adk mismatch` must
name that term and its size. As a control, the full surrogate must show no mismatch.
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
from adk_ros.mismatch.library.surrogate_parameters import (
    HIGH,
    INDEX,
    LOW,
    SIZE,
    SURROGATE_PARAMETERS,
)
from adk_ros.mismatch.recording.checks import check_recording
from adk_ros.mismatch.recording.inferred_torque import with_inferred_torque
from adk_ros.mismatch.recording.nominal_vehicle import NominalVehicle
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.report.result_files import as_dict
from adk_ros.mismatch.surrogate.identification import (
    RESIDUAL_SUBSAMPLING,
    SETTLING_BINS,
    SurrogateModel,
    fit_with_annealed_observer,
    fitted_parameters,
)
from adk_ros.mismatch.surrogate.residuals import ResidualProblem, prepare_residual_problem
from adk_ros.mismatch.surrogate.substeps import scale_of
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.differentiation import savitzky_golay
from adk_ros.numerics.levenberg_marquardt import BoundedParameters
from adk_ros.numerics.similarity import scaled_by_unit, time_scale

ABLATION_FILE = "real"

Progress = Callable[[float, float, str], None]

_CALIBRATED: dict[str, tuple[float, float]] = {
    # name: (prior standard deviation, step of the finite differences)
    "steer_offset": (0.02, 2e-4),
    "steer_gain": (0.1, 0.005),
    "torque_gain": (0.2, 0.005),
    "brake_gain": (0.3, 0.01),
    "torque_offset": (200.0, 3.0),
    "yaw_inertia": (200.0, 10.0),
}
_ERROR = np.array([0.3, 0.3, 0.01, 0.1, 0.05, 0.01])
"""Assumed residual of such a model on a real recording, by channel (a_x, a_y in m/s², yaw rate in
rad/s, v_x, v_y in m/s, yaw rate in rad/s): far above the sensor noise."""
_MAX_SIGMAS = 3.0
"""Largest deviation of a parameter from its start, in prior standard deviations."""
_MIN_SPEED = 3.0
"""Speed below which data are not used, m/s."""


@dataclass(frozen=True)
class Removal:
    """A term to remove: `amount` of the parameter `entry`, which `effect` then has to supply."""

    effect: str
    parameter: str
    entry: str
    amount: float
    neutral: float = 0.0

    def out_of(self, plain: SurrogateModel) -> SurrogateModel:
        """Return the surrogate without the term."""
        p = plain.parameters.copy()
        p[INDEX[self.entry]] -= self.amount
        return replace(plain, parameters=p)

    def label(self, start_s: float, end_s: float) -> dict[str, Any]:
        """Return the label: the expected answer."""
        return {"plant": ABLATION_FILE, "effects": [{
            "name": self.effect, "params": {self.parameter: self.neutral + self.amount},
            "kind": "always", "time_intervals_s": [[start_s, end_s]],
        }]}  # fmt: skip


def removals(plain: SurrogateModel) -> tuple[Removal, ...]:
    """Return the removals: the whole drag, and a third of the steering gain."""
    drag, gain = (float(plain.parameters[INDEX[name]]) for name in ("drag_area", "steer_gain"))
    return (
        Removal("aero_drag", "cda", "drag_area", drag),
        Removal("steering_ratio", "scale", "steer_gain", gain / 3.0, 1.0),
    )


@dataclass(frozen=True)
class CalibratedSurrogate:
    """A recording with torque commands, and the surrogate model calibrated on it."""

    surrogate: SurrogateModel
    drive: SensorLog
    notes: tuple[str, ...]


def with_torque(e: SensorLog, mass: float, radius: float) -> tuple[SensorLog, str]:
    """
    Convert the pedal position to a torque; return the recording and a note on the conversion.

    m dv_x/dt = k+ p+ / R + k- p- / R - c v_x² - d, by least squares over the moving part.
    :raises DataError: the pedal does not accelerate and decelerate the vehicle.
    """
    pedal = e.command[:, 0]
    v_x = savitzky_golay(e.odometry[:, 0], e.odometry_period_s)
    along = np.gradient(v_x, e.odometry_s) - e.odometry[:, 1] * e.odometry[:, 2]
    in_force = pedal[np.maximum(np.searchsorted(e.command_s, e.odometry_s, side="right") - 1, 0)]
    use = v_x > _MIN_SPEED
    rows = np.column_stack(
        [np.maximum(in_force, 0.0), np.minimum(in_force, 0.0), -(v_x**2), -np.ones_like(v_x)]
    )
    solved, *_ = np.linalg.lstsq(rows[use], along[use], rcond=None)
    if solved[0] <= 0.0 or solved[1] <= 0.0:
        raise DataError(
            f"{e.name}: the drive command does not accelerate and decelerate the vehicle"
        )
    k = mass * radius * solved[:2]
    torque = np.where(pedal > 0.0, k[0], k[1]) * pedal
    command = np.column_stack([torque, e.command[:, 1]])
    text = f"pedal converted to {k[0]:.0f} N·m at full throttle, {k[1]:.0f} N·m at full brake"
    return replace(e, command=command), text


def calibrate_surrogate(
    recording: SensorLog, nominal: NominalVehicle, *, infer_torque: bool = False
) -> CalibratedSurrogate:
    """
    Calibrate a surrogate model on a real recording.

    `infer_torque`: where there is none, take the one that the motion needs, which is no evidence
    about longitudinal forces, instead of converting a pedal.
    :raises DataError: the recording is not usable.
    """
    has_imu = recording.imu_s.size > 0
    part = recording if has_imu else longest_moving_segment(recording)
    notes = []
    scope = observable_effects(part, nominal.mass, nominal.wheel_radius, has_imu)
    if not scope.torque and infer_torque:
        part = with_inferred_torque(part, nominal.parameters())
    elif not scope.torque:
        part, text = with_torque(part, nominal.mass, nominal.wheel_radius)
        notes.append(text)
    check_recording(with_pseudo_imu(part))
    scope = observable_effects(part, nominal.mass, nominal.wheel_radius, has_imu)
    start = scope.adapted(SurrogateModel(
        nominal.parameters(), np.zeros(6), np.zeros((6, 1)), np.empty((0, SIZE))
    )).parameters  # fmt: skip
    problem = prepare_residual_problem(with_pseudo_imu(part))
    surrogate = _calibrate(problem, start, scope.lost_channels())
    return CalibratedSurrogate(surrogate, part, tuple(notes))


def _calibrate(
    course: ResidualProblem, start: FloatArray, lost_channels: Sequence[int]
) -> SurrogateModel:
    """Fit all uncertain parameters of a real vehicle to the recording."""
    size = scale_of(start)
    fitted: dict[str, tuple[float, float]] = dict(fitted_parameters((), start))
    for name, pair in _CALIBRATED.items():
        unit = SURROGATE_PARAMETERS[name].unit
        fitted[name] = (scaled_by_unit(pair[0], unit, size), scaled_by_unit(pair[1], unit, size))
    names = list(fitted)
    where = np.array([INDEX[name] for name in names])
    spread = np.array([fitted[name][0] for name in names])
    step = np.array([fitted[name][1] for name in names])
    counted = course.weights() > 0.0
    slow = np.interp(
        course.bin_s, course.middle_s, course.smoothed_odometry[:, 0]
    ) < _MIN_SPEED * time_scale(size)
    counted[:, slow | (course.bin_s < course.start_s + 1.0)] = False
    counted[list(lost_channels)] = False
    mean = start[where].copy()
    low = np.maximum(mean - _MAX_SIGMAS * spread, LOW[where])
    high = np.minimum(mean + _MAX_SIGMAS * spread, HIGH[where])
    p = start.copy()
    p[where] = fit_with_annealed_observer(
        course,
        p,
        where,
        BoundedParameters(mean, low, high, step, mean, spread),
        RESIDUAL_SUBSAMPLING * counted / _error_at(size)[:, None],
    ).x
    # Bins without data are no errors of zero.
    used = np.array(counted.any(axis=0))
    used[:SETTLING_BINS] = False
    left = (course.residuals(p) * counted)[:, used]
    error = np.sqrt((left**2).sum(axis=1) / np.maximum(counted[:, used].sum(axis=1), 1))
    return SurrogateModel(p, error, left, np.empty((0, SIZE)))


def _error_at(size: float) -> FloatArray:
    """Return the assumed residual (6,) at a scale of lengths: accelerations stay equal."""
    time = time_scale(size)
    return np.asarray(_ERROR * np.array([1.0, 1.0, 1.0 / time, time, time, 1.0 / time]))


@dataclass(frozen=True)
class AblationResult:
    """
    Result after the removal of a term ("" for none): its score, and the best single effect.

    `gain`: relative reduction of the loss by the best single effect.
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
    Analyse a recording with its calibrated surrogate, and with each term removed from it.

    :raises DataError: the recording is not usable.
    """
    tell = progress or (lambda done, total, text: None)
    tell(0.0, 1.0, f"{recording.name}: calibrating")
    done = calibrate_surrogate(recording, nominal)
    begin, end = float(done.drive.odometry_s[0]), float(done.drive.odometry_s[-1])
    cases: list[Removal | None] = [None, *removals(done.surrogate)]
    out = []
    for i, removal in enumerate(cases):
        name = "" if removal is None else removal.effect
        tell(0.3 + 0.7 * i / len(cases), 1.0, f"{recording.name}: without {name or 'nothing'}")
        surrogate = done.surrogate if removal is None else removal.out_of(done.surrogate)
        label = (
            {"plant": ABLATION_FILE, "effects": []}
            if removal is None
            else removal.label(begin, end)
        )
        started = time.process_time()
        found = identify_mismatch(surrogate, done.drive, nominal)
        result = score_case(
            f"{recording.name}, {name or 'nothing'} removed", label, as_dict(found)
        )
        result.cpu_s = time.process_time() - started
        first, second = (*found.steps, found.steps[0])[:2]
        gained = 1.0 - second.loss / first.loss
        out.append(AblationResult(recording.name, name, result, "+".join(second.names), gained))
    tell(1.0, 1.0, "")
    return out


def ablation_criteria(results: Sequence[AblationResult]) -> list[Criterion]:
    """Return one criterion per removed term, and one for the control without a removal."""
    out = []
    for name in dict.fromkeys(result.removed for result in results):
        these = [result for result in results if result.removed == name]
        right = sum(result.score.right == 1.0 for result in these)
        figure = f"{right} of {len(these)} recordings"
        if name:
            first = sum(result.best == name for result in these)
            figure += f", best single effect in {first}"
        title = f"real-{name or 'nothing'}-removed"
        out.append(Criterion(
            PASS if right == len(these) else FAIL, title, figure,
            "named in all" if name else "nothing named", len(these),
        ))  # fmt: skip
    return out
