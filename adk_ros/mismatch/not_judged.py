# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The result for recordings whose commands say nothing of the motion: scope, but no judgement."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from adk_ros.mismatch.deployment.held_out import HORIZONS_S, REPORTED_HORIZON
from adk_ros.mismatch.deployment.surrogate_writer import simulation_yaml
from adk_ros.mismatch.inference.asked_effect import AskedEffect
from adk_ros.mismatch.inference.result import (
    NOT_JUDGED,
    UNKNOWN,
    MismatchResult,
    MissingChannel,
    ResidualSeries,
    UnexplainedResidual,
)
from adk_ros.mismatch.inputs import Inputs
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.recorded_data import RecordedData
from adk_ros.mismatch.recording.sensor_log import CHANNELS
from adk_ros.mismatch.surrogate.feature_terms import feature_signals
from adk_ros.signals.channels import STATE_NAMES

_NO_COMMAND = MissingChannel(
    "a command",
    "the recording has no command: nothing says what drives and steers the car; record the wheel "
    "torque in N·m and the angle of the road wheels",
)


def not_judged(inputs: Inputs, ask: Sequence[str] = ()) -> MismatchResult:
    """
    Return verdict `unknown` with the scope of the recordings, the surrogate model and no effect.

    `ask`: effects that were asked for; none is claimed.
    """
    surrogate, data = inputs.surrogate, inputs.data
    simulated = simulation_yaml(surrogate)
    unknown = dict.fromkeys(STATE_NAMES, math.nan)
    return MismatchResult(
        verdict=UNKNOWN,
        effects=[],
        unexplained=UnexplainedResidual([], 0.0, NOT_JUDGED, ""),
        horizon_s=HORIZONS_S[REPORTED_HORIZON],
        before=unknown,
        after=dict(unknown),
        groups=[],
        suggestion="",
        simulation_yaml=simulated,
        corrected_yaml=simulated,
        series=_series(inputs),
        surrogate_error=dict(zip(CHANNELS, map(float, surrogate.error), strict=True)),
        steps=[],
        expected_loss=0.0,
        lap_m=data.single_lap.length if data.single_lap is not None else None,
        notes=list(inputs.notes),
        missing_channels=_missing(data),
        not_judged=sorted(EFFECTS),
        asked=[AskedEffect(name, False, NOT_JUDGED) for name in ask],
        scope=data.observable.scope(inputs.scope),
        road=data.problem.log.road,
    )


def _missing(data: RecordedData) -> list[MissingChannel]:
    found = data.observable.missing_channels()
    if all(part.log.has_command for part in data.parts):
        return found
    of_command = {"a torque command", "a steering angle"}
    return [_NO_COMMAND, *(x for x in found if x.what not in of_command)]


def _series(inputs: Inputs) -> ResidualSeries:
    """Return the measured signals; the residuals are zero, as those of channels without weight."""
    surrogate, problem = inputs.surrogate, inputs.data.problem
    out = problem.run(surrogate.parameters, surrogate.fixed_terms(problem))
    zero = np.zeros((len(CHANNELS), problem.bins))
    x, y = (problem.binned(problem.pose[:, i]) for i in range(2))
    return ResidualSeries(
        time_s=problem.bin_s,
        x=x,
        y=y,
        signals={k: problem.binned(v) for k, v in feature_signals(problem, out).items()},
        before=zero,
        after=zero.copy(),
        noise=problem.bin_noise,
    )
