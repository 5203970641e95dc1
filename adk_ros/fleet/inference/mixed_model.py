# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Hierarchical linear-Gaussian model of a fleet, in information form.

Recording r of car c has the joint vector (tolerances, offsets, weak directions, effects)

    t_c,   o_c + o_r,   w,   theta_r = sum_m z_mr beta_m + u_c + eta_r

with build tolerances t_c ~ N(0, I) and sensor offsets o_c of the car, offsets o_r ~ N(0, I) of the
recording (a sensor's bias changes between starts), weak directions w ~ N(0, I) of the simulation,
all in units of their prior standard deviations; u_c ~ N(0, kappa^2) is the deviation of a car and
eta_r ~ N(0, tau^2) that of a recording, each diagonal; beta are the sizes of the terms. The
evidence of a recording is quadratic, so everything is eliminated exactly: (o_r, eta_r) per
recording, (t_c, o_c, u_c) per car, then w. What is left is quadratic in beta; the constants give
the likelihood of (tau, kappa), restricted (REML) or not (D. A. Harville, "Maximum likelihood
approaches to variance component estimation", J. Am. Stat. Assoc. 72 (1977) 320).

The error of the surrogate repeats in every recording: a score b ~ N(0, B) per duration of the
simulation, from the blocks of the simulation itself (`FleetEvidence.bias`). It is carried along as
further right-hand sides and adds F B F^T to the covariance of beta, which does not shrink with the
number of recordings; contrasts between cars, conditions and times are nearly free of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from adk_ros.fleet.inference.fleet_evidence import FleetEvidence
from adk_ros.fleet.inference.restricted_likelihood import MIN_INFORMATION, Profile
from adk_ros.numerics.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class Term:
    """A column of the effects, by index, and its design (r,)."""

    effect: int
    design: FloatArray


@dataclass(frozen=True)
class Components:
    """Standard deviations (a,) of the active effects: between recordings and between cars."""

    tau: FloatArray
    kappa: FloatArray


@dataclass(frozen=True)
class Estimate:
    """
    Sizes of the terms (m,) at given variance components.

    `covariance` (m, m) without, `bias` (m, m) by the surrogate's error; `information` (m, m) and
    `score` (m,) of the sizes with all else eliminated; `restricted` and `likelihood`: logarithm of
    REML and of the maximum likelihood. `response` (m, d): sizes per score of the simulation.
    """

    sizes: FloatArray
    covariance: FloatArray
    bias: FloatArray
    information: FloatArray
    score: FloatArray
    restricted: float
    likelihood: float
    response: FloatArray
    car_deviations: FloatArray
    """(c, a) posterior mean of u_c."""
    car_variances: FloatArray
    """(c, a) posterior variance of u_c at known sizes."""


class MixedModel:
    """
    The model of a fleet with some active effects; `active` (a,): their columns of effects.

    `free` (r, a): active effects that have any size in a recording, which then says nothing on the
    terms; with a flat prior, at the maximum of the likelihood.
    """

    def __init__(
        self, fleet: FleetEvidence, active: Sequence[int], free: BoolArray | None = None
    ) -> None:
        self.fleet = fleet
        self.active = tuple(active)
        c = fleet.columns
        self._tolerances = c.tolerances.stop
        self._offsets = c.offsets.stop - c.offsets.start
        self._weak = c.weak
        first = c.first_effect
        # Order: tolerances, offsets, effects (all that vary between cars), weak directions.
        self.index: IntArray = np.concatenate(
            [
                np.arange(c.offsets.stop),
                [first + i for i in active],
                np.arange(c.weak_directions.start, c.weak_directions.stop),
            ]
        ).astype(np.int64)
        self._information = fleet.informations[:, self.index[:, None], self.index]
        self._score = fleet.scores[:, self.index]
        self.free = np.zeros((len(fleet.names), len(self.active)), bool) if free is None else free
        self._response = np.zeros(self._information.shape) + np.eye(self.index.size)
        self._gain_of_free = self._eliminate_free()
        self._one_sided = [c.column(c.effects[i]).is_one_sided for i in active]
        names = fleet.car_names
        self._member = np.array([[car == name for car in fleet.cars] for name in names], float)

    def _eliminate_free(self) -> float:
        """Eliminate free effects from the recordings; return what the log-likelihood gains."""
        gain = 0.0
        for r in np.flatnonzero(self.free.any(axis=1)):
            at = self._of_effects.start + np.flatnonzero(self.free[r])
            h, s = self._information[r].copy(), self._score[r].copy()
            inner = h[np.ix_(at, at)] + MIN_INFORMATION * np.eye(at.size)
            solved = np.linalg.solve(inner, np.column_stack([h[at], s[at]]))
            gain += 0.5 * float(s[at] @ solved[:, -1])
            self._response[r][:, at] -= h[:, at] @ np.linalg.inv(inner)
            self._information[r] = h - h[:, at] @ solved[:, :-1]
            self._score[r] = s - h[:, at] @ solved[:, -1]
            self._information[r][at] = self._information[r][:, at] = 0.0
            self._score[r][at] = self._response[r][at] = 0.0
        return gain

    def estimate(
        self, terms: Sequence[Term], components: Components, with_bias: bool = False
    ) -> Estimate:
        """Return the sizes of the terms; `with_bias`: and what the surrogate's error does."""
        fleet, a, n = self.fleet, len(self.active), self.index.size
        information, scores, scale = self._extended(terms)
        rights = scores[:, :, None]
        if with_bias:
            both = [self._response, self._response[:, self._of_effects]]
            errors = np.concatenate(both, axis=1)[:, : scale.shape[1]]
            errors *= fleet.shares[:, None, None] * scale[:, :, None]
            rights = np.concatenate([rights, errors], axis=2)
        per_recording = np.concatenate([np.ones(self._offsets), components.tau])
        first = slice(self._tolerances, self._tolerances + self._offsets + a)
        h, g, constant = _eliminated(information, rights, first, per_recording)
        total = self._gain_of_free + float(constant.sum())

        # Per car: its own variables, the weak directions, the sizes of the terms.
        members = self._member
        at, z = self._positions(terms, scale.shape[1])
        m = len(terms)
        columns = h[:, :, at] * z[:, None, :]
        size = n + m
        car_h = self._summed(h[:, :n, :n], columns[:, :n], columns[:, at, :] * z[:, :, None])
        car_g = np.empty((members.shape[0], size, rights.shape[2]))
        car_g[:, :n] = np.tensordot(members, g[:, :n], 1)
        car_g[:, n:] = np.tensordot(members, g[:, at] * z[:, :, None], 1)
        per_car = np.concatenate([np.ones(self._tolerances + self._offsets), components.kappa])
        of_car = slice(0, per_car.size)
        rest_h, rest_g, constant = _eliminated(car_h, car_g, of_car, per_car)
        total += float(constant.sum())

        rest = slice(per_car.size, size)
        h_sum = rest_h[:, rest, rest].sum(axis=0)[None]
        g_sum = rest_g[:, rest].sum(axis=0)[None]
        final_h, final_g, constant = _eliminated(
            h_sum, g_sum, slice(0, self._weak), np.ones(self._weak)
        )
        total += float(constant.sum())
        information = final_h[0, self._weak :, self._weak :] + MIN_INFORMATION * np.eye(m)
        right = final_g[0, self._weak :]
        covariance = np.linalg.inv(information)
        sizes = covariance @ right
        gain = 0.5 * float(right[:, 0] @ sizes[:, 0])
        log_determinant = float(np.linalg.slogdet(information)[1])
        response = np.zeros((m, fleet.columns.size))
        if with_bias:
            response[:, self.index] = sizes[:, 1:]
        deviations, variances = self._cars(
            car_h, car_g[:, :, 0], per_car, sizes[:, 0], h_sum[0], g_sum[0, :, 0]
        )
        return Estimate(
            sizes[:, 0],
            np.asarray(covariance),
            response @ fleet.bias @ response.T,
            information,
            right[:, 0],
            total + gain - 0.5 * log_determinant,
            total + gain,
            response,
            deviations,
            variances,
        )

    def profile(
        self, terms: Sequence[Term], components: Components, i: int, of_term: bool = False
    ) -> Profile:
        """
        Return the likelihood as a function of the components of active effect `i` alone.

        `of_term`: with the effect as in a further term, which acts in every recording, instead of
        its deviations (`further_terms`).
        """
        tau = components.tau.copy()
        tau[i] = 0.0
        per_recording = np.concatenate([np.ones(self._offsets), tau])
        first = slice(self._tolerances, self._tolerances + per_recording.size)
        information, scores, scale = self._extended(terms)
        h, g, constant = _eliminated(information, scores[:, :, None], first, per_recording)
        n = self.index.size
        at, z = self._positions(terms, scale.shape[1])
        position = j = self._tolerances + self._offsets + i
        if of_term and scale.shape[1] > n:
            j = n + i
        columns = h[:, :, at] * z[:, None, :]
        row = np.concatenate([h[:, j, :n], h[:, j, at] * z], axis=1)
        car_h = self._summed(h[:, :n, :n], columns[:, :n], columns[:, at, :] * z[:, :, None])
        right = np.concatenate([g[:, :n, 0], g[:, at, 0] * z], axis=1)
        per_car = np.concatenate([np.ones(self._tolerances + self._offsets), components.kappa])
        return Profile(
            car_h,
            self._member @ right,
            row,
            h[:, j, j],
            np.ascontiguousarray(g[:, j, 0]),
            np.argmax(self._member, axis=0),
            per_car,
            position,
            self._weak,
            self._gain_of_free + float(constant.sum()),
        )

    @property
    def _of_effects(self) -> slice:
        """Positions of the active effects."""
        first = self._tolerances + self._offsets
        return slice(first, first + len(self.active))

    def _extended(self, terms: Sequence[Term]) -> tuple[FloatArray, FloatArray, FloatArray]:
        """
        Return information (r, n', n'), score (r, n') and factor (r, n') on each variable.

        Where a deviation does not act in every recording, n' = n + a: the effects follow once
        more, for the terms, which act everywhere.
        """
        acting = self.acting(terms)
        if acting.all():
            return self._information, self._score, np.ones_like(self._score)
        scale = np.ones((len(self.fleet.names), self.index.size + len(self.active)))
        scale[:, self._of_effects] = acting
        variables = np.arange(self.index.size)
        at = np.concatenate([variables, variables[self._of_effects]])
        information = self._information[:, at[:, None], at]
        information *= scale[:, :, None] * scale[:, None, :]
        return information, self._score[:, at] * scale, scale

    def acting(self, terms: Sequence[Term]) -> FloatArray:
        """
        Return in which recordings (r, a) cars and recordings deviate in each active effect.

        Without a delay there is none that could differ: an effect that acts in one direction only
        deviates where a term of several cars acts, if there is one. Linearised far from their
        effects, recordings deviate everywhere: a large delay is not linear.
        """
        out = np.ones((len(self.fleet.names), len(self.active)))
        for i, effect in enumerate(self.active):
            if not (self._one_sided[i] and self.fleet.is_at_estimate):
                continue
            designs = [t.design for t in terms if t.effect == effect]
            shared = [z for z in designs if np.count_nonzero(self._member @ (z != 0.0)) > 1]
            if shared:
                out[:, i] = np.any(np.array(shared) != 0.0, axis=0)
        return out

    def _positions(self, terms: Sequence[Term], size: int) -> tuple[IntArray, FloatArray]:
        """
        Return the positions (m,) of the terms' effects, and their designs (r, m).

        `size`: number of variables; beyond those of the index, effects follow once more.
        """
        first = self._tolerances + self._offsets if size == self.index.size else self.index.size
        at = np.array([first + self.active.index(t.effect) for t in terms], dtype=np.int64)
        return at, np.array([t.design for t in terms]).reshape(len(terms), len(self.fleet.names)).T

    def _summed(self, h: FloatArray, columns: FloatArray, between: FloatArray) -> FloatArray:
        """Return the information (c, n + m, n + m) of each car, with the sizes of the terms."""
        n, size = self.index.size, self.index.size + between.shape[1]
        out = np.empty((self._member.shape[0], size, size))
        out[:, :n, :n] = np.tensordot(self._member, h, 1)
        out[:, :n, n:] = np.tensordot(self._member, columns, 1)
        out[:, n:, :n] = np.swapaxes(out[:, :n, n:], 1, 2)
        out[:, n:, n:] = np.tensordot(self._member, between, 1)
        return out

    def _cars(
        self,
        car_h: FloatArray,
        car_g: FloatArray,
        per_car: FloatArray,
        sizes: FloatArray,
        h_sum: FloatArray,
        g_sum: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """Return posterior mean and variance (c, a) of the cars' deviations."""
        k, w, a = per_car.size, self._weak, len(self.active)
        # The weak directions at the estimate, then each car's variables given all others.
        weak = np.linalg.solve(h_sum[:w, :w] + np.eye(w), g_sum[:w] - h_sum[:w, w:] @ sizes)
        known = np.concatenate([weak, sizes])
        right = car_g[:, :k] - car_h[:, :k, k:] @ known
        inner = np.eye(k) + per_car[:, None] * car_h[:, :k, :k] * per_car
        inverse = np.linalg.inv(inner)
        mean = per_car * np.einsum("cij,cj->ci", inverse, per_car * right)
        variance = per_car**2 * np.diagonal(inverse, axis1=1, axis2=2)
        return mean[:, k - a :], variance[:, k - a :]


def _eliminated(
    information: FloatArray, rights: FloatArray, part: slice, deviation: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """
    Integrate over the variables `part` with prior N(0, deviation^2), for each of b problems.

    `information` (b, n, n), `rights` (b, n, q); returns both with the part's influence, the same
    shapes, and the constants (b,) of the log-likelihood for the first right-hand side. A deviation
    of zero is allowed. Afterwards the rows of the part itself refer to the mean of its variables,
    about which their deviation was integrated.
    """
    count = deviation.size
    if not count:
        return information, rights, np.zeros(information.shape[0])
    scaled = deviation[:, None] * information[:, part, :]
    inner = scaled[:, :, part] * deviation + np.eye(count)
    root = np.linalg.cholesky(inner)
    pair = np.concatenate([scaled, deviation[:, None] * rights[:, part, :]], axis=2)
    solved = np.linalg.solve(root, pair) if root.shape[0] > 1 else solve_triangular(
        root[0], pair[0], lower=True
    )[None]  # fmt: skip
    n = information.shape[2]
    w, q = solved[:, :, :n], solved[:, :, n:]
    across = np.swapaxes(w, 1, 2)
    constant = 0.5 * (q[:, :, 0] ** 2).sum(axis=1)
    constant -= np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1)
    return information - across @ w, rights - across @ q, constant
