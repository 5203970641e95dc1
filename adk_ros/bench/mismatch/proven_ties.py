# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Proof that the data of a case cannot separate two effects.

The recording of a case is generated again without sensor noise, everything else unchanged. The
effect that is present and an alternative are each fitted to it, with the noise model of the noisy
recording. The difference of their losses is the expectation of that on noisy recordings of the
drive, twice a log-likelihood ratio: where it is below `INDISTINGUISHABLE_LOSS`, no analysis of one
such recording can be expected to separate the two at these odds.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from adk_ros.mismatch.deployment.surrogate_file import load_surrogate
from adk_ros.mismatch.inference.fit_budget import FINAL
from adk_ros.mismatch.inference.hypothesis import ActiveEffect
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.score_test import LinearisedProblem
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.criteria import INDISTINGUISHABLE_LOSS
from adk_ros.mismatch.library.effect import ALWAYS
from adk_ros.mismatch.recording.from_bag import read_sensor_log
from adk_ros.mismatch.report.result_files import SIMULATION_FILE
from adk_ros.mismatch.surrogate.residuals import prepare_residual_problem


def reported_ties(label: dict[str, Any], answer: dict[str, Any]) -> list[str]:
    """Return what an answer reports as tied with a label's single effect, active throughout."""
    if len(label["effects"]) != 1 or label["effects"][0].get("kind") != ALWAYS:
        return []
    name = label["effects"][0]["name"]
    for effect in answer.get("effects", []):
        members = [effect["name"], *effect.get("alternatives", [])]
        if name in members and len(members) > 1:
            return [x for x in members if x != name and x in EFFECTS]
    return []


def proven_ties(
    label: dict[str, Any], tied: Sequence[str], case: Path, noise_free: Path, report: Path
) -> list[str]:
    """
    Return those of `tied` that the recording of a case cannot separate from its effect.

    :param case, noise_free: folders of the case and of the same case without sensor noise.
    :param report: report of `adk mismatch` on the case, which holds the surrogate.
    """
    surrogate = load_surrogate(report / SIMULATION_FILE).content.surrogate()
    noise = read_sensor_log(case / "recording").noise()
    log = read_sensor_log(noise_free / "recording")
    likelihood = Likelihood.of(prepare_residual_problem(log, noise), surrogate)
    (effect,) = label["effects"]
    present = EFFECTS[effect["name"]]
    true = tuple(p.theta(effect["params"][p.name]) for p in present.parameters)
    reference = likelihood.fit([ActiveEffect(present, true)], budget=FINAL).loss
    null = likelihood.fit([], budget=FINAL)
    linearised = LinearisedProblem(likelihood, null, likelihood.nuisance_jacobian(null))
    out = []
    for name in tied:
        start = linearised.screen_effect(EFFECTS[name])[0].active
        loss = likelihood.fit([start], nuisances=null.nuisances, budget=FINAL).loss
        # An alternative that fits much better profits from an error of the surrogate.
        if abs(loss - reference) < INDISTINGUISHABLE_LOSS:
            out.append(name)
    return out
