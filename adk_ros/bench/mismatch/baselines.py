# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Baseline methods on identical residuals: naming accuracy, abstention, residual reduction.

Each method gets the equation-error residuals of the surrogate model (`equation_errors`) and the
features of the recording. It is fitted on the training part of the recording and tested on the
held-out part, like the corrected model of `adk mismatch`; both parts are those of the tool.
`MEANS` maps the features that a sparse regression selects to effects.
"""

from __future__ import annotations

import threading
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from adk_ros.bench.mismatch.baseline_worker import METHODS
from adk_ros.bench.mismatch.equation_errors import HALF, EquationErrors, equation_errors
from adk_ros.bench.paper.baseline_libraries import Worker, find_python
from adk_ros.mismatch.deployment.surrogate_file import load_surrogate
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.criteria import HELD_OUT_SHARE
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.report.result_files import HELD_OUT_FILE as HELD_OUT_MODEL
from adk_ros.mismatch.report.result_files import SIMULATION_FILE
from adk_ros.mismatch.surrogate.residuals import STEP_S
from adk_ros.numerics.arrays import BoolArray, FloatArray
from adk_ros.signals.channels import STATE_NAMES

ADK_MISMATCH = "adk mismatch"
NAMING = ("pysindy STLSQ", "pysindy ensemble")
TIMEOUT_S = 600.0
MIN_RESIDUAL_TO_NOISE = 1.5
"""Smallest ratio of RMS residual to noise at which the residual counts as significant."""
MINOR = 0.2
"""A feature whose contribution is below this share of the largest one is ignored for naming."""

STRONGEST = "telling"
"""Key of the strongest equation in stored results."""

WORKER = Path(__file__).with_name("baseline_worker.py")

_STEERED_EFFECTS = ("steering_ratio", "front_tyre_stiffness")
_SIDESLIP_EFFECTS = ("front_tyre_stiffness", "rear_tyre_stiffness", "cg_shift")
_HIGH_GRIP_EFFECTS = ("low_friction", "load_sensitivity", "compliance_steer", "aero_downforce")
MEANS: dict[tuple[str, str], tuple[str, ...]] = {
    ("v_x", "constant"): ("rolling_resistance", "torque_offset"),
    ("v_x", "speed"): ("headwind",),
    ("v_x", "speed_squared"): ("aero_drag",),
    ("v_x", "speed_cubed"): ("aero_drag",),
    ("v_x", "torque"): ("drive_torque_gain", "wheel_radius", "payload", "rotating_inertia"),
    ("v_x", "torque_size"): ("brake_torque_gain",),
    ("v_x", "torque_squared"): ("power_limit",),
    ("v_x", "torque_speed"): ("power_limit",),
    **{
        (equation, feature): effects
        for equation in ("v_y", "yaw_rate")
        for features, effects in (
            (("constant",), ("steering_offset", "crosswind", "brake_drag_one_side")),
            (("delta", "delta_speed", "delta_speed_squared", "delta_cubed"), _STEERED_EFFECTS),
            (
                ("lateral_speed", "lateral_speed_speed", "lateral_speed_per_speed"),
                _SIDESLIP_EFFECTS,
            ),
            (("lateral_cubed", "lateral_squared", "lateral_size"), _HIGH_GRIP_EFFECTS),
            (("yaw_rate_speed", "yaw_rate_speed_squared"), _HIGH_GRIP_EFFECTS),
            (("torque_delta", "torque_lateral", "torque_yaw_rate"), ("payload",)),
            (("speed_squared",), ("crosswind",)),
        )
        for feature in features
    },
}
"""(Equation, selected feature) -> effects that it can represent."""


@dataclass(frozen=True)
class BaselineResult:
    """
    Result of one method on one case.

    `removed`: reduction of the mean square of the held-out residual, by equation;
    `strongest_equation`: that with the largest residual among those that the injected effects act
    in, "" if no residual is significant; `names`: reported effects, "" if the method names none;
    `abstains`: it reports no mismatch.
    """

    method: str
    names: str
    right: bool
    abstains: bool
    removed: dict[str, float]
    strongest_equation: str

    def as_row(self) -> dict[str, Any]:
        """Return the result as a dict, under the keys of the first release."""
        row = asdict(self)
        row[STRONGEST] = row.pop("strongest_equation")
        return row


class Baselines:
    """
    The baseline methods in a separate process; requests of several threads are serialised.

    :raises UsageError: the Python environment of the baselines (`make peers`) is missing.
    :raises DataError: it fails.
    """

    def __init__(self, python: Path | None = None, worker: Path = WORKER) -> None:
        self._worker = Worker(find_python(python), worker, TIMEOUT_S)
        self._lock = threading.Lock()

    def close(self) -> None:
        """End the process."""
        self._worker.close()

    def compare_baselines(
        self, recording: SensorLog, report: Path, label: dict[str, Any], answer: dict[str, Any]
    ) -> list[dict[str, Any]]:
        """
        Return the row of a `BaselineResult` for `adk mismatch` and each baseline, one case.

        `answer`: the content of mismatch.json in `report`.
        """
        plain = equation_errors(recording, load_surrogate(report / SIMULATION_FILE).content)
        corrected = equation_errors(recording, load_surrogate(report / HELD_OUT_MODEL).content)
        learned, tested = split_rows(plain.time_s, recording.duration_s)
        before = plain.residuals[tested]
        strongest = _strongest_equation(plain, label)
        wanted = {effect["name"] for effect in label["effects"]}
        reported = [str(effect["name"]) for effect in answer.get("effects", [])]
        verdict = str(answer.get("verdict", ""))
        rows = [BaselineResult(
            ADK_MISMATCH, " + ".join(reported) or verdict, set(reported) == wanted - {"unknown"}
            and (verdict == "unknown") == ("unknown" in wanted),
            verdict == "none", _removed(before, corrected.residuals[tested]), strongest,
        )]  # fmt: skip
        for method in METHODS:
            with self._lock:
                found = self._worker.ask(
                    method=np.array(method),
                    features=plain.features[learned],
                    targets=plain.residuals[learned],
                    later=plain.features[tested],
                    names=np.array(plain.names),
                )
            predicted = np.asarray(found["predicted"], dtype=np.float64)
            groups = named(plain, found["coefficients"]) if method in NAMING else []
            expressions = [str(x) for x in found["expression"] if str(x)]
            names = " + ".join("|".join(group) for group in groups) or "; ".join(expressions)
            rows.append(BaselineResult(
                method, names, method in NAMING and matches(groups, wanted),
                not predicted.any(), _removed(before, before - predicted), strongest,
            ))  # fmt: skip
        return [row.as_row() for row in rows]


def split_rows(time_s: FloatArray, duration_s: float) -> tuple[BoolArray, BoolArray]:
    """
    Return the rows of the training part and of the held-out part of `adk mismatch`.

    A row is a slope over a time to either side; those that reach over the limit are in neither.
    """
    limit_s = duration_s * (1.0 - HELD_OUT_SHARE)
    return time_s < limit_s - HALF * STEP_S, time_s > limit_s + HALF * STEP_S


def _removed(before: FloatArray, after: FloatArray) -> dict[str, float]:
    power, left = (np.sum(x**2, axis=0) for x in (before, after))
    return {
        name: float(1.0 - left[i] / max(power[i], 1e-30)) for i, name in enumerate(STATE_NAMES)
    }


def _strongest_equation(plain: EquationErrors, label: dict[str, Any]) -> str:
    """Return the equation with the largest significant residual of the label's effects, or ""."""
    entered: set[str] = set()
    for effect in label["effects"]:
        known = EFFECTS.get(effect["name"])
        entered |= set(effect.get("equations", STATE_NAMES) if known is None else known.equations)
    ratio = np.sqrt(np.mean(plain.residuals**2, axis=0)) / np.maximum(plain.noise, 1e-12)
    ratio[[name not in entered for name in STATE_NAMES]] = 0.0
    best = int(np.argmax(ratio))
    return STATE_NAMES[best] if ratio[best] > MIN_RESIDUAL_TO_NOISE else ""


def named(plain: EquationErrors, coefficients: FloatArray) -> list[tuple[str, ...]]:
    """
    Map the coefficients (k, 3) of a sparse regression to groups of indistinguishable effects.

    Minor features are ignored; a feature without an effect is named by equation and feature.
    """
    scale = np.sqrt(np.mean(plain.features**2, axis=0))
    groups: list[tuple[str, ...]] = []
    for column, equation in enumerate(STATE_NAMES):
        size = np.abs(coefficients[:, column]) * scale
        for i in np.argsort(-size):
            if size[i] == 0.0 or size[i] < MINOR * size.max():
                break
            name = plain.names[int(i)]
            group = MEANS.get((equation, name), (f"{equation}:{name}",))
            if group not in groups:
                groups.append(group)
    return groups


def matches(groups: list[tuple[str, ...]], wanted: set[str]) -> bool:
    """Whether each group holds a wanted effect and each wanted effect is in a group."""
    members = {name for group in groups for name in group}
    return wanted <= members and all(wanted & set(group) for group in groups)
