# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Residuals of a surrogate model: a recording on the integration grid, measured minus simulated.

The grid has steps of 10 ms whose middles fall on the IMU stamps. Residuals are averaged over bins
of 40 ms. A further residual compares the distance travelled in two seconds by the pose with the
integral of the odometry velocity: only the scale of the odometry changes it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.surrogate.command_integrals import CommandIntegrals, integrate_commands
from adk_ros.mismatch.surrogate.run_inputs import (
    ActiveTerms,
    RunInputs,
    no_extra,
    no_terms,
    run_buffers,
)
from adk_ros.mismatch.surrogate.state_index import (
    A_X,
    A_Y,
    IMU_A_X,
    IMU_A_Y,
    IMU_YAW_RATE,
    N_CHANNELS,
    ODOMETRY_V_X,
    ODOMETRY_V_Y,
    ODOMETRY_YAW_RATE,
    S_PLAY,
    S_STEER,
    S_STEER_MORE,
    S_V_X,
    S_V_Y,
    S_YAW_RATE,
    STATE_SIZE,
    V_X,
    V_Y,
    YAW_ACCELERATION,
    YAW_RATE,
)
from adk_ros.mismatch.surrogate.substeps import integrate_in_substeps
from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.numerics.differentiation import savitzky_golay
from adk_ros.numerics.numba_cache import relaxed_kernel
from adk_ros.signals.score import white_noise

STEP_S = 0.01
"""Integration step, s: the period of a 100 Hz IMU."""
BIN_S = 0.04
"""Duration of a residual bin, s: two periods of 50 Hz odometry."""
_STEPS_PER_BIN = round(BIN_S / STEP_S)
DISTANCE_INTERVAL_S = 2.0
"""Interval over which travelled distances are compared, s."""
OBSERVER_GAINS = np.array([2.0, 2.0, 6.0])
"""Gains that correct v_x, v_y and yaw rate towards their measurements, 1/s."""
MAX_CORRECTION_SHARE = 0.5
"""Largest share of an innovation that the observer corrects in one step: above it, it rings."""
MAX_RESIDUAL = 1e6
"""Largest residual, SI: far above any motion, and its square does not overflow."""
POSITION_NOISE_FLOOR_M = 0.005
"""Least standard deviation assumed of a pose, m: a simulated pose has none."""

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
_BIAS_A_X, _BIAS_A_Y, _BIAS_GYRO, _ARM_X, _ARM_Y, _IMU_DELAY = range(6)
_GYRO_GAIN, _ODOMETRY_GAIN, _ODOMETRY_LAG = range(6, 9)
_SENSOR_INDEX = np.array([INDEX[name] for name in _SENSORS])


class SensorSamples(NamedTuple):
    """Samples of one sensor: stamps (m,) in s, values (m, 3), the bin of each (m,)."""

    stamps: FloatArray
    values: FloatArray
    bins: IntArray


class TimeGrid(NamedTuple):
    """Integration grid: `start` of the first step and length of a step, s."""

    start: float
    step: float


@dataclass(frozen=True)
class ResidualProblem:
    """A recording on the integration grid; `middle_s` (n,): the middles of the grid's steps."""

    log: SensorLog
    start_s: float
    middle_s: FloatArray
    commands: CommandIntegrals
    command_start_s: float
    """Stamp of the first command, where the command integrals start."""
    prescribed_v_x: FloatArray
    """(n + 1,) smoothed v_x at the ends of the steps."""
    smoothed_odometry: FloatArray
    """(n, 3) v_x, v_y, yaw rate at the middles, smoothed."""
    pose: FloatArray
    """(n, 3) x, y, heading at the middles."""
    bins: int
    imu_bin: IntArray
    odometry_bin: IntArray
    counts: FloatArray
    """(6, bins) samples in a bin."""
    sigma: FloatArray
    """(6,) noise of a sample, by channel."""
    distances: FloatArray
    """(w, 2) distance travelled in each interval: by pose, by velocity."""
    distance_sigma: float

    @property
    def steps(self) -> int:
        """Number of steps of the grid."""
        return int(self.middle_s.shape[0])

    @property
    def bin_noise(self) -> FloatArray:
        """Noise of a bin's mean (6,), by channel."""
        typical_count = np.maximum(np.median(self.counts, axis=1), 1.0)
        return np.asarray(self.sigma / np.sqrt(typical_count))

    @property
    def bin_s(self) -> FloatArray:
        """Middles of the bins, s."""
        return np.asarray(self.start_s + BIN_S * (np.arange(self.bins) + 0.5))

    def binned(self, values: FloatArray) -> FloatArray:
        """Return the mean of a signal (n,) on the grid in each bin (b,)."""
        first = np.arange(0, self.steps, _STEPS_PER_BIN)
        count = np.minimum(_STEPS_PER_BIN, self.steps - first)
        return np.asarray(np.add.reduceat(values, first) / count)

    def mean_commands(self) -> tuple[FloatArray, FloatArray]:
        """Return the mean torque and road-wheel angle of each step (n,), N·m and rad."""
        commands = self.commands
        at = self.start_s - self.command_start_s + STEP_S * np.arange(self.steps + 1)
        grid = commands.spacing * np.arange(commands.torque.shape[0])
        torque = np.diff(np.interp(at, grid, commands.torque)) / STEP_S
        return torque, np.diff(np.interp(at, grid, commands.angle)) / STEP_S

    def no_terms(self) -> ActiveTerms:
        """Return terms that add nothing."""
        return no_terms(self.steps)

    def run(
        self,
        parameters: FloatArray,
        terms: ActiveTerms | None = None,
        gain: float = 1.0,
        extra: FloatArray | None = None,
    ) -> FloatArray:
        """
        Run the surrogate model along the recording; return its output (OUTPUTS, n).

        `gain` multiplies `OBSERVER_GAINS`; `extra` (n, 4) is added to the accelerations
        and the road-wheel angle.
        """
        state = np.zeros(STATE_SIZE)
        state[[S_V_X, S_V_Y, S_YAW_RATE]] = self.smoothed_odometry[0]
        state[[S_STEER, S_STEER_MORE, S_PLAY]] = self.log.command[0, 1]
        buffers = run_buffers(state, self.steps)
        shares = observer_shares(gain)
        if not self.log.measures_v_y:
            shares[1] = 0.0
        inputs = RunInputs(
            self.commands,
            self.start_s - self.command_start_s,
            STEP_S,
            self.prescribed_v_x,
            self.smoothed_odometry,
            shares,
            no_extra() if extra is None else extra,
        )
        integrate_in_substeps(parameters, terms or self.no_terms(), inputs, buffers)
        return buffers.output

    def residuals(
        self,
        parameters: FloatArray,
        terms: ActiveTerms | None = None,
        out: FloatArray | None = None,
        gain: float = 1.0,
    ) -> FloatArray:
        """
        Return (6, bins): mean of measured minus simulated per bin, zero for an empty bin.

        Of a given output `out`, values that are not finite stay so.
        """
        limit = limited if out is None else np.asarray
        terms = terms or self.no_terms()
        out = self.run(parameters, terms, gain) if out is None else out
        sensors = np.repeat(parameters[_SENSOR_INDEX][:, None], self.steps, axis=1)
        for j, entry in enumerate(terms.entries):
            for row in np.flatnonzero(np.equal(_SENSOR_INDEX, entry)):
                sensors[row] += terms.amounts[j] * terms.activations[terms.rows[j]]
        total = np.zeros((N_CHANNELS, self.bins))
        log = self.log
        _sum_residuals(
            out,
            sensors,
            TimeGrid(self.start_s, STEP_S),
            SensorSamples(log.imu_s, log.imu, self.imu_bin),
            SensorSamples(log.odometry_s, log.odometry, self.odometry_bin),
            total,
        )
        return np.asarray(limit(total / np.maximum(self.counts, 1.0)))

    def weights(self) -> FloatArray:
        """Return (6, bins): inverse noise of each bin's mean, zero for an empty bin."""
        return np.asarray(np.sqrt(self.counts) / self.sigma[:, None])

    def distance_residuals(self, parameters: FloatArray) -> FloatArray:
        """Return (w,): distance by pose minus distance by velocity, over the noise."""
        by_velocity = self.distances[:, 1] / parameters[INDEX["odometry_gain"]]
        return np.asarray((self.distances[:, 0] - by_velocity) / self.distance_sigma)


def limited(residuals: FloatArray) -> FloatArray:
    """
    Return residuals with those of a diverged run limited to `MAX_RESIDUAL`.

    Far from the optimum a fit may try parameters that have no stable motion: such a trial must
    cost much, and neither overflow nor end the fit.
    """
    if np.abs(residuals).max(initial=0.0) < MAX_RESIDUAL:
        return residuals
    finite = np.nan_to_num(residuals, nan=MAX_RESIDUAL, posinf=MAX_RESIDUAL, neginf=-MAX_RESIDUAL)
    return np.asarray(np.clip(finite, -MAX_RESIDUAL, MAX_RESIDUAL))


def observer_shares(gain: float) -> FloatArray:
    """Return the share (3,) of each innovation that the observer corrects in one step."""
    return np.minimum(OBSERVER_GAINS * gain * STEP_S, MAX_CORRECTION_SHARE)


@relaxed_kernel
def _sum_residuals(
    out: FloatArray,
    sensors: FloatArray,
    grid: TimeGrid,
    imu: SensorSamples,
    odometry: SensorSamples,
    total: FloatArray,
) -> None:
    """Add measured minus simulated of each sample to its bin of `total` (6, bins)."""
    n = out.shape[1]
    start, step = grid.start, grid.step
    filtered_yaw_rate = np.empty(n)
    value = out[YAW_RATE, 0]
    for k in range(n):
        lag = sensors[_ODOMETRY_LAG, k]
        if lag > 1e-6:
            # Exact for a yaw rate that is linear from one step to the next: with steps of a
            # constant one the filter would lag by half a step less than its time constant.
            keep = np.exp(-step / lag)
            mean = (1.0 - keep) * lag / step
            before = out[YAW_RATE, max(k - 1, 0)]
            value = keep * value + (mean - keep) * before + (1.0 - mean) * out[YAW_RATE, k]
        else:
            value = out[YAW_RATE, k]
        filtered_yaw_rate[k] = value
    for i in range(imu.stamps.shape[0]):
        at = (imu.stamps[i] - start) / step - 0.5
        k = min(max(int(at), 0), n - 1)
        at = min(max(at - sensors[_IMU_DELAY, k] / step, 0.0), n - 1.000001)
        j = int(at)
        part = at - j
        s = sensors[:, k]
        a_x = out[A_X, j] + part * (out[A_X, j + 1] - out[A_X, j])
        a_y = out[A_Y, j] + part * (out[A_Y, j + 1] - out[A_Y, j])
        r = out[YAW_RATE, j] + part * (out[YAW_RATE, j + 1] - out[YAW_RATE, j])
        w = out[YAW_ACCELERATION, j]
        a_x += s[_BIAS_A_X] - r * r * s[_ARM_X] - w * s[_ARM_Y]
        a_y += s[_BIAS_A_Y] - r * r * s[_ARM_Y] + w * s[_ARM_X]
        b = imu.bins[i]
        total[IMU_A_X, b] += imu.values[i, 0] - a_x
        total[IMU_A_Y, b] += imu.values[i, 1] - a_y
        total[IMU_YAW_RATE, b] += imu.values[i, 2] - s[_GYRO_GAIN] * r - s[_BIAS_GYRO]
    for i in range(odometry.stamps.shape[0]):
        at = min(max((odometry.stamps[i] - start) / step - 0.5, 0.0), n - 1.000001)
        j = int(at)
        part = at - j
        b = odometry.bins[i]
        v_x = out[V_X, j] + part * (out[V_X, j + 1] - out[V_X, j])
        v_y = out[V_Y, j] + part * (out[V_Y, j + 1] - out[V_Y, j])
        r = filtered_yaw_rate[j] + part * (filtered_yaw_rate[j + 1] - filtered_yaw_rate[j])
        total[ODOMETRY_V_X, b] += odometry.values[i, 0] - sensors[_ODOMETRY_GAIN, j] * v_x
        total[ODOMETRY_V_Y, b] += odometry.values[i, 1] - v_y
        total[ODOMETRY_YAW_RATE, b] += odometry.values[i, 2] - r


def _smoothed(log: SensorLog, at_s: FloatArray) -> FloatArray:
    """Return the odometry (len, 3) smoothed, at given times; gaps are interpolated."""
    period = log.odometry_period_s
    even = np.arange(log.odometry_s[0], log.odometry_s[-1] + 0.5 * period, period)
    columns = []
    for i in range(3):
        resampled = np.interp(even, log.odometry_s, log.odometry[:, i])
        columns.append(np.interp(at_s, even, savitzky_golay(resampled, period)))
    return np.ascontiguousarray(np.column_stack(columns))


def prepare_residual_problem(log: SensorLog, sigma: FloatArray | None = None) -> ResidualProblem:
    """Put a recording on the integration grid; `sigma` (6,) replaces its estimated noise."""
    begin = max([*log.imu_s[:1], log.odometry_s[0]])
    end = min([*log.imu_s[-1:], log.odometry_s[-1]])
    # The middle of step k is the stamp of an IMU message if the stamps are evenly spaced.
    start = begin - 0.5 * STEP_S
    n = int((end - begin) / STEP_S + 1e-6) + 1
    ends = start + STEP_S * np.arange(n + 1)
    middle = ends[:-1] + 0.5 * STEP_S
    smoothed = _smoothed(log, middle)
    prescribed_v_x = _smoothed(log, ends)[:, 0].copy()
    pose = np.column_stack([np.interp(middle, log.odometry_s, log.pose[:, i]) for i in range(3)])
    bins = int(np.ceil(n * STEP_S / BIN_S - 1e-9))

    def bin_of(at_s: FloatArray) -> IntArray:
        index = np.floor((at_s - start) / BIN_S + 1e-6).astype(np.int64)
        return np.asarray(np.clip(index, 0, bins - 1))

    imu_bin, odometry_bin = bin_of(log.imu_s), bin_of(log.odometry_s)
    counts = np.empty((N_CHANNELS, bins))
    counts[IMU_A_X : IMU_YAW_RATE + 1] = np.bincount(imu_bin, minlength=bins)
    counts[ODOMETRY_V_X : ODOMETRY_YAW_RATE + 1] = np.bincount(odometry_bin, minlength=bins)
    position_noise = np.fmax(white_noise(log.pose[:, :2]), POSITION_NOISE_FLOOR_M).max()
    return ResidualProblem(
        log=log,
        start_s=float(start),
        middle_s=middle,
        commands=integrate_commands(log.command_s, log.command, end + 1.0),
        command_start_s=float(log.command_s[0]),
        prescribed_v_x=prescribed_v_x,
        smoothed_odometry=smoothed,
        pose=pose,
        bins=bins,
        imu_bin=imu_bin,
        odometry_bin=odometry_bin,
        counts=counts,
        sigma=log.noise() if sigma is None else sigma,
        distances=_travelled_distances(middle, smoothed, pose),
        distance_sigma=float(np.sqrt(2.0) * position_noise + POSITION_NOISE_FLOOR_M),
    )


def _travelled_distances(middle: FloatArray, smoothed: FloatArray, pose: FloatArray) -> FloatArray:
    """
    Return the distance travelled in each interval (w, 2): by pose, by velocity.

    None of a recording without positions.
    """
    if not np.ptp(pose[:, :2], axis=0).any():
        return np.empty((0, 2))
    heading = savitzky_golay(pose[:, 2], STEP_S)
    stride = round(DISTANCE_INTERVAL_S / STEP_S)
    cuts = np.arange(0, middle.shape[0], stride)
    d_x = STEP_S * (smoothed[:, 0] * np.cos(heading) - smoothed[:, 1] * np.sin(heading))
    d_y = STEP_S * (smoothed[:, 0] * np.sin(heading) + smoothed[:, 1] * np.cos(heading))
    total = np.column_stack([np.cumsum(d_x), np.cumsum(d_y)])
    by_velocity = np.diff(total[cuts], axis=0)
    by_pose = np.diff(pose[cuts, :2], axis=0)
    length = np.hypot(by_velocity[:, 0], by_velocity[:, 1])
    unit = by_velocity / np.maximum(length, 1e-6)[:, None]
    return np.ascontiguousarray(np.column_stack([(by_pose * unit).sum(axis=1), length]))
