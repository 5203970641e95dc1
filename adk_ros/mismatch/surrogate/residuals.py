# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A drive prepared for runs of the stand-in, and what such a run leaves unexplained.

The grid has steps of 10 ms whose middles fall on the IMU's stamps. Residuals are measured minus
simulated, averaged over bins of 40 ms; the last channel is the way driven in two seconds by the
pose against the integral of odometry's velocity, which only odometry's own scale can bend.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.surrogate.equations_of_motion import integrate
from adk_ros.mismatch.surrogate.state_index import (
    A_X,
    A_Y,
    OUTPUTS,
    S_V_X,
    S_V_Y,
    S_YAW_RATE,
    STATE_SIZE,
    V_X,
    V_Y,
    YAW_ACCELERATION,
    YAW_RATE,
)
from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.numerics.differentiation import savitzky_golay
from adk_ros.numerics.numba_cache import relaxed_kernel
from adk_ros.signals.score import white_noise

STEP_S = 0.01
BIN_S = 0.04
DISTANCE_INTERVAL_S = 2.0
"""s over which the way driven is compared."""
OBSERVER_GAINS = np.array([2.0, 2.0, 6.0])
"""1/s, with which v_x, v_y and yaw rate are drawn towards their measurements."""

COMMAND_GRID_S = 0.0025
"""s, of the commands' integrals."""
_SENSORS = (
    "bias_a_x",
    "bias_a_y",
    "bias_gyro",
    "arm_x",
    "arm_y",
    "imu_delay",
    "gyro_gain",
    "odometry_gain",
    "odometry_lag",
)
_SENSOR_INDEX = np.array([INDEX[name] for name in _SENSORS])


@dataclass(frozen=True)
class ActiveTerms:
    """
    What is added to the parameters when: `amount[j]` times row `gate[j]` of `gates` (g, n).

    Row 0 of the gates is one throughout.
    """

    entries: IntArray
    amounts: FloatArray
    rows: IntArray
    activations: FloatArray

    def merged_with(self, more: ActiveTerms) -> ActiveTerms:
        """Return both, the others' gates after these."""
        first = self.activations.shape[0] - 1
        return ActiveTerms(
            np.concatenate([self.entries, more.entries]),
            np.concatenate([self.amounts, more.amounts]),
            np.concatenate([self.rows, np.where(more.rows > 0, more.rows + first, 0)]),
            np.vstack([self.activations, more.activations[1:]]),
        )


@dataclass(frozen=True)
class ResidualProblem:
    """A drive as the kernels take it; `middle_s` (n,) the middles of the grid's steps."""

    log: SensorLog
    start_s: float
    middle_s: FloatArray
    torques: FloatArray
    angles: FloatArray
    command_start_s: float
    prescribed_v_x: FloatArray
    smoothed_odometry: FloatArray
    """(n, 3) v_x, v_y, yaw rate at the middles, smoothed."""
    pose: FloatArray
    """(n, 3) at the middles."""
    bins: int
    imu_bin: IntArray
    odometry_bin: IntArray
    counts: FloatArray
    """(6, bins) samples in a bin."""
    sigma: FloatArray
    """(6,) noise of a sample, by channel."""
    distances: FloatArray
    """(w, 2) ways driven: by pose, by velocity."""
    distance_sigma: float

    @property
    def steps(self) -> int:
        """Steps of the grid."""
        return int(self.middle_s.shape[0])

    @property
    def bin_noise(self) -> FloatArray:
        """Noise of a bin (6,), by channel."""
        usual = np.maximum(np.median(self.counts, axis=1), 1.0)
        return np.asarray(self.sigma / np.sqrt(usual))

    @property
    def bin_s(self) -> FloatArray:
        """Middles of the bins, s."""
        return np.asarray(self.start_s + BIN_S * (np.arange(self.bins) + 0.5))

    def no_terms(self) -> ActiveTerms:
        """Return terms that add nothing."""
        none = np.zeros(0, dtype=np.int64)
        return ActiveTerms(none, np.zeros(0), none, np.ones((1, self.steps)))

    def run(
        self,
        parameters: FloatArray,
        terms: ActiveTerms | None = None,
        gain: float = 1.0,
        extra: FloatArray | None = None,
    ) -> FloatArray:
        """Run the stand-in; return (OUTPUTS, n). `gain` is a factor on `GAINS`."""
        terms = terms or self.no_terms()
        state = np.zeros(STATE_SIZE)
        state[[S_V_X, S_V_Y, S_YAW_RATE]] = self.smoothed_odometry[0]
        state[5] = state[6] = state[7] = self.log.command[0, 1]
        out = np.empty((OUTPUTS, self.steps))
        gains = np.minimum(OBSERVER_GAINS * gain * STEP_S, 0.5)
        none = np.empty((0, 3))
        integrate(
            parameters,
            terms.entries,
            terms.amounts,
            terms.rows,
            terms.activations,
            self.torques,
            self.angles,
            COMMAND_GRID_S,
            self.start_s - self.command_start_s,
            STEP_S,
            self.prescribed_v_x,
            self.smoothed_odometry,
            gains,
            none if extra is None else extra,
            state,
            out,
            np.empty((0, 6)),
        )
        return out

    def residuals(
        self,
        parameters: FloatArray,
        terms: ActiveTerms | None = None,
        out: FloatArray | None = None,
        gain: float = 1.0,
    ) -> FloatArray:
        """Return (6, bins): mean of measured minus simulated in each bin, zero where none is."""
        terms = terms or self.no_terms()
        out = self.run(parameters, terms, gain) if out is None else out
        sensors = np.repeat(parameters[_SENSOR_INDEX][:, None], self.steps, axis=1)
        for j, index in enumerate(terms.entries):
            for row in np.flatnonzero(np.equal(_SENSOR_INDEX, index)):
                sensors[row] += terms.amounts[j] * terms.activations[terms.rows[j]]
        total = np.zeros((6, self.bins))
        e = self.log
        _collect(
            out,
            sensors,
            self.start_s,
            STEP_S,
            e.imu_s,
            e.imu,
            self.imu_bin,
            e.odometry_s,
            e.odometry,
            self.odometry_bin,
            total,
        )
        return total / np.maximum(self.counts, 1.0)

    def weights(self) -> FloatArray:
        """Return (6, bins): one over the noise of a bin's mean, zero where there is none."""
        return np.asarray(np.sqrt(self.counts) / self.sigma[:, None])

    def distance_residuals(self, parameters: FloatArray) -> FloatArray:
        """Return (w,): way by the pose less way by velocity, over the noise."""
        driven = self.distances[:, 1] / parameters[INDEX["odometry_gain"]]
        return np.asarray((self.distances[:, 0] - driven) / self.distance_sigma)


@relaxed_kernel
def _collect(
    out: FloatArray,
    sensors: FloatArray,
    start: float,
    step: float,
    imu_s: FloatArray,
    imu: FloatArray,
    imu_bin: IntArray,
    odometry_s: FloatArray,
    odometry: FloatArray,
    odometry_bin: IntArray,
    total: FloatArray,
) -> None:
    """Add measured minus simulated of each sample to its bin of `total` (6, bins)."""
    n = out.shape[1]
    rate = np.empty(n)
    value = out[YAW_RATE, 0]
    for k in range(n):
        lag = sensors[8, k]
        if lag > 1e-6:
            keep = np.exp(-step / lag)
            value = out[YAW_RATE, k] + (value - out[YAW_RATE, k]) * keep
        else:
            value = out[YAW_RATE, k]
        rate[k] = value
    for i in range(imu_s.shape[0]):
        at = (imu_s[i] - start) / step - 0.5
        k = min(max(int(at), 0), n - 1)
        at = min(max(at - sensors[5, k] / step, 0.0), n - 1.000001)
        j = int(at)
        part = at - j
        s = sensors[:, k]
        a_x = out[A_X, j] + part * (out[A_X, j + 1] - out[A_X, j])
        a_y = out[A_Y, j] + part * (out[A_Y, j + 1] - out[A_Y, j])
        r = out[YAW_RATE, j] + part * (out[YAW_RATE, j + 1] - out[YAW_RATE, j])
        w = out[YAW_ACCELERATION, j]
        a_x += s[0] - r * r * s[3] - w * s[4]
        a_y += s[1] - r * r * s[4] + w * s[3]
        b = imu_bin[i]
        total[0, b] += imu[i, 0] - a_x
        total[1, b] += imu[i, 1] - a_y
        total[2, b] += imu[i, 2] - s[6] * r - s[2]
    for i in range(odometry_s.shape[0]):
        at = min(max((odometry_s[i] - start) / step - 0.5, 0.0), n - 1.000001)
        j = int(at)
        part = at - j
        b = odometry_bin[i]
        v_x = out[V_X, j] + part * (out[V_X, j + 1] - out[V_X, j])
        v_y = out[V_Y, j] + part * (out[V_Y, j + 1] - out[V_Y, j])
        r = rate[j] + part * (rate[j + 1] - rate[j])
        total[3, b] += odometry[i, 0] - sensors[7, j] * v_x
        total[4, b] += odometry[i, 1] - v_y
        total[5, b] += odometry[i, 2] - r


def cumulative_command(
    at_s: FloatArray, values: FloatArray, spacing: float, end_s: float
) -> FloatArray:
    """Integral of a held signal from its first stamp on, every `spacing` seconds."""
    grid = np.arange(0.0, end_s - at_s[0] + 2.0 * spacing, spacing)
    knots = np.concatenate([at_s - at_s[0], [grid[-1] + spacing]])
    total = np.concatenate([[0.0], np.cumsum(values * np.diff(knots))])
    return np.asarray(np.interp(grid, knots, total))


def _smoothed(evidence: SensorLog, at_s: FloatArray) -> FloatArray:
    """Odometry (len, 3) smoothed, at given times; gaps are bridged."""
    period = float(np.median(np.diff(evidence.odometry_s)))
    even = np.arange(evidence.odometry_s[0], evidence.odometry_s[-1] + 0.5 * period, period)
    columns = []
    for i in range(3):
        filled = np.interp(even, evidence.odometry_s, evidence.odometry[:, i])
        columns.append(np.interp(at_s, even, savitzky_golay(filled)))
    return np.ascontiguousarray(np.column_stack(columns))


def prepare_residual_problem(
    evidence: SensorLog, sigma: FloatArray | None = None
) -> ResidualProblem:
    """Return the course of a drive; `sigma` (6,) replaces the noise found in the evidence."""
    begin = max([*evidence.imu_s[:1], evidence.odometry_s[0]])
    end = min([*evidence.imu_s[-1:], evidence.odometry_s[-1]])
    # Step k's middle is the stamp of an IMU message, as far as they are even.
    start = begin - 0.5 * STEP_S
    n = int((end - begin) / STEP_S + 1e-6) + 1
    ends = start + STEP_S * np.arange(n + 1)
    middle = ends[:-1] + 0.5 * STEP_S
    smooth = _smoothed(evidence, middle)
    followed = _smoothed(evidence, ends)[:, 0].copy()
    pose = np.column_stack(
        [np.interp(middle, evidence.odometry_s, evidence.pose[:, i]) for i in range(3)]
    )
    bins = int(np.ceil(n * STEP_S / BIN_S - 1e-9))

    def bin_of(at_s: FloatArray) -> IntArray:
        index = np.floor((at_s - start) / BIN_S + 1e-6).astype(np.int64)
        return np.asarray(np.clip(index, 0, bins - 1))

    imu_bin, odometry_bin = bin_of(evidence.imu_s), bin_of(evidence.odometry_s)
    counts = np.empty((6, bins))
    counts[:3] = np.bincount(imu_bin, minlength=bins)
    counts[3:] = np.bincount(odometry_bin, minlength=bins)
    way = _travelled_distances(middle, smooth, pose)
    place_noise = np.fmax(white_noise(evidence.pose[:, :2]), 0.005).max()
    return ResidualProblem(
        log=evidence,
        start_s=float(start),
        middle_s=middle,
        torques=cumulative_command(
            evidence.command_s, evidence.command[:, 0], COMMAND_GRID_S, end + 1.0
        ),
        angles=cumulative_command(
            evidence.command_s, evidence.command[:, 1], COMMAND_GRID_S, end + 1.0
        ),
        command_start_s=float(evidence.command_s[0]),
        prescribed_v_x=followed,
        smoothed_odometry=smooth,
        pose=pose,
        bins=bins,
        imu_bin=imu_bin,
        odometry_bin=odometry_bin,
        counts=counts,
        sigma=evidence.noise() if sigma is None else sigma,
        distances=way,
        distance_sigma=float(np.sqrt(2.0) * place_noise + 0.005),
    )


def _travelled_distances(middle: FloatArray, smooth: FloatArray, pose: FloatArray) -> FloatArray:
    """Way driven in each stretch of `WAY` seconds (w, 2): by the pose, by the velocity."""
    heading = savitzky_golay(pose[:, 2], 51, 3)
    every = round(DISTANCE_INTERVAL_S / STEP_S)
    cuts = np.arange(0, middle.shape[0], every)
    v_x = STEP_S * (smooth[:, 0] * np.cos(heading) - smooth[:, 1] * np.sin(heading))
    v_y = STEP_S * (smooth[:, 0] * np.sin(heading) + smooth[:, 1] * np.cos(heading))
    total = np.column_stack([np.cumsum(v_x), np.cumsum(v_y)])
    by_velocity = np.diff(total[cuts], axis=0)
    by_pose = np.diff(pose[cuts, :2], axis=0)
    length = np.hypot(by_velocity[:, 0], by_velocity[:, 1])
    unit = by_velocity / np.maximum(length, 1e-6)[:, None]
    return np.ascontiguousarray(np.column_stack([(by_pose * unit).sum(axis=1), length]))
