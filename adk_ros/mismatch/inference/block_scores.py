# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Scores of a fit by blocks of time: standard deviations, and losses on blocks left out.

Whitening removes the correlation that the noise model knows. What remains (the surrogate's error
in a bend, an inexact equation) is correlated over seconds, so that the number of residuals
overstates the evidence. Within a block of `BLOCK_S` any correlation is allowed; only different
blocks count as independent.

With e_b the residuals of block b, J_b their derivatives, W Huber's weights, s_b = J_b^T W e_b, P
the prior's precision and N = sum_b J_b^T W J_b + P, the covariance of the fitted values is

    N^-1 (B / (B - 1) sum_b s_b s_b^T + P) N^-1,

the limit of a block bootstrap (R. G. Miller, "The jackknife: a review", Biometrika 61 (1974) 1;
K.-Y. Liang and S. L. Zeger, Biometrika 73 (1986) 13). Without block b, the fit moves by
(N - N_b)^-1 s_b in the linearised problem; the loss of block b there is that of held-out data.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from adk_ros.mismatch.inference.hypothesis import Hypothesis
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.surrogate.residuals import DISTANCE_INTERVAL_S
from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.numerics.levenberg_marquardt import (
    FitResult,
    bounded_step,
    huber_root,
    huber_values,
)
from adk_ros.numerics.similarity import time_scale

BLOCK_S = 5.0
"""s. Four times the memory of the whitening filters (1.2 s), about the duration of a bend."""
_MIN_BLOCK_S = 2.4
"""s. Twice that memory: least block of a scale model, whose bends are shorter."""
_DAMPING = 1e-6
"""Relative damping of that move: a variable that only block b informs about has no other value."""
_MIN_INFORMATION_SHARE = 0.01
"""A block with less than this share of the largest block's information on a parameter is idle."""


def block_duration(length_scale: float) -> float:
    """Return the duration of a block, s, of a vehicle at a scale of lengths."""
    return max(BLOCK_S * time_scale(length_scale), min(_MIN_BLOCK_S, BLOCK_S))


def block_of_rows(likelihood: Likelihood, count: int) -> IntArray:
    """Return the block (count,) of each of the `count` rows of `Likelihood.residuals`."""
    problem = likelihood.problem
    channels = np.tile(problem.bin_s - problem.start_s, 6)
    distances = DISTANCE_INTERVAL_S * np.arange(count - channels.shape[0])
    duration_s = block_duration(problem.log.length_scale)
    return np.asarray(np.concatenate([channels, distances]) // duration_s, dtype=np.int64)


@dataclass(frozen=True)
class BlockScores:
    """
    A fit's linearisation by block.

    `gradients` (b, n) s_b, `normals` (b, n, n) N_b, `losses` (b,) Huber losses, `normal` (n, n)
    with the prior, `prior` (n, n). `room` (2, n): how far each fitted value may change downwards
    and upwards when a block is left out.
    """

    gradients: FloatArray
    normals: FloatArray
    losses: FloatArray
    normal: FloatArray
    prior: FloatArray
    room: FloatArray

    @classmethod
    def of(cls, likelihood: Likelihood, h: Hypothesis) -> BlockScores:
        """Return the scores of a hypothesis by blocks, of those with data."""
        assert h.fit is not None
        scores = cls.of_fit(h.fit, block_of_rows(likelihood, h.fit.residuals.shape[0]))
        # A single block may determine an onset or the end of a segment: they stay.
        fixed = np.ones(h.fit.x.shape[0], dtype=bool)
        fixed[: h.nuisances.shape[0]] = False
        for part in effect_variables(h):
            fixed[part] = False
        return replace(scores, room=np.where(fixed, 0.0, scores.room))

    @classmethod
    def of_fit(cls, fit: FitResult, block: IntArray) -> BlockScores:
        """Return the scores of a fit; `block` (m,) of each residual. A zero is no residual."""
        root = huber_root(fit.residuals)
        columns = fit.jacobian * root[:, None]
        weighted = fit.residuals * root
        values = huber_values(fit.residuals)
        rows = [(block == i) & (fit.residuals != 0.0) for i in np.unique(block)]
        rows = [used for used in rows if used.any()]
        gradients = np.array([columns[used].T @ weighted[used] for used in rows])
        normals = np.array([columns[used].T @ columns[used] for used in rows])
        losses = np.array([values[used].sum() for used in rows])
        data = normals.sum(axis=0)
        prior = np.diag(np.maximum(np.diag(fit.normal) - np.diag(data), 0.0))
        room = np.array([fit.low - fit.x, fit.high - fit.x])
        return cls(gradients, normals, losses, data + prior, prior, room)

    def deviations(self) -> FloatArray:
        """
        Return the standard deviations (n,) of the fitted values.

        The larger of the white-noise and the block-robust one: few blocks underestimate.
        """
        scale, inverse = self._inverse(self.normal)
        white = np.sqrt(np.maximum(np.diag(inverse), 0.0)) / scale
        count = self.losses.size
        if count < 2:
            return np.asarray(white)
        scaled = self.gradients / scale
        spread = count / (count - 1.0) * scaled.T @ scaled + self.prior / np.outer(scale, scale)
        robust = np.sqrt(np.maximum(np.diag(inverse @ spread @ inverse), 0.0)) / scale
        return np.asarray(np.maximum(white, robust))

    def active_blocks(self, j: int) -> int:
        """Return the number of blocks with information on variable `j`."""
        information = self.normals[:, j, j]
        return int(np.count_nonzero(information > _MIN_INFORMATION_SHARE * information.max()))

    def left_out_losses(self) -> FloatArray:
        """
        Return the loss (b,) of each block under the fit to all other blocks, linearised.

        Within the bounds of the fit; onsets and ends of segments stay.
        """
        out = np.empty(self.losses.size)
        for i, (gradient, normal) in enumerate(zip(self.gradients, self.normals, strict=True)):
            change = bounded_step(self.normal - normal, -gradient, _DAMPING, *self.room)
            out[i] = self.losses[i] + 2.0 * gradient @ change + change @ normal @ change
        return out

    @staticmethod
    def _inverse(normal: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the scale (n,) of a normal matrix and the inverse (n, n) of the scaled one."""
        scale = np.sqrt(np.maximum(np.diag(normal), 1e-12))
        scaled = normal / np.outer(scale, scale)
        return scale, np.asarray(np.linalg.pinv(scaled, rcond=1e-10, hermitian=True))


def effect_deviations(likelihood: Likelihood, h: Hypothesis) -> list[list[float]]:
    """
    Return the standard deviations of each effect's fitted variables, in the order of `effects`.

    Where the fit did not include the activations, their variables have none.
    """
    assert h.fit is not None
    every = BlockScores.of(likelihood, h).deviations()
    return [[float(x) for x in every[part]] for part in effect_variables(h)]


def effect_variables(h: Hypothesis) -> list[slice]:
    """Return which fitted variables belong to each effect's parameters."""
    assert h.fit is not None
    first = h.nuisances.shape[0]
    with_activations = h.fit.x.shape[0] > first + sum(len(a.theta) for a in h.effects)
    out = []
    for active in h.effects:
        count = len(active.theta)
        out.append(slice(first, first + count))
        first += count + (len(active.activation.variables()) if with_activations else 0)
    return out
