# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Options that several verbs share, and what they mean."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from adk_ros.errors import UsageError
from adk_ros.signals.decode import SensorConfig

if TYPE_CHECKING:
    from adk_ros.bags.recording import RecordingOptions

BagArgument = Annotated[Path, typer.Argument(help="rosbag2 folder, .mcap, .db3 or ROS 1 .bag")]
BagsArgument = Annotated[list[Path], typer.Argument(help="one recording or more")]
ModelOption = Annotated[Path, typer.Option(help="folder that 'adk train' wrote")]
ImuOption = Annotated[str | None, typer.Option(help="IMU topic, if there are several")]
OdometryOption = Annotated[str | None, typer.Option(help="odometry topic, if there are several")]
CommandOption = Annotated[str | None, typer.Option(help="command topic, if there are several")]
NoImuOption = Annotated[bool, typer.Option("--no-imu", help="ignore the IMU")]
ParamsOption = Annotated[
    Path | None,
    typer.Option(help="the node's parameter file: joints, frames, extrinsics of this vehicle"),
]
JsonOption = Annotated[bool, typer.Option("--json", help="print the answer as JSON")]


def drive_options(
    imu: str | None,
    odometry: str | None,
    command: str | None,
    no_imu: bool,
    params: Path | None,
    own: dict[str, Any] | None = None,
) -> RecordingOptions:
    """
    Put the shared options together.

    The vehicle's sensors come from `params`, else from what the model was trained with (`own`).
    :raises UsageError: the parameter file does not fit.
    """
    from adk_ros.bags.recording import RecordingOptions

    sensors = sensors_of(own) if own else SensorConfig()
    if params is not None:
        from adk_ros.cli.params import read_sensors

        sensors = read_sensors(params)
    return RecordingOptions(imu, odometry, command, not no_imu, sensors)


def sensors_of(stored: dict[str, Any]) -> SensorConfig:
    """
    Return the sensor configuration kept in a manifest.

    :raises UsageError: it holds something that this version does not know.
    """
    try:
        values: dict[str, Any] = {
            k: tuple(v) if isinstance(v, list) else v for k, v in stored.items()
        }
        return replace(SensorConfig(), **values)
    except TypeError as error:
        raise UsageError(f"the model's manifest describes sensors unknown here: {error}") from None
