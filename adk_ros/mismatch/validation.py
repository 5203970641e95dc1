# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Validation of a decision on held-out data: what is exported, and which verdict the errors allow.

Effects, places, onsets and sizes come from the training part alone. The held-out data are used for
the figures, and for vetoes: a correction that raises the error of any state is not exported, and a
verdict that leaves an error unexplained, or that no prediction checks, becomes `unknown`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import yaml  # type: ignore[import-untyped, unused-ignore]

from adk_ros.files.yaml_file import validate
from adk_ros.mismatch.deployment.corrected_model import corrected_yaml
from adk_ros.mismatch.deployment.held_out import (
    HORIZONS_S,
    REPORTED_HORIZON,
    Evidence,
    HeldOutErrors,
    horizon_errors,
    noise_error,
    persistence_errors,
    rmse,
    unjudged_states,
    without_sensor_faults,
)
from adk_ros.mismatch.deployment.prediction_starts import FIRST_START_S
from adk_ros.mismatch.deployment.surrogate_file import SurrogateFile
from adk_ros.mismatch.deployment.surrogate_writer import simulation_yaml
from adk_ros.mismatch.deployment.tolerance_error import tolerance_error
from adk_ros.mismatch.export_choice import Correction, choose_correction
from adk_ros.mismatch.inference.decision import Decision
from adk_ros.mismatch.inference.hypothesis import ActiveEffect, Hypothesis, road_friction
from adk_ros.mismatch.inference.result import (
    NOT_CHECKED,
    NOT_EXPORTED,
    UNKNOWN,
    HeldOutResult,
    UnexplainedResidual,
)
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.mismatch.surrogate.lap import Lap
from adk_ros.mismatch.surrogate.residuals import BIN_S, ResidualProblem, prepare_residual_problem
from adk_ros.numerics.arrays import BoolArray, FloatArray
from adk_ros.signals.channels import STATE_NAMES


@dataclass(frozen=True)
class Validation:
    """
    Result on held-out data.

    `export`: which of the corrections did not raise any error; `held_out_yaml`: that correction,
    fitted to the training part; `raised`: the states whose error a rejected correction raised;
    `contradicted`: those raised beyond chance by one that does not lower the errors on the whole;
    `rejected` (horizons, 3): the RMSE with the rejected correction, of the same data as
    `errors.before`, None where no correction was rejected.
    """

    errors: HeldOutErrors
    export: str
    held_out_yaml: str
    raised: tuple[str, ...] = ()
    contradicted: tuple[str, ...] = ()
    rejected: FloatArray | None = None

    @property
    def described(self) -> FloatArray:
        """
        The RMSE (horizons, 3) with what was fitted, as far as it describes the recording.

        A rejected correction describes a state that it explains at every horizon; what raises one
        error and leaves another unexplained describes nothing.
        """
        if self.rejected is None:
            return self.errors.after
        with np.errstate(invalid="ignore"):
            left = (self.errors.ratio_of(self.rejected) > 1.0).any(axis=0)
        return np.where(left, self.errors.after, self.rejected)

    @property
    def error_ratio(self) -> float:
        """
        Largest error over what a correct model explains; 0 where no state is judged.

        The limit of an explained one where nothing could be predicted.
        """
        if not self.errors.starts:
            return 1.0
        return float(np.nanmax(np.append(self.errors.explained_ratio(), 0.0)))


def validate_on_held_out(
    surrogate: SurrogateModel,
    hypothesis: Hypothesis,
    lap: Lap | None,
    held_out: Sequence[Evidence],
    not_judged: Sequence[str] = (),
) -> Validation:
    """
    Return the errors of the exported correction (`export_choice`), and what the effects explain.

    `not_judged`: states that the recorded channels say nothing about.
    """
    held_out = [_within_simulation(surrogate, x) for x in held_out]
    expected = expected_error(surrogate, [x.log for x in held_out])
    effects = hypothesis.effects

    def evaluate(part: str, candidate: Hypothesis) -> Correction:
        trial = corrected_yaml(surrogate, candidate, lap)
        return Correction(part, trial, horizon_errors(_parsed(trial), held_out))

    plain = simulation_yaml(surrogate)
    simulation = Correction(NOT_EXPORTED, plain, horizon_errors(_parsed(plain), held_out))
    chosen = choose_correction(simulation, hypothesis, evaluate, expected, not_judged)
    before, after, text = rmse(simulation.errors), rmse(chosen.errors), chosen.text
    # What is identified may explain an error, though its correction raises another by chance.
    judged = chosen.refused or chosen
    clean = [_judged(surrogate, x, effects) for x in held_out]
    fitted = rmse(judged.errors)
    unchanged = all(a is b for a, b in zip(clean, held_out, strict=True))
    corrected = fitted.copy() if unchanged else rmse(horizon_errors(_parsed(judged.text), clean))
    hidden = [STATE_NAMES.index(name) for name in not_judged]
    faulty = [STATE_NAMES.index(name) for name in unjudged_states(effects)]
    for values in (before, after, fitted, corrected):
        values[:, hidden] = np.nan
    corrected[:, faulty] = np.nan
    # Of the model that is judged: on the limit of the tyres, tolerances matter more.
    expected = np.hypot(expected, tolerance_error(_parsed(judged.text), clean))
    return Validation(
        HeldOutErrors(
            before,
            after,
            rmse(persistence_errors(held_out)),
            expected,
            corrected,
            int(np.isfinite(simulation.errors[:, REPORTED_HORIZON, 0]).sum()),
        ),
        chosen.part,
        text,
        chosen.raised,
        chosen.contradicted,
        None if chosen.refused is None else fitted,
    )


def _within_simulation(surrogate: SurrogateModel, item: Evidence) -> Evidence:
    """Return evidence without the stretches that are driven harder than the simulation."""
    problem = prepare_residual_problem(item.log)
    return _without(item, problem, surrogate.bins_beyond(problem))


def _judged(
    surrogate: SurrogateModel, item: Evidence, effects: Sequence[ActiveEffect]
) -> Evidence:
    """
    Return the evidence that a corrected model is judged by: without identified sensor faults.

    Nor with the stretches on a slippery road that use more of the grip than the simulation.
    """
    clean = without_sensor_faults(item.log, effects)
    out = item if clean is item.log else replace(item, log=clean)
    problem = prepare_residual_problem(item.log)
    friction = road_friction(effects, problem)
    if friction is None:
        return out
    beyond = surrogate.bins_beyond(problem, friction)
    return _without(out, problem, beyond) if beyond.any() else out


def _without(item: Evidence, problem: ResidualProblem, bins: BoolArray) -> Evidence:
    """Return evidence that skips some bins (b,) of its recording's grid."""
    edges = np.diff(bins.astype(int), prepend=0, append=0)
    begins, ends = np.flatnonzero(edges > 0), np.flatnonzero(edges < 0)
    return replace(
        item, skipped_s=problem.start_s + BIN_S * np.column_stack([begins, ends]).astype(float)
    )


def model_errors(
    surrogate: SurrogateModel, text: str, held_out: Sequence[Evidence]
) -> tuple[FloatArray, FloatArray]:
    """Return the RMSE (horizons, 3) of a model file, and those that its noise would cause."""
    within = [_within_simulation(surrogate, x) for x in held_out]
    expected = expected_error(surrogate, [x.log for x in within])
    return rmse(horizon_errors(_parsed(text), within)), expected


def correction_errors(
    surrogate: SurrogateModel, h: Hypothesis, lap: Lap | None, evidence: Sequence[Evidence]
) -> tuple[dict[str, float], dict[str, float]]:
    """Return the RMSE by state at the reported horizon: of the simulation, and corrected."""
    models = (simulation_yaml(surrogate), corrected_yaml(surrogate, h, lap))
    first, second = (
        rmse(horizon_errors(_parsed(text), evidence))[REPORTED_HORIZON] for text in models
    )
    return (
        dict(zip(STATE_NAMES, map(float, first), strict=True)),
        dict(zip(STATE_NAMES, map(float, second), strict=True)),
    )


def expected_error(surrogate: SurrogateModel, logs: Sequence[SensorLog]) -> FloatArray:
    """
    Return the RMSE (horizons, 3) of a correct model of a car without build tolerances.

    Noise and the surrogate's own error cause it.
    """
    noise = np.sqrt(np.mean([noise_error(log) ** 2 for log in logs], axis=0))
    own = surrogate.open_loop_error
    zero = np.zeros((len(HORIZONS_S), len(STATE_NAMES)))
    return np.asarray(np.hypot(noise, zero if own is None else own))


def open_loop_error(
    surrogate: SurrogateModel, simulation: SensorLog, v_x_is_given: bool = False
) -> FloatArray:
    """
    Return the RMSE (horizons, 3) of a surrogate on the simulation that it was fitted to.

    `v_x_is_given`: as in the predictions that it is compared with, see `Evidence`.
    """
    model = _parsed(simulation_yaml(surrogate))
    evidence = Evidence(simulation, v_x_is_given=v_x_is_given)
    return np.nan_to_num(rmse(horizon_errors(model, [evidence])))


def coherent(decision: Decision, validation: Validation) -> Decision:
    """
    Return a decision whose verdict the held-out errors allow.

    `none` and `explained` become `unknown` where an error is larger than noise, the surrogate's
    own error and the inexactness of the effects' equations explain, and where nothing could be
    predicted. The effects stay listed.
    """
    errors = validation.errors
    if decision.verdict == UNKNOWN:
        return decision
    if not errors.starts:
        nothing = UnexplainedResidual([], 0.0, NOT_CHECKED, "")
        return replace(decision, verdict=UNKNOWN, unexplained=nothing)
    if errors.is_explained:
        return decision
    states = errors.unexplained_states()
    share = _unexplained_share(errors, states)
    unexplained = UnexplainedResidual(states, share, error_text(errors, states[0]), "")
    return replace(decision, verdict=UNKNOWN, unexplained=unexplained)


def error_text(errors: HeldOutErrors, state: str) -> str:
    """Return which held-out error is too large, with what noise and the surrogate explain."""
    i = STATE_NAMES.index(state)
    horizon = int(np.nanargmax(errors.explained_ratio()[:, i]))
    unit = "rad/s" if state == "yaw_rate" else "m/s"
    size = f"{errors.corrected[horizon, i]:.2g} {unit}"
    return (
        f"{state.replace('_rate', ' rate')} is predicted with an error of {size} "
        f"{HORIZONS_S[horizon]:g} s ahead, where noise, build tolerance and the surrogate "
        f"model's own error explain {errors.expected[horizon, i]:.2g} {unit}"
    )


def held_out_result(validation: Validation, evidence: Sequence[Evidence]) -> HeldOutResult:
    """Return the part of the result that describes the held-out data."""
    errors = validation.errors

    def by_state(values: FloatArray) -> dict[str, list[float]]:
        return {name: [float(x) for x in values[:, i]] for i, name in enumerate(STATE_NAMES)}

    return HeldOutResult(
        " and ".join(_source(item) for item in evidence),
        HORIZONS_S,
        by_state(errors.before),
        by_state(errors.after),
        by_state(errors.persistence),
        by_state(errors.expected),
        by_state(errors.explained_ratio()),
        errors.starts,
        errors.is_explained,
        validation.export,
        validation.raised,
        errors.tolerances_fitted,
        None if validation.rejected is None else by_state(validation.rejected),
    )


def _source(item: Evidence) -> str:
    log = item.log
    if item.from_s <= FIRST_START_S:
        return f"the recording (bag {log.name})"
    return f"the last {log.duration_s - item.from_s:.0f} s of the recording (bag {log.name})"


def _unexplained_share(errors: HeldOutErrors, states: Sequence[str]) -> float:
    """Return the largest share of a squared error, above the expected one, that is left."""
    shares = [0.0]
    for name in states:
        i = STATE_NAMES.index(name)
        expected = errors.expected[:, i] ** 2
        removable = np.maximum(errors.before[:, i] ** 2 - expected, 1e-12)
        left = np.maximum(errors.corrected[:, i] ** 2 - expected, 0.0)
        shares.append(float(np.nanmax(np.minimum(left / removable, 1.0))))
    return round(max(shares), 3)


def _parsed(text: str) -> SurrogateFile:
    return validate("model", yaml.safe_load(text), SurrogateFile)
