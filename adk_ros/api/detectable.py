# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The smallest effects that `adk mismatch` would name, before recording."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from adk_ros.api.progress import Progress, in_stage
from adk_ros.api.recording import read_log
from adk_ros.bags.recording import RecordingOptions
from adk_ros.errors import UsageError

MINUTES = (2.0, 5.0, 10.0, 30.0)


def detectable(
    simulation: Path | str,
    vehicle: Path | str | None = None,
    recording: Path | str | None = None,
    *,
    noise: Sequence[float] | None = None,
    minutes: Sequence[float] = MINUTES,
    options: RecordingOptions | None = None,
    progress: Progress | None = None,
) -> pd.DataFrame:
    """
    Return the smallest size of each effect that `adk mismatch` would name after some driving.

    :param simulation: bag of the simulator; its driving is taken as that of the recording.
    :param vehicle: vehicle file of the simulated car: YAML or packaged name.
    :param recording: bag of the real car, for the noise of its sensors.
    :param noise: standard deviation of a sample of a_x, a_y, gyro, v_x, v_y, yaw rate in SI units;
        default: that of the recording, or of the sensors that `adk simulate` assumes.
    :param minutes: durations of the recording, of which the last quarter is held out.
    :return: index (effect, parameter, minutes). `size`: difference from the simulation, NaN if no
        size is detectable, with `unit`; `limit`: the contribution that alone demands the largest
        effect; the size with each contribution alone: `sensor_noise`, `build_tolerance`,
        `surrogate_error`, `materiality_threshold`. In `attrs`, lists of lines: `warnings`, what
        looks wrong in the bags, and `extrinsics`, the poses of the IMU that they gave.
    :raises UsageError: an argument is invalid.
    :raises DataError: a bag is unusable.
    """
    import numpy as np

    from adk_ros.mismatch.inference.detectable_sizes import detectable_sizes
    from adk_ros.mismatch.planned_drive import planned_drive
    from adk_ros.mismatch.recording.nominal_vehicle import load_nominal_vehicle

    if noise is not None and (len(noise) != 6 or not all(0.0 < x < np.inf for x in noise)):
        raise UsageError("noise: six positive values (a_x, a_y, gyro, v_x, v_y, yaw rate)")
    if not minutes or not all(0.0 < x < np.inf for x in minutes):
        raise UsageError("minutes: positive durations")
    nominal = None if vehicle is None else load_nominal_vehicle(vehicle)
    radius = 0.0 if nominal is None else nominal.wheel_radius
    simulated = read_log(simulation, options, progress, wheel_radius=radius)
    values = None if noise is None else np.array(noise, dtype=np.float64)
    logs = [simulated]
    if values is None and recording is not None:
        logs.append(read_log(recording, options, progress, wheel_radius=radius))
        values = logs[1].noise()
    drive = planned_drive(simulated, nominal, values)
    report = in_stage(progress, "effects")
    found = detectable_sizes(
        drive, tuple(minutes), progress=lambda done, total: report(done, total, "")
    )
    index = pd.MultiIndex.from_tuples(
        [(x.effect, x.parameter, x.minutes) for x in found],
        names=["effect", "parameter", "minutes"],
    )
    frame = pd.DataFrame(
        {
            "size": [x.size for x in found],
            "unit": [x.unit for x in found],
            "limit": [x.limit for x in found],
        },
        index=index,
    )
    for name in ("sensor noise", "build tolerance", "surrogate error", "materiality threshold"):
        frame[name.replace(" ", "_")] = [x.alone.get(name, np.nan) for x in found]
    frame.attrs["warnings"] = [line for log in logs for line in log.warnings]
    frame.attrs["extrinsics"] = [log.extrinsics for log in logs if log.extrinsics]
    return frame
