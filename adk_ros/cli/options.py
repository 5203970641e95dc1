# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Options that several verbs share."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from adk_ros.cli import console

if TYPE_CHECKING:
    from adk_ros.bags.recording import RecordingOptions

BagArgument = Annotated[Path, typer.Argument(help="rosbag2 folder, .mcap, .db3 or ROS 1 .bag")]
BagsArgument = Annotated[list[Path], typer.Argument(help="one or more recordings")]
ModelOption = Annotated[Path, typer.Option(help="model folder written by 'adk train'")]
ImuOption = Annotated[str | None, typer.Option(help="IMU topic", show_default="the only one")]
OdometryOption = Annotated[
    str | None, typer.Option(help="odometry topic", show_default="the only one")
]
CommandOption = Annotated[
    str | None, typer.Option(help="command topic", show_default="the only one")
]
NoImuOption = Annotated[
    bool,
    typer.Option(
        "--no-imu",
        help="ignore the IMU ('adk mismatch' has --without-imu, which accepts a missing one)",
    ),
]
ParamsOption = Annotated[
    Path | None,
    typer.Option(
        help="parameter file of the live predictor (predictor.yaml): names of the drive and "
        "steering joints (JointState), "
        "mass, sensor positions and frames"
    ),
]
RecordingParamsOption = Annotated[
    Path | None,
    typer.Option(
        help="parameter file of the recordings alone, such as 'adk check --out' writes; --params "
        "then describes the simulator's bag alone",
        show_default="as --params",
    ),
]
ForceOption = Annotated[bool, typer.Option("--force", help="replace an earlier result at --out")]
JsonOption = Annotated[bool, typer.Option("--json", help="print the result as JSON")]


def read_options(
    imu: str | None,
    odometry: str | None,
    command: str | None,
    no_imu: bool,
    params: Path | None,
    stored_sensors: dict[str, Any] | None = None,
) -> RecordingOptions:
    """
    Return how to read the bags; unknown parameters in `params` are printed as warnings.

    The sensor configuration comes from `params`, otherwise from `stored_sensors`, which is that
    of the model's manifest.

    :raises UsageError: the parameter file is invalid.
    """
    from adk_ros.api.recording import recording_options

    return recording_options(
        imu=imu,
        odometry=odometry,
        command=command,
        use_imu=not no_imu,
        params=params,
        stored_sensors=stored_sensors,
        warn=console.warn,
    )


def options_of_recordings(
    options: RecordingOptions, recording_params: Path | None
) -> RecordingOptions:
    """
    Return `options` with the sensor configuration of --recording-params, where it is given.

    :raises UsageError: the parameter file is invalid.
    """
    if recording_params is None:
        return options
    from adk_ros.api.recording import recording_options

    described = recording_options(params=recording_params, warn=console.warn)
    return replace(options, sensors=described.sensors)
