# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Wheel force as a monotone map of the pedals, fitted to the motion.

    m a_x = sum_jk b_jk w_j(v_x) h_k(throttle) - sum_k c_k h_k(brake) - d_0 - d_1 v_x²

a_x is the specific force, of which gravity is no part: the slope need not be known. h_k rises from
0 to 1 between two positions of a pedal, w_j interpolates between speeds, or is 1 in one gear.
With b, c and d_1 not negative the map is monotone and zero at a released pedal (non-negative
least squares: C. L. Lawson, R. J. Hanson, Solving Least Squares Problems, 1974, chapter 23).

Mass and force are not separable: an error of the mass scales the map. Nor are rolling resistance
and engine braking, which stay in d_0. Numbers of positions and speeds are those with the least
error on blocks that were left out.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from adk_ros.calibration.criteria import BLOCK_S, MIN_SPARE_BLOCKS, PERIOD_S
from adk_ros.calibration.grid import shifted, smooth
from adk_ros.calibration.regression import Estimate, draws, inflation
from adk_ros.numerics.arrays import FloatArray

_POSITIONS, _SPEEDS = (2, 4, 8), (1, 2, 4)
"""Numbers of positions and speeds to choose from: doubled until the left-out error grows."""
_DELAYS_S = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
"""From pedal to force: brakes build up in 0.1 to 0.3 s, a turbocharged engine in up to 0.6 s; by
choice."""
_EVERY = 5
"""Samples from one that is used to the next: 0.1 s."""
_FOLDS = 5
"""Parts of the blocks that are left out in turn, the usual number (T. Hastie et al., The Elements
of Statistical Learning, 2009, section 7.10)."""
_RIDGE = 1e-9
"""Relative; keeps the matrix of columns that no sample excites invertible."""
_LEAST_PEDAL = 0.01
"""Share of the largest value below which a pedal is released: resolution of its sensor."""


@dataclass(frozen=True)
class ForceTable:
    """
    Force of one pedal, N, interpolated linearly between positions and constant beyond them.

    `pedal` (k,) ascending. `force` (j, k): a row for each entry of `at` (j,), which are speeds in
    m/s, interpolated as well, or gears; `by` is "speed", "gear", or "" with one row.
    """

    pedal: FloatArray
    force: FloatArray
    by: str = ""
    at: FloatArray | None = None

    def __call__(
        self, pedal: FloatArray, speed: FloatArray | None = None, gear: FloatArray | None = None
    ) -> FloatArray:
        """Return the force (n,) of pedal positions (n,), at a speed (n,) or in a gear (n,)."""
        rows = np.vstack([np.interp(pedal, self.pedal, row) for row in self.force])
        if self.at is None:
            return np.asarray(rows[0])
        with_speed = speed if self.by == "speed" else gear
        assert with_speed is not None
        weights = _shares(with_speed, self.at, self.by)
        return np.asarray((rows.T * weights).sum(axis=1))


class PedalSamples(NamedTuple):
    """
    Samples (n,) every `PERIOD_S`: the force that the motion takes, N, and what causes it.

    `force` and `speed` (m/s) are smoothed; pedals and gear are as held, None if not recorded.
    `weights`: 0 or 1.
    """

    force: FloatArray
    speed: FloatArray
    weights: FloatArray
    throttle: FloatArray | None
    brake: FloatArray | None
    gear: FloatArray | None

    def later(self, delay_s: float) -> PedalSamples:
        """Return the samples with pedals that act later."""
        throttle, brake = (
            None if pedal is None else shifted(pedal, delay_s)
            for pedal in (self.throttle, self.brake)
        )
        return self._replace(throttle=throttle, brake=brake)


@dataclass(frozen=True)
class PedalMap:
    """
    Fitted tables of the pedals, None of one that is not recorded.

    `full_throttle`, `full_brake`: force at the largest recorded position, at the median speed, N.
    `delay_s` from pedal to force. `r_squared`: of the force on blocks that were left out.
    `seconds` of driving.
    """

    throttle: ForceTable | None
    brake: ForceTable | None
    full_throttle: Estimate | None
    full_brake: Estimate | None
    delay_s: float
    r_squared: float
    seconds: float


class _Layout(NamedTuple):
    throttle: FloatArray
    brake: FloatArray
    by: str
    at: FloatArray

    @property
    def sizes(self) -> tuple[int, int]:
        """Number of columns of throttle and brake."""
        rises = max(self.throttle.size - 1, 0)
        return rises * max(self.at.size, 1), max(self.brake.size - 1, 0)

    def columns(self, samples: PedalSamples) -> FloatArray:
        """
        Return the columns (n, c): throttle, brake, resistance.

        Those of the pedals are smoothed as the force is, after the map's nonlinearity.
        """
        parts = []
        if samples.throttle is not None:
            rises = _rises(samples.throttle, self.throttle)
            given = samples.gear if self.by == "gear" else samples.speed
            assert given is not None
            shares = _shares(given, self.at, self.by) if self.at.size else np.ones((len(rises), 1))
            parts.append((shares[:, :, None] * rises[:, None, :]).reshape(len(rises), -1))
        if samples.brake is not None:
            parts.append(-_rises(samples.brake, self.brake))
        one = np.ones_like(samples.speed)
        smoothed = [smooth(column) for part in parts for column in part.T]
        return np.column_stack([*smoothed, -(samples.speed**2), one, -one])


class _Blocks(NamedTuple):
    matrices: FloatArray
    vectors: FloatArray
    squares: FloatArray
    sums: FloatArray
    counts: FloatArray

    def solved(self, counts: FloatArray) -> FloatArray:
        """Return the coefficients (c,) with each block counted (b,) times."""
        matrix = np.tensordot(counts, self.matrices, 1)
        vector = counts @ self.vectors
        scale = np.sqrt(np.maximum(np.diag(matrix), 1e-12))
        scaled = matrix / np.outer(scale, scale) + _RIDGE * np.eye(scale.size)
        root = np.linalg.cholesky(scaled)
        values, _ = nnls(root.T, np.linalg.solve(root, vector / scale))
        return np.asarray(values / scale)

    def error(self, values: FloatArray, counts: FloatArray) -> float:
        """Return the sum of squared errors over counted blocks."""
        each = self.squares - 2.0 * self.vectors @ values
        each = each + np.einsum("i,bij,j->b", values, self.matrices, values)
        return float(counts @ each)


def fit_pedals(samples: PedalSamples) -> PedalMap | None:
    """Return the map of the pedals; None with too few blocks of driving."""
    layouts = list(_layouts(samples))
    # The delay by the smallest layout; the others have the same.
    at_delays = {delay_s: samples.later(delay_s) for delay_s in _DELAYS_S}
    tried = [(fit, key) for key, late in at_delays.items() if (fit := _tried(late, layouts[0]))]
    if not tried:
        return None
    delay_s = min(tried, key=lambda each: each[0].error)[1]
    fits = [fit for layout in layouts if (fit := _tried(at_delays[delay_s], layout))]
    error, layout, blocks = min(fits, key=lambda each: each.error)
    total = float(blocks.sums.sum() ** 2 / blocks.counts.sum())
    ones = np.ones(blocks.counts.size)
    values = blocks.solved(ones)
    resampled = np.array([blocks.solved(row) for row in draws(ones.size)])
    resampled = values + inflation(ones.size, values.size) * (resampled - values)
    seconds = float(samples.weights.sum()) * PERIOD_S
    throttle, brake = _tables(layout, values)
    median = np.array([np.median(samples.speed[samples.weights > 0.0])])
    many = [_tables(layout, row) for row in resampled]
    gear = None if samples.gear is None else np.array([np.median(samples.gear)])

    def full(index: int) -> Estimate | None:
        table = (throttle, brake)[index]
        if table is None:
            return None
        at = (table.pedal[-1:], median, gear)
        spread = [float(t(*at)[0]) for both in many if (t := both[index]) is not None]
        return Estimate.of(float(table(*at)[0]), np.array(spread), seconds)

    r_squared = 1.0 - error / (float(blocks.squares.sum()) - total)
    return PedalMap(throttle, brake, full(0), full(1), delay_s, r_squared, seconds)


class _Fit(NamedTuple):
    error: float
    layout: _Layout
    blocks: _Blocks


def _tried(samples: PedalSamples, layout: _Layout) -> _Fit | None:
    """Return the error of a layout on blocks that were left out; None with too few blocks."""
    blocks = _blocks(samples, layout.columns(samples))
    return None if blocks is None else _Fit(_left_out_error(blocks), layout, blocks)


def _layouts(samples: PedalSamples) -> Iterator[_Layout]:
    """Yield the numbers of positions and speeds to choose from; gears where they are recorded."""
    moving = samples.weights > 0.0
    speed, none = samples.speed[moving], np.empty(0)
    scales: list[tuple[str, FloatArray]] = [("", none)]
    if samples.throttle is not None:
        spread = (np.linspace(0.0, 1.0, count) for count in _SPEEDS if count > 1)
        scales += [("speed", np.quantile(speed, shares)) for shares in spread]
        if samples.gear is not None:
            gears = np.unique(np.round(samples.gear[moving]))
            scales += [("gear", gears)] if gears.size > 1 else []
    for count, (by, at) in product(_POSITIONS, scales):
        positions = [
            none if pedal is None else _positions(pedal[moving], count)
            for pedal in (samples.throttle, samples.brake)
        ]
        yield _Layout(positions[0], positions[1], by, at)


def _positions(pedal: FloatArray, count: int) -> FloatArray:
    """Return the released pedal and quantiles of the pressed one."""
    pressed = pedal[pedal > _LEAST_PEDAL * float(pedal.max(initial=0.0))]
    if not pressed.size:
        return np.zeros(1)
    quantiles = np.quantile(pressed, np.linspace(0.0, 1.0, count + 1)[1:])
    return np.unique(np.concatenate([[0.0], quantiles]))


def _rises(pedal: FloatArray, positions: FloatArray) -> FloatArray:
    """Return functions (n, k - 1) that rise from 0 to 1 between adjacent positions (k,)."""
    steps = np.diff(positions)
    return np.clip((pedal[:, None] - positions[None, :-1]) / steps, 0.0, 1.0)


def _shares(values: FloatArray, at: FloatArray, by: str) -> FloatArray:
    """Return the share (n, j) of each speed or gear (j,) in values (n,); 1 of the nearest gear."""
    if by == "gear":
        nearest = np.abs(values[:, None] - at[None, :]).argmin(axis=1)
        return np.asarray(np.eye(at.size)[nearest])
    return np.column_stack([np.interp(values, at, row) for row in np.eye(at.size)])


def _blocks(samples: PedalSamples, columns: FloatArray) -> _Blocks | None:
    """Return sums over blocks of `BLOCK_S`; None if they are too few for the columns."""
    # Smoothed over 0.5 s, signals are known from every fifth sample.
    columns, force, weights = (x[::_EVERY] for x in (columns, samples.force, samples.weights))
    edges = np.arange(0, force.size, max(1, round(BLOCK_S / (_EVERY * PERIOD_S))))
    weighted = columns * weights[:, None]
    counts = np.add.reduceat(weights, edges)
    used = counts > 0.0
    if used.sum() < columns.shape[1] + MIN_SPARE_BLOCKS:
        return None

    def summed(values: FloatArray) -> FloatArray:
        return np.asarray(np.add.reduceat(values, edges)[used])

    weighted_force = weights * force
    return _Blocks(
        summed(np.einsum("ni,nj->nij", weighted, columns)),
        summed(weighted * force[:, None]),
        summed(weighted_force * force),
        summed(weighted_force),
        counts[used],
    )


def _left_out_error(blocks: _Blocks) -> float:
    """Return the sum of squared errors of blocks, each by a fit without it."""
    part = np.arange(blocks.counts.size) % _FOLDS
    total = 0.0
    for fold in range(_FOLDS):
        left_out = (part == fold).astype(np.float64)
        total += blocks.error(blocks.solved(1.0 - left_out), left_out)
    return total


def _tables(layout: _Layout, values: FloatArray) -> tuple[ForceTable | None, ForceTable | None]:
    """Return the tables of throttle and brake from coefficients (c,)."""
    drive, stop = layout.sizes
    throttle = brake = None
    if layout.throttle.size:
        rises = values[:drive].reshape(max(layout.at.size, 1), -1)
        force = np.column_stack([np.zeros(len(rises)), np.cumsum(rises, axis=1)])
        at = layout.at if layout.at.size else None
        throttle = ForceTable(layout.throttle, force, layout.by, at)
    if layout.brake.size:
        force = np.concatenate([[0.0], -np.cumsum(values[drive : drive + stop])])
        brake = ForceTable(layout.brake, force[None, :])
    return throttle, brake
