# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The result in a few sentences: the same on the terminal, in the JSON file and on the page."""

from __future__ import annotations

import math

import numpy as np

from adk_ros.mismatch.inference.confidence import UNLISTED
from adk_ros.mismatch.inference.feature_effect import EQUATION_TEXTS
from adk_ros.mismatch.inference.final_estimate import PROBABLE
from adk_ros.mismatch.inference.result import (
    EXPLAINED,
    NONE,
    NOT_CHECKED,
    NOT_EXPORTED,
    NOT_JUDGED,
    UNKNOWN,
    HeldOutResult,
    MismatchResult,
    UnexplainedResidual,
)
from adk_ros.mismatch.library.criteria import (
    INCONCLUSIVE_ERROR_TO_NOISE,
    MAX_IMPROVED_RATIO,
    MAX_RAISED_RATIO,
)
from adk_ros.mismatch.library.features import feature
from adk_ros.mismatch.library.parametric_features import is_transferable
from adk_ros.mismatch.recording.sensor_log import CHANNELS, UNITS
from adk_ros.mismatch.report.calibration_text import identified_text, shown_text
from adk_ros.mismatch.report.direct_table import uncovered_comparisons, uncovered_text
from adk_ros.mismatch.report.vocabulary import (
    CHANNEL_TITLES,
    STATES,
    listed,
    title,
    unit_text,
)

INCONCLUSIVE = "Inconclusive"
"""Title of a result that finds nothing where differences may be hidden."""


def most_improved_state(result: MismatchResult) -> str:
    """Return the state whose error is reduced most, relative to its error before."""
    evaluated = [name for name, value in result.before.items() if math.isfinite(value)]
    return max(
        evaluated or list(result.before),
        key=lambda name: result.before[name] / max(result.after[name], 1e-9),
    )


def improvement_text(result: MismatchResult) -> str:
    """Return how much the correction reduces the error on held-out data; a sentence."""
    if not any(math.isfinite(value) for value in result.before.values()):
        return "No prediction error could be measured: the held-out data have no motion."
    held_out = result.held_out
    if held_out is not None and held_out.export == NOT_EXPORTED and _was_refused(held_out):
        return f"No corrected vehicle model is exported: {_rejection_text(held_out)}."
    name = most_improved_state(result)
    state, unit = STATES.get(name, (name, ""))
    before, after = result.before[name], result.after[name]
    error = f"the RMS {state} error, predicted {result.horizon_s:g} s ahead on held-out data,"
    if after < MAX_IMPROVED_RATIO * before:
        first, second = pair_text(before, after)
        return f"With the corrected vehicle model, {error} falls from {first} to {second} {unit}."
    terms = () if result.unexplained is None else result.unexplained.terms
    if held_out is not None and held_out.export == NOT_EXPORTED and not (terms or result.effects):
        return f"Nothing is corrected; {error} is {before:.2g} {unit}."
    if terms and not any(is_transferable(term.feature) for term in terms):
        return (
            "Its phase is that of this recording, so no corrected vehicle model contains it, and "
            f"{error} stays at {before:.2g} {unit}."
        )
    if has_only_sensor_faults(result):
        return (
            f"Sensor faults are not corrected in the vehicle model, so {error} "
            f"stays at {before:.2g} {unit}."
        )
    return f"The corrected vehicle model does not reduce {error} from {before:.2g} {unit}."


def _was_refused(held_out: HeldOutResult) -> bool:
    """Whether there was a correction that is not exported, since it does not improve."""
    return bool(held_out.raised) or held_out.rejected is not None


def _rejection_text(held_out: HeldOutResult) -> str:
    """Return what the refused correction would lower and raise on held-out data."""
    if not held_out.raised:
        return "no part of it lowers the errors on held-out data on the whole"
    rejected = held_out.rejected or held_out.after
    ratios = {
        name: np.array(rejected[name]) / np.maximum(held_out.before[name], 1e-9)
        for name in STATES
        if np.isfinite(rejected[name]).all()
    }
    # Only a part of it, with fewer tolerances, may have raised an error.
    if any(
        name not in ratios or ratios[name].max() <= MAX_RAISED_RATIO for name in held_out.raised
    ):
        raised = listed([STATES[name][0] for name in held_out.raised])
        return f"it would raise the {raised} error on held-out data"

    def change(name: str, i: int) -> str:
        first, second = pair_text(held_out.before[name][i], rejected[name][i])
        ahead = f"{held_out.horizons_s[i]:g} s ahead"
        return (
            f"the RMS {STATES[name][0]} error {ahead} from {first} to {second} {STATES[name][1]}"
        )

    raised = listed([change(name, int(ratios[name].argmax())) for name in held_out.raised])
    lowered = {name: x for name, x in ratios.items() if name not in held_out.raised}
    best = min(lowered, key=lambda name: lowered[name].min(), default="")
    if not best or lowered[best].min() >= MAX_IMPROVED_RATIO:
        return f"on held-out data it would raise {raised}"
    lower = change(best, int(lowered[best].argmin()))
    return f"on held-out data it would lower {lower}, and raise {raised}"


def has_only_sensor_faults(result: MismatchResult) -> bool:
    """Whether all identified effects are sensor faults, which no vehicle model corrects."""
    return result.verdict == EXPLAINED and all(x.effect.sensor for x in result.effects)


def pair_text(before: float, after: float) -> tuple[str, str]:
    """Return two errors with as many decimals as give the smaller one two digits."""
    if not (0.0 < after < math.inf and 0.0 < before < math.inf):
        return f"{before:.3g}", f"{after:.3g}"
    decimals = 1 - math.floor(math.log10(min(before, after)))
    most = 3 - math.floor(math.log10(max(before, after)))
    places = max(min(decimals, most), 0)
    first, second = _with_decimals(before, after, places)
    if first == second and before != after:
        return _with_decimals(before, after, places + 1)
    return first, second


def _with_decimals(before: float, after: float, places: int) -> tuple[str, str]:
    first, second = (
        f"{x:.{places}f}" if x >= 10.0**-places else f"{x:.2g}" for x in (before, after)
    )
    return first, second


def unexplained_text(unexplained: UnexplainedResidual) -> str:
    """Return which acceleration is unexplained and which signals it depends on."""
    if not unexplained.terms:
        return unit_text(unexplained.text)
    features: dict[str, list[str]] = {}
    for term in unexplained.terms:
        features.setdefault(term.equation, []).append(feature(term.feature).description)
    equations: dict[str, list[str]] = {}
    for equation, names in features.items():
        equations.setdefault(listed(names), []).append(EQUATION_TEXTS[equation])
    return listed(
        [
            f"a {listed(kinds)} that depend{'s' if len(kinds) == 1 else ''} on {names}"
            for names, kinds in equations.items()
        ]
    )


def underfit_channels(result: MismatchResult) -> str:
    """Return the channels in which the surrogate does not fit the simulation, with its error."""
    return listed(
        [
            f"{CHANNEL_TITLES[name]} ({result.surrogate_error[name]:.2g} {unit_text(unit)})"
            for name, unit, noise in zip(CHANNELS, UNITS, result.series.noise, strict=True)
            if result.surrogate_error[name] > INCONCLUSIVE_ERROR_TO_NOISE * noise
        ]
    )


def verdict_text(result: MismatchResult) -> str:
    """Return the verdict in a few words."""
    if is_unjudged(result):
        return f"Not judged: {NOT_JUDGED}"
    effects = identified_text(result.effects, nothing_else=result.verdict == EXPLAINED)
    if is_unchecked(result):
        return "Not checked by any prediction" + (f"; {effects}" if effects else "")
    if result.verdict == UNKNOWN:
        return "Difference of unknown cause" + (f"; {effects}" if effects else "")
    if effects:
        return effects
    if underfit_channels(result) or uncovered_comparisons(result):
        return INCONCLUSIVE
    return "No significant mismatch"


def is_unchecked(result: MismatchResult) -> bool:
    """Whether nothing could be predicted on held-out data, so that nothing confirms the result."""
    return result.unexplained is not None and result.unexplained.text == NOT_CHECKED


def is_unjudged(result: MismatchResult) -> bool:
    """Whether the recordings have no command that says what moves the car."""
    return result.unexplained is not None and result.unexplained.text == NOT_JUDGED


def sentence(result: MismatchResult) -> str:
    """Return the result in a few sentences, calibrations after missing physics."""
    missing = f" {uncovered_text(result)}".rstrip()
    if result.missing_channels:
        missing += f" Analysed without {listed([x.what for x in result.missing_channels])}."
    if is_unjudged(result):
        return (
            f"Not judged: {NOT_JUDGED}, so nothing is compared with the simulation; record the "
            "wheel torque in N·m and the angle of the road wheels. The scope says what the "
            f"recording allows.{missing}"
        )
    if result.verdict == NONE:
        return _no_mismatch(result) + missing
    if is_unchecked(result):
        shown = (
            shown_text(result, nothing_else=False)
            if result.effects
            else "no significant difference"
        )
        return (
            f"Not checked: {NOT_CHECKED}; give another recording with --held-out. The part that "
            f"the model is fitted to shows {shown}.{missing}"
        )
    improvement = improvement_text(result)
    if result.verdict == UNKNOWN and result.unexplained is not None:
        expression = unit_text(result.unexplained.expression)
        formula = f": {expression}" if expression else ""
        said = f"{unexplained_text(result.unexplained)}{formula}"
        if result.unexplained.meaning:
            # What a person can picture comes first, the formula second.
            said = result.unexplained.meaning
            said += f". As a formula: {expression}" if expression else ""
        effects = _set_aside_text(result)
        if result.effects:
            effects += f" It also shows {shown_text(result, nothing_else=False)}."
        return (
            "The recording shows a difference that no known effect explains: "
            f"{said}. {improvement}{effects}{missing}"
        )
    shown = shown_text(result, nothing_else=True)
    return f"The recording shows {shown}. {improvement}{_doubt_text(result)}{missing}"


def _doubt_text(result: MismatchResult) -> str:
    """Return which effects are less probable than not; sentences, or nothing."""
    out = ""
    for identified in result.effects:
        if identified.confidence < PROBABLE:
            name, share = title(identified.effect.name), f"{100.0 * identified.confidence:.0f} %"
            out += f" The probability of {name} is {share}"
            if identified.posterior.get(UNLISTED, 0.0) > identified.confidence:
                out += ": a formula without any known effect describes the recording better"
            out += "."
    return out


def _set_aside_text(result: MismatchResult) -> str:
    """Return which effects of an exported correction are not claimed; a sentence, or nothing."""
    is_exported = result.held_out is not None and result.held_out.export != NOT_EXPORTED
    if not (result.set_aside and is_exported):
        return ""
    names = listed([title(name) for name in result.set_aside])
    return (
        f" This correction is by {names}, which {'is' if len(result.set_aside) == 1 else 'are'} "
        "not claimed: physics that no known effect describes is more probable."
    )


def _no_mismatch(result: MismatchResult) -> str:
    name = next((x for x in ("v_x", "yaw_rate", "v_y") if math.isfinite(result.before[x])), "")
    error = "no prediction error could be measured"
    if name:
        state, unit = STATES[name]
        error = (
            f"RMS {state} error {result.before[name]:.2g} {unit}, "
            f"predicted {result.horizon_s:g} s ahead"
        )
    underfit = underfit_channels(result)
    if underfit:
        return (
            f"Inconclusive: the surrogate model does not fit the simulation in {underfit}; "
            f"smaller differences cannot be found ({error})."
        )
    if uncovered_comparisons(result):
        return f"Inconclusive: no effect of the catalogue reduces the residual enough ({error})."
    if result.held_out is not None and result.held_out.tolerances_fitted:
        return (
            "No significant mismatch: build tolerances that the training part shows and sensor "
            f"noise explain the held-out part ({error})."
        )
    return (
        "No significant mismatch: the differences are within build tolerance and sensor noise "
        f"({error})."
    )
