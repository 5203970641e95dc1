# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Episodes of residuals beyond the Huber threshold, alone or as a mean.

A white Gaussian residual, or the mean of some (`lasting_residuals`), exceeds eight standard
deviations with a probability of 1e-15, so that in a recording of any length none is expected. What
exceeds them is a disturbance that acts rarely, a fault of a sensor, or what the surrogate already
gets wrong about the simulation. The last is counted there (`downweighted_episodes`).

The error of the surrogate's time step raises the threshold on the recording and on the simulation
(`surrogate.timing_error`).
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from adk_ros.mismatch.inference.decision import Decision
from adk_ros.mismatch.inference.downweighted_episodes import Downweighted, Episode
from adk_ros.mismatch.inference.feature_effect import EQUATION_TEXTS, FeatureEffect
from adk_ros.mismatch.inference.hypothesis import Hypothesis
from adk_ros.mismatch.inference.lasting_residuals import (
    WINDOWS,
    largest_mean,
    lasting_residuals,
)
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.result import NONE, UNKNOWN, UnexplainedResidual
from adk_ros.mismatch.library.criteria import EQUATION_GAIN_SHARE
from adk_ros.mismatch.library.parametric_features import is_transferable
from adk_ros.mismatch.recording.sensor_log import CHANNELS
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.mismatch.surrogate.joined_problem import JoinedProblem
from adk_ros.mismatch.surrogate.lap import Lap
from adk_ros.mismatch.surrogate.residuals import BIN_S
from adk_ros.mismatch.surrogate.state_index import IMU_A_X
from adk_ros.mismatch.surrogate.timing_error import timing_error
from adk_ros.numerics.arrays import BoolArray, FloatArray
from adk_ros.numerics.filters import causal_filter
from adk_ros.numerics.levenberg_marquardt import HUBER_THRESHOLD, huber_values

EQUATIONS = ("v_x", "v_y", "yaw_rate", "v_x", "v_y", "yaw_rate")
"""Equation of motion of each channel."""
LONGEST_S = max(WINDOWS) * BIN_S
"""Duration of the longest mean, s."""
_JOINED_S = 1.0
"""s. Residuals closer than this are one episode: the observer's slowest time constant is 0.5 s."""


def downweighted_residuals(
    likelihood: Likelihood, hypothesis: Hypothesis, surrogate: SurrogateModel, lap: Lap | None
) -> Downweighted | None:
    """Return the episodes of a hypothesis beyond the threshold, or None if there are none."""
    residuals = _residuals(likelihood, hypothesis)
    e = likelihood.whiten(residuals)
    above = _above_known(likelihood, hypothesis, e)
    beyond = _exceed(above) & (likelihood.weights > 0.0)
    if not beyond.any():
        return None
    # Above what noise causes, as a share of all squares and of those above noise.
    squares = huber_values(e)
    above_noise = np.where(beyond, squares - 1.0, 0.0)
    excess = above_noise.sum(axis=1)
    unexplained = float(squares.sum()) - np.count_nonzero(likelihood.weights)
    by_equation = dict.fromkeys(EQUATIONS, 0.0)
    for name, part in zip(EQUATIONS, excess, strict=True):
        by_equation[name] += float(part)
    order = sorted(by_equation, key=lambda name: -by_equation[name])
    least = EQUATION_GAIN_SHARE * by_equation[order[0]]
    simulated, simulated_s = _seconds_on_simulation(likelihood, surrogate)
    counted_s = BIN_S * int((likelihood.weights > 0.0).any(axis=0).sum())
    shares = above_noise.sum(axis=0) / squares.sum()
    return Downweighted(
        tuple(
            _episode(likelihood, residuals, above, bins, lap, float(shares[bins].sum()))
            for bins in _groups(beyond)
        ),
        _seconds(beyond),
        simulated,
        counted_s / simulated_s,
        len(problem.parts) if isinstance(problem := likelihood.problem, JoinedProblem) else 1,
        float(excess.sum() / squares.sum()),
        tuple(name for name in order if by_equation[name] > least),
        counted_s,
        float(excess.sum() / max(unexplained, excess.sum())),
    )


def episodes_describe_more(
    likelihood: Likelihood,
    h: Hypothesis,
    null: Hypothesis,
    surrogate: SurrogateModel,
    lap: Lap | None,
    *,
    of_time_only: bool = True,
) -> bool:
    """
    Whether episodes account for more than a formula of this recording's time and phase.

    A few short episodes have a spectrum, to which an oscillation in time can always be fitted. The
    squared residuals that the formula `h` removes from those of `null` are compared with those
    that it leaves in episodes, above those of noise. A formula that another recording can test is
    left to the held-out errors, unless `of_time_only` is false.
    """
    of_time = [
        isinstance(a.effect, FeatureEffect) and not is_transferable(a.effect.feature)
        for a in h.effects
    ]
    if not of_time or (of_time_only and not all(of_time)):
        return False
    hidden = downweighted_residuals(likelihood, h, surrogate, lap)
    if hidden is None or hidden.is_rule or not hidden.is_material:
        return False
    before, left_over = (likelihood.whiten(_residuals(likelihood, x)) for x in (null, h))
    beyond = _exceed(_above_known(likelihood, h, left_over)) & (likelihood.weights > 0.0)
    episodes = _groups(beyond)
    before, after = before**2, left_over**2
    left = sum(float(after[:, x].sum()) - np.count_nonzero(after[:, x]) for x in episodes)
    return bool(before.sum() - after.sum() < left)


def _residuals(likelihood: Likelihood, h: Hypothesis) -> FloatArray:
    """Return the residuals (6, b) of a hypothesis, SI."""
    p, terms = likelihood.simulation_inputs(h.nuisances, h.effects)
    return likelihood.channel_residuals(p, terms)


def _above_known(likelihood: Likelihood, h: Hypothesis, e: FloatArray) -> FloatArray:
    """Return whitened residuals `e` (6, b) less the known error of the time step."""
    if not _exceed(e)[IMU_A_X].any():
        return e
    problem = likelihood.problem
    p, terms = likelihood.simulation_inputs(h.nuisances, h.effects)
    error = timing_error(problem, p, terms, problem.run(p, terms))
    return _reduced(e, error * likelihood.weights * likelihood.filters[:, :1])


def _reduced(e: FloatArray, error: FloatArray) -> FloatArray:
    """Return residuals (6, b) without what an error of this size may cause."""
    return np.asarray(np.sign(e) * np.maximum(np.abs(e) - error, 0.0))


def _exceed(e: FloatArray) -> BoolArray:
    """Return which residuals (6, b) exceed the threshold, alone or as a mean."""
    return np.asarray((np.abs(e) > HUBER_THRESHOLD) | lasting_residuals(e))


def _groups(beyond: BoolArray) -> list[slice]:
    """Return the bins of each episode."""
    at = np.flatnonzero(beyond.any(axis=0))
    if not at.size:
        return []
    cuts = np.flatnonzero(np.diff(at) > _JOINED_S / BIN_S) + 1
    return [slice(int(part[0]), int(part[-1]) + 1) for part in np.split(at, cuts)]


def _episode(
    likelihood: Likelihood,
    residuals: FloatArray,
    e: FloatArray,
    bins: slice,
    lap: Lap | None,
    share: float,
) -> Episode:
    """
    Return an episode with its largest residual; of weak ones, the mean of a channel.

    `share`: of the loss, see `Episode`.
    """
    problem = likelihood.problem
    sizes = np.abs(e[:, bins])
    channel, offset = map(int, np.unravel_index(int(np.argmax(sizes)), sizes.shape))
    at, sigmas = bins.start + offset, float(sizes[channel, offset])
    size = float(residuals[channel, at])
    if sigmas < HUBER_THRESHOLD:
        mean = largest_mean(e[:, bins])
        channel, sigmas = mean.channel, mean.sigmas
        counted = likelihood.weights[channel, bins][mean.bins] > 0.0
        size = float(residuals[channel, bins][mean.bins][counted].mean())
        at = bins.start + (mean.bins.start + mean.bins.stop) // 2
    step = min(round((problem.bin_s[at] - problem.start_s) / (BIN_S / 4.0)), problem.steps - 1)
    return Episode(
        float(problem.bin_s[bins.start] - 0.5 * BIN_S),
        float(problem.bin_s[bins.stop - 1] + 0.5 * BIN_S),
        CHANNELS[channel],
        size,
        sigmas,
        float(problem.pose[step, 0]),
        float(problem.pose[step, 1]),
        None if lap is None or math.isnan(lap.distance[step]) else float(lap.distance[step]),
        share,
    )


def _seconds(beyond: BoolArray) -> int:
    """Return the seconds in episodes, each of at least one."""
    return sum(math.ceil((x.stop - x.start) * BIN_S) for x in _groups(beyond))


def _seconds_on_simulation(likelihood: Likelihood, surrogate: SurrogateModel) -> tuple[int, float]:
    """
    Return the seconds in which the surrogate is as wrong about the simulation, of how many.

    Of a surrogate from a file, whose residuals are not known: none of infinitely many.
    """
    if surrogate.residuals.shape[1] == 0 or not np.any(surrogate.error > 0.0):
        return 0, np.inf
    noise = likelihood.problem.bin_noise[:, None]
    scaled = surrogate.unexplained_residuals / noise
    bins = int(scaled.shape[1])
    whitened = [
        causal_filter(row, coefficients)
        for row, coefficients in zip(scaled, likelihood.filters, strict=True)
    ]
    used: BoolArray = np.asarray((likelihood.weights > 0.0).any(axis=1))
    error = surrogate.timing_error / noise * likelihood.filters[:, :1]
    beyond = _exceed(_reduced(np.array(whitened), error)) & used[:, None]
    return _seconds(beyond), max(BIN_S * float(bins), 1.0)


def with_episodes(
    decision: Decision, hidden: Downweighted | None, *, keep_text: bool = False
) -> Decision:
    """
    Return a decision that does not pass over material episodes.

    `none` becomes `unknown`; an unexplained residual without terms is described by them.
    `keep_text`: what is said of it stays, such as the held-out error and why nothing is claimed.
    """
    unexplained = decision.unexplained
    described = unexplained is not None and bool(unexplained.terms)
    if hidden is None or not hidden.is_material or described:
        return decision
    if decision.verdict not in {NONE, UNKNOWN}:
        return decision
    share = hidden.share_of_excess if unexplained is None else unexplained.share
    texts = [f"{EQUATION_TEXTS[x]} against time: {hidden.text()}" for x in hidden.equations]
    if unexplained is not None and keep_text:
        texts.append(unexplained.text)
    episodes = UnexplainedResidual(
        list(hidden.equations),
        round(share, 3),
        "; ".join(texts),
        "",
    )
    return replace(decision, verdict=UNKNOWN, unexplained=episodes)


def note_on(hidden: Downweighted | None) -> list[str]:
    """Return a note on the residuals beyond eight standard deviations, if there are any."""
    if hidden is None:
        return []
    sigmas = f"{HUBER_THRESHOLD:g} standard deviations"
    what = f"residuals, or means of up to {LONGEST_S:g} s, exceed {sigmas}"
    if hidden.is_rule:
        return [
            f"{what} in {100.0 * hidden.share_of_time:.0f} % of the seconds: the simulation is "
            "far from the recording, and what is fitted follows the smaller residuals"
        ]
    largest = max(hidden.episodes, key=lambda x: x.sigmas)
    place = "" if largest.lap_m is None else f", {largest.lap_m:.0f} m along the lap"
    return [
        f"{what} in {hidden.text()}{place} ({largest.channel} {largest.size:+.2g}); noise causes "
        "none"
    ]
