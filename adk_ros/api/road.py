# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Grade and bank along a drive as a table, a file and a figure."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from adk_ros.calibration.height import heights_json
from adk_ros.calibration.height_slope import HeightSlope
from adk_ros.calibration.road import attitude_comparison
from adk_ros.calibration.streams import Stream
from adk_ros.errors import UsageError
from adk_ros.files.pages.figure_style import BLACK, BLUE, GREEN, ORANGE
from adk_ros.numerics.arrays import FloatArray
from adk_ros.road.profile import RoadProfile, SlopeProfile

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SUFFIXES = (".csv", ".png", ".svg")
"""Kinds of file that `write_road` writes."""


_HEIGHTS = {"odometry": "odometry's height", "gps": "GPS altitude"}
"""Labels of the sources of a height, with a colour each."""


def road_frame(
    profile: RoadProfile,
    attitude: Stream | None = None,
    heights: Mapping[str, HeightSlope] | None = None,
) -> pd.DataFrame:
    """
    Return the profile as a table, one row per node, SI units and radians.

    `direction`: +1 in the direction in which the place was passed first, else -1. `grade` is
    positive uphill, `bank` where the left side is higher, both in the direction of the car, with
    their 90 % intervals. `ins_grade`, `ins_bank`: of the attitude, where there is one.
    `odometry_height_grade`, `gps_height_grade`: slope of a height, where it is recorded.
    """
    columns: dict[str, FloatArray] = {
        "time_s": profile.at_s,
        "distance": profile.distance,
        "place": profile.place,
        "direction": profile.direction,
    }
    for name, slope in (("grade", profile.grade), ("bank", profile.bank)):
        columns |= {name: slope.value, f"{name}_low": slope.low, f"{name}_high": slope.high}
    if profile.x is not None and profile.y is not None:
        columns |= {"x": profile.x, "y": profile.y}
    if attitude is not None:
        at = attitude.at_s
        columns["ins_grade"] = -np.interp(profile.at_s, at, attitude["pitch"])
        columns["ins_bank"] = np.interp(profile.at_s, at, attitude["roll"])
    for source, height in (heights or {}).items():
        columns[f"{source}_height_grade"] = height.grade
    return pd.DataFrame(columns)


def road_summary(
    profile: RoadProfile,
    attitude: Stream | None = None,
    heights: Mapping[str, HeightSlope] | None = None,
) -> dict[str, Any]:
    """Return range, RMS and intervals of grade and bank for JSON; angles in rad."""
    against = {
        name: {"correlation": correlation, "scale": scale}
        for name, correlation, scale, _ in (
            attitude_comparison(profile, attitude) if attitude is not None else ()
        )
    }
    slopes = {"grade": profile.grade, "bank": profile.bank}
    return {
        name: _summary(slope) | {"ins": against.get(name)} for name, slope in slopes.items()
    } | {
        "heights": heights_json(heights or {}),
        "distance": float(profile.distance[-1] - profile.distance[0]),
        "repeated": profile.repeated,
        "level_by": profile.level_by,
        "assumed": list(profile.assumed),
    }


def _summary(slope: SlopeProfile) -> dict[str, float]:
    return {
        "lowest": float(slope.value.min()),
        "highest": float(slope.value.max()),
        "rms": float(np.sqrt(np.mean(slope.value**2))),
        "mean": float(slope.value.mean()),
        "level_error": slope.level,
        "relative_error": slope.relative,
        "imu_offset": slope.offset,
        "imu_offset_error": slope.offset_error,
    }


def check_road_path(out: Path) -> None:
    """Refuse a file of another kind than `SUFFIXES`."""
    if out.suffix.lower() not in SUFFIXES:
        raise UsageError(f"{out}: --road writes files that end in {' or '.join(SUFFIXES)}")


def write_road(
    profile: RoadProfile,
    out: Path,
    attitude: Stream | None = None,
    heights: Mapping[str, HeightSlope] | None = None,
) -> None:
    """Write the profile as a table (CSV) or a figure (PNG, SVG), by the ending of the path."""
    check_road_path(out)
    frame = road_frame(profile, attitude, heights)
    if out.suffix.lower() == ".csv":
        frame.round(6).to_csv(out, index=False)
        return
    road_figure(frame, out.stem).savefig(out, dpi=150)


def road_figure(frame: pd.DataFrame, title: str) -> Figure:
    """Draw grade and bank in per cent against the distance, with their 90 % intervals."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 5.5), layout="constrained")
    axes = figure.subplots(2, 1, sharex=True)
    distance = frame["distance"].to_numpy()
    for axis, name in zip(axes, ("grade", "bank"), strict=True):
        low, value, high = (
            100.0 * np.tan(frame[f"{name}{end}"].to_numpy()) for end in ("_low", "", "_high")
        )
        axis.fill_between(distance, low, high, color=BLUE, alpha=0.25, label="90 % interval")
        axis.plot(distance, value, color=BLUE, linewidth=1.4, label="from kinematics")
        if f"ins_{name}" in frame:
            ins = 100.0 * np.tan(frame[f"ins_{name}"].to_numpy())
            axis.plot(distance, ins, color=BLACK, linewidth=1.0, linestyle="--", label="INS")
        for (source, label), colour in zip(_HEIGHTS.items(), (ORANGE, GREEN), strict=True):
            if name == "grade" and f"{source}_height_grade" in frame:
                slope = 100.0 * np.tan(frame[f"{source}_height_grade"].to_numpy())
                axis.plot(distance, slope, color=colour, linewidth=1.0, label=label)
        axis.set_ylabel(f"{name} (%)")
        axis.grid(alpha=0.3)
    axes[0].legend(fontsize=8)
    axes[1].set_xlabel("distance driven (m)")
    figure.suptitle(title)
    return figure
