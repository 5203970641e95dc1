# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What a user is told of each recording: `adk info`, `adk check` and `adk mismatch`.

A recording whose channels allow little gets an answer of little scope; it may be refused only if
the car stands still in it, or drives for less than what the checks need. `adk mismatch` compares
it with the vehicle file, as read with the parameters that `adk check` proposes.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from adk_ros.api.check import RecordingCheck, check_recording
from adk_ros.api.explain import explain
from adk_ros.api.info import bag_content, bag_verdict, read_bag, with_reading
from adk_ros.api.recording import velocity_source
from adk_ros.bags.recording import RecordingOptions
from adk_ros.calibration.criteria import MIN_MOVING_S
from adk_ros.calibration.finding import Verdict
from adk_ros.calibration.from_bag import read_streams
from adk_ros.calibration.grid import on_grid
from adk_ros.calibration.stream_checks import check_streams
from adk_ros.calibration.streams import Streams
from adk_ros.errors import AdkError

INFO, CHECK, MISMATCH = "info", "check", "mismatch"


@dataclass(frozen=True)
class Answer:
    """
    What a command says of a recording: `text`, or the reason why it refuses (`is_refused`).

    `moving_s`: s of driving that all streams cover, None if unknown.
    """

    vehicle: str
    recording: str
    command: str
    text: str
    is_refused: bool
    moving_s: float | None

    @property
    def may_be_refused(self) -> bool:
        """Whether the recording is known to be too short, or the car to stand still."""
        return self.moving_s is not None and self.moving_s < MIN_MOVING_S

    def as_dict(self) -> dict[str, object]:
        """Return the answer for JSON."""
        return asdict(self)


def answers(vehicle: str, path: Path, vehicle_file: Path | None) -> Iterator[Answer]:
    """
    Yield what the commands say of a recording.

    :param vehicle_file: of its car; without one nothing is compared.
    """
    checked: RecordingCheck | None = None
    try:
        checked = check_recording(path, vehicle_file)
        said, refused = _findings(checked), False
        moving_s = _moving_s(checked.content.streams)
    except AdkError as error:
        said, refused = str(error), True
        moving_s = _moving_s_of(path)
    yield _info(vehicle, path, moving_s)
    yield Answer(vehicle, path.name, CHECK, said, refused, moving_s)
    if vehicle_file is None:
        return
    try:
        said, refused = _comparison(path, vehicle_file, checked), False
    except AdkError as error:
        said, refused = str(error), True
    yield Answer(vehicle, path.name, MISMATCH, said, refused, moving_s)


def _info(vehicle: str, path: Path, moving_s: float | None) -> Answer:
    try:
        about = with_reading(bag_content(path), read_bag(path))
    except AdkError as error:
        return Answer(vehicle, path.name, INFO, str(error), True, moving_s)
    refused = not any(row["possible"] != "no" for row in about["scope"])
    return Answer(vehicle, path.name, INFO, bag_verdict(about), refused, moving_s)


def _findings(checked: RecordingCheck) -> str:
    counts = Counter(x.verdict for x in checked.result.findings)
    parameters = ", ".join(checked.result.parameters) or "none"
    return (
        f"{counts[Verdict.FINDING]} findings, {counts[Verdict.OK]} ok, "
        f"{counts[Verdict.NOT_DECIDABLE]} not decidable; proposed: {parameters}"
    )


def _comparison(path: Path, vehicle_file: Path, checked: RecordingCheck | None) -> str:
    options = RecordingOptions()
    if checked is not None:
        sensors = checked.result.corrected(checked.content.sensors)
        options = replace(options, sensors=sensors)
    found = explain(vehicle_file, path, without_imu=True, options=options)
    return f"{found.verdict}: {found.summary}"


def _moving_s_of(path: Path) -> float | None:
    try:
        options, _ = velocity_source(path, None)
        return _moving_s(read_streams(path, options).streams)
    except AdkError:
        return None


def _moving_s(streams: Streams) -> float | None:
    signals = on_grid(streams, check_streams(streams).unusable)
    if signals is None:
        return None
    if signals.v_x is None and signals.x is None:
        # Without a speed and a position nothing is known to move.
        return 0.0
    return float(signals.moving_s)
