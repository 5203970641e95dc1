# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Generalised likelihood ratio of a change, from sums over blocks.

With e_b the residuals of block b, X_b the static columns (nuisance parameters and all effects,
with prior precision L), D_b the columns of one effect, and an onset at the begin of block t, the
gain of the change is that of the linear least-squares problem

    sum_b |e_b + X_b x|^2 + sum_(b >= t) (|e_b + X_b x + D_b d|^2 - |e_b + X_b x|^2) + x'L x

in d: the car may differ from the model in anything, as long as it did so from the beginning (A. S.
Willsky, H. L. Jones, IEEE Trans. Automatic Control 21 (1976) 108; M. Basseville, I. V. Nikiforov,
"Detection of Abrupt Changes", 1993, ch. 7). Only the products of columns are kept: those of each
of the latest blocks, and one sum over all older ones, which fades.

What the surrogate gets wrong is correlated over seconds, so that a gain has more spread than a
chi-square. The spread of each column's score is measured on the blocks of the reference, each
predicted from those before (as `inference.block_scores`), and the gain divided by it.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from adk_ros.mismatch.library.criteria import PENALTY_PER_PARAMETER
from adk_ros.mismatch.watch.block import Block, robust_weights
from adk_ros.mismatch.watch.candidate_columns import CandidateChange, ColumnLayout, unit_of
from adk_ros.mismatch.watch.settings import (
    MIN_BLOCKS_AFTER,
    REFERENCE_BLOCKS,
    REFERENCE_MEMORY_BLOCKS,
    RING_BLOCKS,
    SPREAD_PRIOR_BLOCKS,
)
from adk_ros.numerics.arrays import FloatArray

_MIN_INFORMATION = 1e-6


@dataclass(frozen=True)
class LinearChange:
    """
    A candidate at its best onset.

    `statistic`: gain over its spread, penalised for further parameters; `size` (k,) in
    materiality thresholds.
    """

    candidate: CandidateChange
    onset_block: int
    gain: float
    statistic: float
    size: FloatArray

    @property
    def is_material(self) -> bool:
        """Whether a parameter reaches its materiality threshold."""
        return bool(np.abs(self.size).max() >= 1.0)

    def theta(self) -> tuple[float, ...]:
        """Return the fitted variables to start a fit from."""
        c = self.candidate
        theta = [
            float(np.clip(p.theta_neutral + x * unit_of(p), *p.bounds()))
            for p, x in zip(c.effect.parameters, self.size, strict=True)
        ]
        if c.one_sided:
            theta[0] = c.start[0]
        return tuple(theta)


@dataclass(frozen=True)
class WeighedBlock:
    """A block, its robust weights (m,), the products of its columns, and its scores (c,)."""

    block: Block
    weights: FloatArray
    gram: FloatArray
    scores: FloatArray
    variances: FloatArray


class ChangeStatistics:
    """Sums over the blocks of a drive, and the gain of every change."""

    def __init__(self, layout: ColumnLayout) -> None:
        self.layout = layout
        size = 1 + layout.count
        self.blocks: deque[WeighedBlock] = deque()
        self.old = np.zeros((size, size))
        self.count = 0
        self._static = 1 + layout.static
        self._coefficients = np.zeros(layout.static.size)
        self._spread = np.ones(layout.count) * SPREAD_PRIOR_BLOCKS
        self._spread_weight = SPREAD_PRIOR_BLOCKS
        self._single = [x for x in layout.candidates if x.columns.size == 1]
        self._several = [x for x in layout.candidates if x.columns.size > 1]
        self._single_columns = np.array([x.columns[0] for x in self._single])
        self._one_sided = np.array([x.one_sided for x in self._single])

    def add(self, block: Block) -> None:
        """Add the next block."""
        static = self.layout.static
        predicted = block.residuals + block.columns[:, static] @ self._coefficients
        weights = robust_weights(predicted)
        gram = block.gram(weights)
        across = gram[np.ix_(self._static, np.arange(1, gram.shape[0]))]
        scores = gram[0, 1:] + self._coefficients @ across
        inverse = self.inverse(self.total())
        variances = np.diag(gram)[1:] + np.einsum("ij,ij->j", across, inverse @ across)
        self.blocks.append(WeighedBlock(block, weights, gram, scores, variances))
        self.count += 1
        if len(self.blocks) > RING_BLOCKS:
            self._forget(self.blocks.popleft())
        self._coefficients = self.coefficients(self.total())

    def _forget(self, item: WeighedBlock) -> None:
        keep = 1.0 - 1.0 / REFERENCE_MEMORY_BLOCKS
        self.old = keep * self.old + item.gram
        ratio = item.scores**2 / np.maximum(item.variances, _MIN_INFORMATION)
        self._spread = keep * self._spread + ratio
        self._spread_weight = keep * self._spread_weight + 1.0

    def total(self) -> FloatArray:
        """Return the products (1 + c, 1 + c) over all blocks."""
        return np.asarray(self.old + sum((item.gram for item in self.blocks), np.zeros(1)))

    def inverse(self, total: FloatArray) -> FloatArray:
        """Return the inverse (s, s) of the static columns' normal matrix, with its prior."""
        normal = total[np.ix_(self._static, self._static)] + np.diag(self.layout.precision)
        scale = np.sqrt(np.diag(normal))
        return np.asarray(np.linalg.inv(normal / np.outer(scale, scale)) / np.outer(scale, scale))

    def coefficients(self, total: FloatArray) -> FloatArray:
        """Return the static coefficients (s,) that fit all blocks."""
        return np.asarray(-self.inverse(total) @ total[self._static, 0])

    def spread(self, before: int) -> FloatArray:
        """Return the spread (c,) of the scores over the blocks of the ring before an index."""
        items = list(self.blocks)[:before]
        ratio = [item.scores**2 / np.maximum(item.variances, _MIN_INFORMATION) for item in items]
        total = self._spread + np.sum(ratio, axis=0) if ratio else self._spread
        return np.maximum(total / (self._spread_weight + len(items)), 1.0)

    @property
    def is_ready(self) -> bool:
        """Whether the reference is long enough for a decision."""
        return self.count >= REFERENCE_BLOCKS + MIN_BLOCKS_AFTER

    def changes(self) -> list[LinearChange]:
        """Return each candidate at its best onset, largest statistic first."""
        best: dict[int, LinearChange] = {}
        for change in self.all_changes():
            key = id(change.candidate)
            if key not in best or change.statistic > best[key].statistic:
                best[key] = change
        return sorted(best.values(), key=lambda x: -x.statistic)

    def all_changes(self) -> list[LinearChange]:
        """Return each candidate at each onset."""
        out: list[LinearChange] = []
        if not self.is_ready:
            return out
        total = self.total()
        inverse = self.inverse(total)
        coefficients = -inverse @ total[self._static, 0]
        tail = np.zeros_like(total)
        older = self.count - len(self.blocks)
        for index in range(len(self.blocks) - 1, 0, -1):
            tail += self.blocks[index].gram
            if len(self.blocks) - index < MIN_BLOCKS_AFTER:
                continue
            if older + index < REFERENCE_BLOCKS:
                break
            across = tail[self._static, 1:]
            scores = tail[0, 1:] + coefficients @ across
            normal = tail[1:, 1:] - across.T @ inverse @ across
            spread = self.spread(index)
            out += self._at_onset(index, scores, normal, spread)
        return out

    def _at_onset(
        self, index: int, scores: FloatArray, normal: FloatArray, spread: FloatArray
    ) -> list[LinearChange]:
        """Return each candidate with one onset; those of one column together."""
        c = self._single_columns
        information = np.maximum(np.diag(normal)[c], _MIN_INFORMATION)
        size = -scores[c] / information
        gain = np.where(self._one_sided & (size <= 0.0), 0.0, scores[c] ** 2 / information)
        statistic = gain / spread[c]
        out = [
            LinearChange(candidate, index, float(gain[i]), float(statistic[i]), size[i : i + 1])
            for i, candidate in enumerate(self._single)
        ]
        return out + [_joint(x, index, scores, normal, spread) for x in self._several]


def _joint(
    candidate: CandidateChange,
    index: int,
    scores: FloatArray,
    normal: FloatArray,
    spread: FloatArray,
) -> LinearChange:
    """Return a candidate of several columns with one onset."""
    c = candidate.columns
    own = normal[np.ix_(c, c)]
    scale = np.sqrt(np.maximum(np.diag(own), _MIN_INFORMATION))
    inverse = np.linalg.pinv(own / np.outer(scale, scale), rcond=1e-6, hermitian=True)
    right = -scores[c] / scale
    solved = inverse @ right
    gain = float(right @ solved)
    size = solved / scale
    if candidate.one_sided and size[0] <= 0.0:
        gain = 0.0
    statistic = gain / float(spread[c].max()) - PENALTY_PER_PARAMETER * (c.size - 1)
    return LinearChange(candidate, index, gain, statistic, size)
