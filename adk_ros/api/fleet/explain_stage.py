# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Stage `explain`: which physics the simulation lacks, by each recording on its own."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from adk_ros.api.fleet.index_stage import file_hash
from adk_ros.bags.recording import RecordingOptions
from adk_ros.fleet.stage import hash_of

if TYPE_CHECKING:
    from adk_ros.api.explain import MismatchExplanation


@dataclass(frozen=True)
class ExplainStage:
    """
    What `adk mismatch` finds.

    Rows by `kind`: `verdict` (finding none, explained or unknown; text: the sentence), `effect` (a
    row for each parameter, with its interval; channel is the parameter's name, condition where the
    effect acts), `error` (RMSE of open-loop predictions of the simulation on held-out data).
    `simulation`: bag or vehicle file of the simulator; `vehicle`: as in `explain`, "" for none;
    `options`: topics and sensor configuration of both.
    """

    simulation: str
    vehicle: str = ""
    without_imu: bool = False
    options: RecordingOptions = field(default_factory=RecordingOptions)
    name: str = "explain"

    @property
    def model_hash(self) -> str:
        """Hash of the bag of the simulator, or of its vehicle file."""
        return file_hash(self.simulation)

    @property
    def inputs_hash(self) -> str:
        """Hash of the simulation, the vehicle file, topics and sensor configuration."""
        return self.inputs_of_model(self.model_hash)

    def inputs_of_model(self, model_hash: str) -> str:
        """Return `inputs_hash`, given that of the simulation."""
        files = [model_hash, file_hash(self.vehicle)]
        return hash_of([*files, self.without_imu, asdict(self.options)])

    @property
    def shared_paths(self) -> tuple[str, ...]:
        """Simulation and vehicle file."""
        return tuple(path for path in (self.simulation, self.vehicle) if path)

    def run(self, path: Path, recording: str) -> list[dict[str, Any]]:
        """Return the rows of a recording."""
        from adk_ros.api.explain import explain

        explanation = explain(
            self.simulation,
            path,
            self.vehicle or None,
            without_imu=self.without_imu,
            options=self.options,
        )
        return explanation_rows(explanation)


def explanation_rows(explanation: MismatchExplanation) -> list[dict[str, Any]]:
    """Return verdict, effects, errors and warnings of an analysis as rows."""
    answer = explanation.as_dict()
    rows: list[dict[str, Any]] = [
        {
            "kind": "verdict",
            "finding": answer["verdict"],
            "text": answer["sentence"],
            "details": {"notes": answer["notes"], "unexplained": answer.get("unexplained")},
        }
    ]
    for effect in answer["effects"]:
        for parameter, interval in effect["parameters"].items():
            rows.append(
                {
                    "kind": "effect",
                    "finding": effect["name"],
                    "channel": parameter,
                    "condition": effect["where"]["text"],
                    "value": interval["value"],
                    "low": interval["low"],
                    "high": interval["high"],
                    "unit": interval["unit"],
                    "details": {
                        "confidence": effect["confidence"],
                        "alternatives": effect["alternatives"],
                    },
                }
            )
    for channel, unit in explanation.errors["unit"].items():
        for model in ("before", "after"):
            rows.append(
                {
                    "kind": "error",
                    "finding": "simulation" if model == "before" else "corrected",
                    "channel": str(channel),
                    "horizon_s": answer["fit"]["horizon_s"],
                    "value": answer["fit"][model][channel],
                    "unit": unit,
                }
            )
    rows += [
        {"kind": "warning", "finding": "explain", "text": text} for text in explanation.warnings
    ]
    return rows
