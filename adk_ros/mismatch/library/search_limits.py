# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Limits of the search for effects and features.

They bound the computing time: what they exclude is not fitted. A claim must meet the criteria
(`library.criteria`) whatever they are, but they can cost a finding or an alternative, and then a
wrong effect may be claimed, or one with too much confidence. Their values trade time for recall,
by choice: `adk bench concealed` prints both.
"""

from __future__ import annotations

MAX_EFFECTS = 3
"""Most effects of one hypothesis."""
MAX_SINGLES_FITTED = 16
"""Most single effects that are fitted, of those screened."""
BEAM_WIDTH = 3
"""Hypotheses of one size that are extended by another effect."""
MAX_REFITS = 6
"""Hypotheses of one size that are fitted jointly."""
PRUNING_SHARE_SINGLE = 0.25
"""
Candidates for a first effect with a linearised gain below this share of `MIN_FIRST_GAIN` are not
fitted.
"""
PRUNING_SHARE = 0.4
"""Of a second and third effect: share of the gain that it must have."""
MIN_SCREENED_GAIN_SINGLE = 0.05
"""Least linearised gain of a single effect that is fitted, as a share of the best."""
MIN_SCREENED_GAIN = 0.3
"""The same for a second and third effect."""
MIN_SCREENED_GAIN_ONSET = 0.5
"""The same for effects that begin at a time."""
MIN_SCREENED_GAIN_SEGMENT = 0.2
"""The same for effects in segments of the lap."""
MAX_ONSETS_FITTED = 2
"""Most effects with an onset that are fitted for one start."""
MAX_SEGMENTED_FITTED = 3
"""Most effects in segments that are fitted for one start."""
BEAM_EXCESS_SHARE = 0.5
"""A hypothesis within this share of the best one's excess loss is extended."""
BEAM_NOISE_SHARE = 0.04
"""Share of a perfect model's loss added to that margin."""
REFIT_NULL_SHARE = 0.1
"""
Share of the excess loss before any effect added to that margin: screening keeps the nuisance
derivatives of that fit, and errs by a share of what is unexplained there.
"""
REFIT_EXCESS_RATIO = 2.0
"""A hypothesis below this multiple of the best excess loss is fitted jointly."""
REFIT_NOISE_SHARE = 0.08
"""Share of a perfect model's loss added to that margin."""
MAX_SEGMENTS = 6
"""Most segments of one effect on a lap."""
MAX_COMPETITORS = 4
"""Competing effects that are fitted for each identified one."""
CONFUSABLE_GAIN_FACTOR = 4.0
"""Factor on the linearised gain of effects that the catalogue lists as confusable."""
COMPETITOR_REFIT_MARGINS = 20.0
"""A competing effect within this many margins is fitted to convergence."""
MAX_FEATURES = 4
"""Most features of one expression."""
MAX_FEATURES_FITTED = 14
"""Features that are fitted in each round."""
MAX_PARAMETRIC_SCREENED = 6
"""Features with searched parameters that are simulated in each round."""
MAX_FEATURE_REFITS = 4
"""Features that are fitted anew with updated nuisance derivatives."""
MIN_SCREENED_GAIN_FEATURE = 0.5
"""Least linearised gain of a feature that is fitted, as a share of the best."""
FEATURE_REFIT_GAIN_SHARE = 0.85
"""Least gain of a feature that is fitted anew, as a share of the best."""
MAX_REPLACEMENTS = 3
"""Most exchanges of an identified effect for a competing one."""
DOMINANT_EFFECT_MISFIT = 0.2
"""An effect that leaves at most this share of the misfit ends the search of a pass."""
MAX_EXTENSION_PASSES = 3
"""Most extensions of one surrogate."""
