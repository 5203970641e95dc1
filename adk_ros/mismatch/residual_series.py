# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Time series of the residuals before and after the correction, for the report."""

from __future__ import annotations

import numpy as np

from adk_ros.mismatch.inference.hypothesis import Hypothesis
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.result import ResidualSeries
from adk_ros.mismatch.surrogate.feature_terms import feature_signals
from adk_ros.mismatch.surrogate.joined_problem import JoinedProblem
from adk_ros.mismatch.surrogate.lap import Lap
from adk_ros.mismatch.surrogate.residuals import ResidualProblem
from adk_ros.numerics.arrays import FloatArray


def residual_series(likelihood: Likelihood, h: Hypothesis, lap: Lap | None) -> ResidualSeries:
    """Return the time series of a recording under a hypothesis, in bins, for the report."""
    problem = likelihood.problem
    counted = likelihood.weights > 0.0
    p, terms = likelihood.simulation_inputs(h.nuisances, h.effects)
    out = problem.run(p, terms)
    signals = {name: problem.binned(x) for name, x in feature_signals(problem, out).items()}
    x, y = (problem.binned(problem.pose[:, i]) for i in range(2))
    if isinstance(problem, JoinedProblem):
        # No line connects the end of one recording with the start of the next.
        for values in (x, y):
            values[[bins.start for bins in problem.bin_slices[1:]]] = np.nan
    without = {}
    for i, active in enumerate(h.effects if len(h.effects) > 1 else ()):
        others = [*h.effects[:i], *h.effects[i + 1 :]]
        inputs = likelihood.simulation_inputs(h.nuisances, others)
        without[active.effect.name] = counted * likelihood.channel_residuals(*inputs)
    return ResidualSeries(
        time_s=problem.bin_s,
        x=x,
        y=y,
        signals=signals,
        before=counted
        * likelihood.channel_residuals(likelihood.parameters, likelihood.fixed_terms),
        after=counted * (problem.residuals(p, terms, out=out) - likelihood.systematic_error),
        noise=problem.bin_noise,
        distance=_distance(problem, lap),
        without=without,
    )


def _distance(problem: ResidualProblem, lap: Lap | None) -> FloatArray | None:
    """Return the distance along the lap in each bin; None without a lap, or with several."""
    if lap is None or len(lap.routes) > 1:
        return None
    return np.asarray(problem.binned(lap.unwrapped) % lap.length)
