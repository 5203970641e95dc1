# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Write a generated case as a folder: three bags, the vehicle file and the label."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import yaml  # type: ignore[import-untyped, unused-ignore]

from adk_ros.bench.mismatch.case_generator import GeneratedCase
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.numerics.arrays import FloatArray
from adk_ros.offline.export import write_bag
from adk_ros.plant.scenario.sensor_simulation import START_NS, SimulatedDrive
from adk_ros.plant.scenario.sensors import Sensors, Stream
from adk_ros.signals.channels import Source


def write_evidence(evidence: SensorLog, path: Path) -> None:
    """Write the streams of a sensor log as a bag; stamps count from `START_NS`."""

    def stream(at_s: FloatArray, values: FloatArray) -> Stream:
        at = START_NS + np.rint(at_s * 1e9).astype(np.int64)
        return Stream(at, at, np.ascontiguousarray(values))

    e = evidence
    streams = {
        Source.IMU: stream(e.imu_s, e.imu),
        Source.ODOMETRY: stream(e.odometry_s, np.column_stack([e.odometry, e.pose])),
        Source.COMMAND: stream(e.command_s, e.command),
    }
    # `write_bag` reads only these fields.
    readings = range(sum(len(s.stamp_ns) for s in streams.values()))
    drive = SimpleNamespace(
        streams=streams, sensors=Sensors(), readings=readings, attitude=None, wheels=None
    )
    write_bag(cast(SimulatedDrive, drive), path)


def write_case(case: GeneratedCase, folder: Path) -> None:
    """Write a case in the layout that `find_cases` reads."""
    folder.mkdir(parents=True)
    for name, log in (
        ("simulation", case.simulation),
        ("recording", case.recording),
        ("heldout", case.held_out),
    ):
        write_evidence(log, folder / name)
    (folder / "vehicle.yaml").write_text(yaml.safe_dump(case.nominal.model_dump()))
    (folder / "label.json").write_text(json.dumps(case.label, indent=1))
