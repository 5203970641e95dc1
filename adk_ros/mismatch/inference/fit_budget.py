# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Budgets of the fits by purpose: most iterations, and the relative decrease that ends a fit.

Screening fits only rank hypotheses; fits whose values are reported run to convergence. All values
are empirical.
"""

from __future__ import annotations

from adk_ros.numerics.levenberg_marquardt import FitOptions

NULL_HYPOTHESIS = FitOptions(8, 1e-4)
"""Nuisance parameters alone, before any effect."""
SCREENING = FitOptions(4, 1e-4)
"""One more effect at fixed nuisance derivatives: ranks candidates."""
SEGMENTS = FitOptions(5, 1e-5)
"""Size and segment boundaries of an effect at fixed nuisance derivatives."""
JOINT = FitOptions(6, 3e-5)
"""All parameters of the candidates that lead after screening."""
ABLATION = FitOptions(6, 1e-4)
"""A hypothesis without one of its effects."""
COMPETITOR = FitOptions(5, 1e-5)
"""A competing effect at fixed nuisance derivatives."""
COMPETITOR_REFIT = FitOptions(6, 1e-5)
"""A competing effect that comes close."""
REPLACEMENT = FitOptions(8, 1e-6)
"""A competing effect that takes the place of an identified one."""
FEATURE = FitOptions(20, 1e-6)
"""One more feature at fixed nuisance derivatives: many cheap iterations."""
FEATURE_REFIT = FitOptions(4, 1e-5)
"""A leading feature with updated nuisance derivatives."""
SIMULATION = FitOptions(8, 1e-5)
"""The surrogate's parameters on the simulation, before features."""
FINAL = FitOptions(6, 1e-6)
"""The hypothesis that is reported."""
HELD_OUT = FitOptions(3, 1e-4)
"""The reported hypothesis on the part before the held-out one."""
