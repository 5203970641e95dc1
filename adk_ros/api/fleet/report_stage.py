# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Stage `reports`: the report of a recording on its own, which the page of the fleet links."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from adk_ros.api.fleet.explain_stage import explanation_rows
from adk_ros.api.fleet.index_stage import file_hash
from adk_ros.bags.recording import RecordingOptions
from adk_ros.files.code_digest import code_digest
from adk_ros.fleet.stage import hash_of

PAGE = "report.html"


@dataclass(frozen=True)
class ReportStage:
    """
    As `ExplainStage`, against the simulation as the fleet has identified it, with a report.

    `simulation`: vehicle file of the surrogate (`simulation.yaml`): a bag would be refused for
    recordings that are faster or slower. `folder`: where the reports are written, a folder for
    each simulation, code and content and in it one for the recording, seen by all workers under
    this path. The row of kind `verdict` has the page below it in `details.report`. `options`:
    topics and sensor configuration. `content`: hash of the recording's content.
    """

    simulation: str
    folder: str
    without_imu: bool = False
    options: RecordingOptions = field(default_factory=RecordingOptions)
    name: str = "reports"
    content: str = ""

    def of_content(self, content_hash: str) -> ReportStage:
        """Return the stage for a recording with this hash of its content."""
        return replace(self, content=content_hash)

    @property
    def model_hash(self) -> str:
        """Hash of the vehicle file of the surrogate."""
        return file_hash(self.simulation)

    @property
    def inputs_hash(self) -> str:
        """Hash of the simulation, topics and sensor configuration."""
        return self.inputs_of_model(self.model_hash)

    def inputs_of_model(self, model_hash: str) -> str:
        """Return `inputs_hash`, given that of the simulation."""
        return hash_of([model_hash, self.without_imu, asdict(self.options)])

    @property
    def shared_paths(self) -> tuple[str, ...]:
        """Vehicle file of the surrogate, and folder of the reports."""
        return (self.simulation, self.folder)

    def run(self, path: Path, recording: str) -> list[dict[str, Any]]:
        """Return the rows of a recording, and write its report."""
        from adk_ros.api.explain import explain

        explanation = explain(
            self.simulation, path, without_imu=self.without_imu, options=self.options
        )
        # Results of another simulation, code or content are kept, and so are their reports.
        version = hash_of([self.inputs_hash, code_digest(), self.content])
        place = f"{version[:16]}/{recording}"
        explanation.write(Path(self.folder) / place, force=True)
        rows = explanation_rows(explanation)
        for row in rows:
            if row["kind"] == "verdict":
                row["details"]["report"] = f"{place}/{PAGE}"
        return rows
