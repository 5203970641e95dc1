# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Write a generated case as a folder: bags, the vehicle file and the label."""

from __future__ import annotations

import json
from pathlib import Path

import yaml  # type: ignore[import-untyped, unused-ignore]

from adk_ros.bench.mismatch.case_generator import GeneratedCase
from adk_ros.offline.sensor_log_bag import write_sensor_log


def recordings_of(case: Path) -> list[Path]:
    """Return the recordings of a case, the first one first."""
    return [case / "recording", *sorted(case.glob("recording_*"))]


def write_case(case: GeneratedCase, folder: Path) -> None:
    """Write a case in the layout that `find_cases` reads."""
    folder.mkdir(parents=True)
    for name, log in (
        ("simulation", case.simulation),
        ("recording", case.recording),
        ("heldout", case.held_out),
        *((log.name, log) for log in case.further),
    ):
        write_sensor_log(log, folder / name)
    (folder / "vehicle.yaml").write_text(yaml.safe_dump(case.nominal.model_dump()))
    (folder / "label.json").write_text(json.dumps(case.label, indent=1))
