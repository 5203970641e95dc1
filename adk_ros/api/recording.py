# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`adk_ros.read_recording`: a bag as a data frame on the 25 ms grid."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from adk_ros.api.progress import Progress, in_stage
from adk_ros.api.tables import as_html, suffixed, with_units
from adk_ros.bags import Bag, Topics
from adk_ros.bags import recording as bag_reader
from adk_ros.bags.recording import Recording, RecordingOptions
from adk_ros.errors import UsageError
from adk_ros.importing.absent_command import with_absent_command
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.channels import INPUT_NAMES, STATE_NAMES, TICK_NS, Record
from adk_ros.signals.decode import SensorConfig

if TYPE_CHECKING:
    from adk_ros.mismatch.recording.sensor_log import SensorLog


@dataclass(frozen=True)
class BagRecording:
    """
    A recording read from a bag.

    `path`: the bag. `options`: the topics and sensor configuration it was read with, with the pose
    of the IMU that the bag itself gives. `content`:
    what the reader returned, with the record as arrays.
    """

    path: Path
    options: RecordingOptions
    content: Recording

    @property
    def name(self) -> str:
        """Name of the bag's folder or file."""
        return self.content.record.name

    @property
    def record(self) -> Record:
        """The samples as arrays."""
        return self.content.record

    @property
    def duration_s(self) -> float:
        """Duration of the samples in s, without gaps."""
        return self.content.record.duration_s

    @property
    def topics(self) -> Topics:
        """Names of the topics that were read."""
        return self.content.topics

    @property
    def warnings(self) -> list[str]:
        """What looks wrong in the bag, one line each: refused messages, implausible units."""
        return list(self.content.warnings)

    @property
    def time_s(self) -> FloatArray:
        """Time of each sample (n,), s from the bag's first message."""
        since_ns = self.content.record.stamp_ns - self.content.start_ns
        return np.asarray(since_ns * 1e-9, dtype=np.float64)

    @cached_property
    def frame(self) -> pd.DataFrame:
        """
        The recording as a table: one row per sample of the 25 ms grid, SI units.

        Index `time_s`: s from the bag's first message. Columns:

        - `v_x`, `v_y`, `yaw_rate`: the state known at that time; the predictor starts from it.
        - `a_x`, `a_y`: specific force, NaN without an IMU.
        - `torque`, `delta`: wheel torque and road-wheel angle in force from that time on.
        - `v_x_measured`, `v_y_measured`, `yaw_rate_measured`: the measurement interpolated between
          the readings before and after that time, NaN in gaps; predictions are scored against it.
        - `learnable`: whether the sample is free of faults. `episode`: number of the stretch
          without gaps.

        `frame.attrs["units"]` maps column names to units.
        """
        record = self.content.record
        columns: dict[str, Any] = dict(zip(STATE_NAMES, record.x.T, strict=True))
        columns |= dict(zip(("a_x", "a_y"), record.a.T, strict=True))
        columns |= dict(zip(INPUT_NAMES, record.u.T, strict=True))
        columns |= dict(zip(suffixed("measured"), record.x_ref.T, strict=True))
        columns |= {"learnable": record.learnable, "episode": record.episode}
        index = pd.Index(self.time_s, name="time_s")
        return with_units(pd.DataFrame(columns, index=index), self.name)

    def measured_at(self, time_s: FloatArray) -> FloatArray:
        """
        Return the measured state at the given times.

        :param time_s: times of any shape (...), s from the bag's first message.
        :return: (..., 3) in SI units, interpolated between samples; NaN in gaps and outside the
            recording.
        """
        known = np.isfinite(self.record.x_ref).all(axis=1)
        grid_s, values = self.time_s[known], self.record.x_ref[known]
        measured = np.full((*time_s.shape, 3), np.nan)
        if grid_s.size < 2:
            return measured
        after = np.clip(np.searchsorted(grid_s, time_s), 1, grid_s.size - 1)
        gap_s = grid_s[after] - grid_s[after - 1]
        tolerance_s = 1e-6
        inside = (time_s >= grid_s[0] - tolerance_s) & (time_s <= grid_s[-1] + tolerance_s)
        nearest_s = np.minimum(np.abs(time_s - grid_s[after]), np.abs(time_s - grid_s[after - 1]))
        inside &= (gap_s < 1.5 * TICK_NS * 1e-9) | (nearest_s < tolerance_s)
        for i in range(3):
            measured[..., i] = np.where(inside, np.interp(time_s, grid_s, values[:, i]), np.nan)
        return measured

    def _repr_html_(self) -> str:
        return as_html(f"Recording {self.name}: {self.duration_s:.1f} s", self.frame)


def read_recording(
    path: Path | str,
    options: RecordingOptions | None = None,
    progress: Progress | None = None,
) -> BagRecording:
    """
    Read a bag: choose its topics, decode and align them to the 25 ms grid.

    A bag without any command topic is read with a constant command of zero, and a warning.

    :param path: rosbag2 folder, .mcap, .db3 or ROS 1 .bag.
    :param options: topics and sensor configuration; default: topics chosen by type, sensors in
        the standard configuration. See `recording_options`.
    :raises UsageError: the bag cannot be read, or a named topic does not exist.
    :raises DataError: a topic is missing, or no sample is usable.

    Example::

        recording = adk_ros.read_recording("bags/town")
        recording.frame[["v_x", "v_x_measured"]].plot()
    """
    options, source = velocity_source(path, options)
    with Bag(path) as bag:
        options = with_absent_command(bag, options)
    report = in_stage(progress, f"reading {Path(path).name}")
    content = bag_reader.read_recording(path, options, report)
    if source:
        content.warnings.append(source)
    return BagRecording(Path(path), replace(options, sensors=content.sensors), content)


def velocity_source(
    path: Path | str, options: RecordingOptions | None, wheel_radius: float = 0.0
) -> tuple[RecordingOptions, str]:
    """
    Return options with the source of v_x of a bag whose odometry reports none, and a line on it.

    :param wheel_radius: of the vehicle, m, where the options give none; 0 if it is unknown.
    :raises UsageError, DataError: the bag cannot be read.
    """
    from adk_ros.importing.velocity_source import with_velocity_source

    options = options or RecordingOptions()
    known = options
    if wheel_radius > 0.0 and options.sensors.wheel_radius == 0.0:
        sensors = replace(options.sensors, wheel_radius=wheel_radius)
        known = replace(options, sensors=sensors)
    found, line = with_velocity_source(path, known)
    return (found, line) if line else (options, "")


def read_log(
    path: Path | str,
    options: RecordingOptions | None = None,
    progress: Progress | None = None,
    *,
    needs_imu: bool = True,
    needs_command: bool = True,
    wheel_radius: float = 0.0,
) -> SensorLog:
    """
    Read a bag as `mismatch.recording.from_bag.read_sensor_log`, with its source of v_x.

    Where odometry reports no velocity, `warnings` says what v_x was read from.

    :param needs_command: False reads a bag without any command topic with zeros as commands.
    :param wheel_radius: as in `velocity_source`.
    :raises UsageError, DataError: as `read_sensor_log`.
    """
    from adk_ros.mismatch.recording.from_bag import read_sensor_log

    chosen, source = velocity_source(path, options, wheel_radius)
    if not needs_command:
        with Bag(path) as bag:
            chosen = with_absent_command(bag, chosen)
    report = in_stage(progress, f"reading {Path(path).name}")
    log = read_sensor_log(path, chosen, report, needs_imu)
    return replace(log, warnings=(*log.warnings, source)) if source else log


def recording_options(
    *,
    imu: str | None = None,
    odometry: str | None = None,
    command: str | None = None,
    use_imu: bool = True,
    params: Path | str | None = None,
    stored_sensors: dict[str, Any] | None = None,
    warn: Callable[[str], None] | None = None,
) -> RecordingOptions:
    """
    Return the options that say how to read a recording.

    :param imu: name of the IMU's topic; default: the only one of its type.
    :param odometry: the same of the odometry.
    :param command: the same of the command.
    :param use_imu: False ignores the IMU.
    :param params: the node's parameter file, which describes the vehicle's sensors.
    :param stored_sensors: sensor configuration to use without `params`, as in a model's manifest.
    :param warn: called with a line for each unknown parameter; default: `warnings.warn`.
    :raises UsageError: the parameter file or the stored configuration is invalid.
    """
    sensors = sensors_from_manifest(stored_sensors) if stored_sensors else SensorConfig()
    if params is not None:
        from adk_ros.ros.parameter_file import read_parameter_file
        from adk_ros.ros.parameter_settings import sensor_config

        values, problems = read_parameter_file(Path(params))
        sensors = sensor_config(values)
        for text in problems:
            if warn is None:
                warnings.warn(text, stacklevel=2)
            else:
                warn(text)
    return RecordingOptions(imu, odometry, command, use_imu, sensors)


def sensors_from_manifest(stored: dict[str, Any]) -> SensorConfig:
    """
    Return the sensor configuration stored in a model's manifest.

    :raises UsageError: it contains a key that this version does not know.
    """
    try:
        values: dict[str, Any] = {
            key: tuple(value) if isinstance(value, list) else value
            for key, value in stored.items()
        }
        # Models of earlier versions were trained without transforms.
        return replace(SensorConfig(use_tf=False), **values)
    except TypeError as error:
        raise UsageError(
            f"the model's manifest describes sensors that this version does not know: {error}"
        ) from None


def as_recording(
    recording: BagRecording | Path | str,
    options: RecordingOptions | None,
    progress: Progress | None,
) -> BagRecording:
    """
    Return `recording`, read from its bag if it is a path.

    :raises UsageError: options are given for a recording that has already been read.
    """
    if not isinstance(recording, BagRecording):
        return read_recording(recording, options, progress)
    if options is not None:
        raise UsageError("give options to read_recording, or give the bag's path here")
    return recording
