# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`adk check`: signs, units, axes, timing and calibration of a recording, with evidence."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd

from adk_ros.api.output import check_output
from adk_ros.api.progress import Progress, in_stage
from adk_ros.api.recording import velocity_source
from adk_ros.bags.recording import RecordingOptions
from adk_ros.calibration.check import CheckResult
from adk_ros.calibration.from_bag import BagContent
from adk_ros.calibration.reference_check import ReferenceCheck
from adk_ros.errors import UsageError
from adk_ros.mismatch.recording.nominal_vehicle import NominalVehicle, load_nominal_vehicle

_NEEDED = frozenset({"cg_to_front_axle", "cg_to_rear_axle", "wheel_radius"})
"""Values of a vehicle file that sensors and steering are compared with."""


@dataclass(frozen=True)
class RecordingCheck:
    """
    The checks of one recording.

    `path`: the bag. `content`: what it holds. `result`: findings, proposed parameters, advice.
    `length_scale`: of the vehicle (`numerics.similarity`), None without a vehicle file.
    """

    path: Path
    content: BagContent
    result: CheckResult
    length_scale: float | None = None

    @property
    def frame(self) -> pd.DataFrame:
        """The findings as a table, one row per check, indexed by name."""
        rows = [finding.as_dict() for finding in self.result.findings]
        return pd.DataFrame(rows).set_index("name")

    def as_dict(self) -> dict[str, Any]:
        """Return what `adk check --json` prints."""
        return {
            "kind": "check",
            "path": str(self.path),
            "seconds": round(self.content.streams.seconds, 3),
            "used_as": self.content.topics,
            "findings": [finding.as_dict() for finding in self.result.findings],
            "parameters": self.result.parameters,
            "road": self._road_summary(),
            "scope": self.scope,
            "advice": self.result.advice,
            "notes": list(self.content.streams.notes),
            "warnings": self.content.warnings,
        }

    @cached_property
    def scope(self) -> list[dict[str, str]]:
        """What the recording allows: name, possible (yes, reduced, no), why and needs."""
        from adk_ros.calibration.scope import scope_of

        return [row.as_dict() for row in scope_of(self.content, self.length_scale)]

    def _road_summary(self) -> dict[str, Any] | None:
        from adk_ros.api.road import road_summary

        profile = self.result.road
        if profile is None:
            return None
        return road_summary(profile, self.content.streams.attitude, self.result.heights)

    @property
    def road(self) -> pd.DataFrame | None:
        """Grade and bank along the drive (`road.road_frame`); None where not decidable."""
        from adk_ros.api.road import road_frame

        profile = self.result.road
        if profile is None:
            return None
        return road_frame(profile, self.content.streams.attitude, self.result.heights)

    def write_road(self, out: Path | str, force: bool = False) -> bool:
        """
        Write grade and bank along the drive as CSV, PNG or SVG; return False if there are none.

        :raises UsageError: the file exists and `force` is not set, or has another ending.
        """
        from adk_ros.api.road import check_road_path, write_road

        target = Path(out)
        check_road_path(target)
        if self.result.road is None:
            return False
        check_output(target, force, None, self.path)
        attitude, heights = self.content.streams.attitude, self.result.heights
        write_road(self.result.road, target, attitude, heights)
        return True

    def write_parameters(self, out: Path | str, force: bool = False) -> bool:
        """
        Write the proposed parameters as a ROS parameter file; return False if there are none.

        The file also has what the recording was read with, as far as it differs from the
        defaults, so that it replaces an earlier one.

        :raises UsageError: the file exists and `force` is not set, or values contradict.
        """
        from adk_ros.ros.parameter_file import write_parameters
        from adk_ros.signals.decode import SensorConfig

        if not self.result.parameters:
            return False
        target = Path(out)
        check_output(target, force, None, self.path)
        default, given = asdict(SensorConfig()), asdict(self.content.sensors)
        known = {name: value for name, value in given.items() if value != default[name]}
        try:
            self.result.corrected(self.content.sensors)
        except UsageError as error:
            raise UsageError(f"{target}: the proposed parameters contradict: {error}") from None
        write_parameters(target, known | self.result.parameters)
        return True


def check_recording(
    recording: Path | str,
    vehicle: Path | str | None = None,
    *,
    options: RecordingOptions | None = None,
    progress: Progress | None = None,
) -> RecordingCheck:
    """
    Check a recording before training or comparing with it.

    :param recording: rosbag2 folder, .mcap, .db3 or ROS 1 .bag; IMU, odometry and command are each
        optional.
    :param vehicle: vehicle file (YAML or packaged name), for the wheelbase, mass and wheel radius.
    :param options: topics and sensor configuration.
    :raises UsageError: the bag or a file does not exist or is invalid.
    :raises DataError: the bag is unreadable or empty.
    """
    from adk_ros.calibration.check import check

    nominal = None if vehicle is None else load_nominal_vehicle(vehicle)
    assumed = frozenset() if nominal is None else nominal.assumed & _NEEDED
    content = _read(recording, options, nominal, progress)
    if assumed:
        content.warnings.append(
            f"{vehicle}: {', '.join(sorted(assumed))} missing: what needs them is not checked, as "
            "an assumed length is no measure for sensors; measure and add them"
        )
    found = check(content, nominal, in_stage(progress, "checking"), assumed)
    scale = None if nominal is None else nominal.length_scale
    return RecordingCheck(Path(recording), content, found, scale)


def _read(
    path: Path | str,
    options: RecordingOptions | None,
    nominal: NominalVehicle | None,
    progress: Progress | None,
) -> BagContent:
    """Return the streams of a recording, with v_x of another source where odometry has none."""
    from adk_ros.calibration.from_bag import read_streams

    is_known = nominal is not None and "wheel_radius" not in nominal.assumed
    radius = nominal.wheel_radius if nominal is not None and is_known else 0.0
    chosen, source = velocity_source(path, options, radius)
    content = read_streams(path, chosen, in_stage(progress, f"reading {Path(path).name}"))
    if source:
        content.warnings.append(source)
    return content


@dataclass(frozen=True)
class RecordingComparison:
    """
    What has changed between two recordings of one vehicle.

    `path`, `reference`: the bags, with their contents `content` and `reference_content`.
    """

    path: Path
    reference: Path
    content: BagContent
    reference_content: BagContent
    result: ReferenceCheck

    @property
    def frame(self) -> pd.DataFrame:
        """The findings as a table, one row per fault, indexed by name."""
        rows = [finding.as_dict() for finding in self.result.findings]
        return pd.DataFrame(rows).set_index("name")

    def as_dict(self) -> dict[str, Any]:
        """Return what `adk check --reference --json` prints."""
        comparison = self.result.comparison
        changes = () if comparison is None else comparison.changes
        contents = (self.content, self.reference_content)
        return {
            "kind": "check against reference",
            "path": str(self.path),
            "reference": str(self.reference),
            "findings": [finding.as_dict() for finding in self.result.findings],
            "candidates": {
                x.fit.fault.label: [y.fault.label for y in x.candidates] for x in changes
            },
            "is_same_course": None if comparison is None else comparison.is_same_course,
            "advice": self.result.advice,
            "notes": [note for x in contents for note in x.streams.notes],
            "warnings": [warning for x in contents for warning in x.warnings],
        }


def compare_recordings(
    recording: Path | str,
    reference: Path | str,
    vehicle: Path | str | None = None,
    *,
    options: RecordingOptions | None = None,
    progress: Progress | None = None,
) -> RecordingComparison:
    """
    Say which sensor or steering parameter has changed against a recording of the same vehicle.

    :param recording: as for `check_recording`; `reference`: the recording before.
    :param vehicle: vehicle file, for the wheelbase; without one it follows from the steering.
    :param options: topics and sensor configuration, of both recordings.
    :raises UsageError: a bag or a file does not exist or is invalid.
    :raises DataError: a bag is unreadable or empty.
    """
    from adk_ros.calibration.reference_check import check_against, prepared

    nominal = None if vehicle is None else load_nominal_vehicle(vehicle)
    known, content = (_read(path, options, nominal, progress) for path in (reference, recording))
    found = check_against(prepared(known), prepared(content), nominal)
    return RecordingComparison(Path(recording), Path(reference), content, known, found)
