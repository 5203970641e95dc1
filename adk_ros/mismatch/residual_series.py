# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Time series of the residuals before and after the correction, for the report."""

from __future__ import annotations

from adk_ros.mismatch.inference.likelihood import Hypothesis, Likelihood
from adk_ros.mismatch.inference.result import ResidualSeries
from adk_ros.mismatch.surrogate.feature_terms import feature_signals
from adk_ros.mismatch.surrogate.lap import Lap


def residual_series(likelihood: Likelihood, h: Hypothesis, lap: Lap | None) -> ResidualSeries:
    """Return the time series of a recording under a hypothesis, in bins, for the report."""
    problem = likelihood.problem
    counted = likelihood.weights > 0.0
    p, terms = likelihood.simulation_inputs(h.nuisances, h.effects)
    out = problem.run(p, terms)
    signals = {name: problem.binned(x) for name, x in feature_signals(problem, out).items()}
    without = {}
    for i, active in enumerate(h.effects if len(h.effects) > 1 else ()):
        others = [*h.effects[:i], *h.effects[i + 1 :]]
        inputs = likelihood.simulation_inputs(h.nuisances, others)
        without[active.effect.name] = counted * problem.residuals(*inputs)
    return ResidualSeries(
        time_s=problem.bin_s,
        x=problem.binned(problem.pose[:, 0]),
        y=problem.binned(problem.pose[:, 1]),
        signals=signals,
        before=counted * problem.residuals(likelihood.parameters, likelihood.fixed_terms),
        after=counted * problem.residuals(p, terms, out=out),
        noise=problem.bin_noise,
        distance=None if lap is None else problem.binned(lap.unwrapped) % lap.length,
        without=without,
    )
