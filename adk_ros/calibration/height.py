# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Findings on the heights of a recording, against the grade of the road."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from adk_ros.calibration.criteria import MATERIAL, MIN_CORRELATION
from adk_ros.calibration.finding import Finding, Verdict, found, judged, not_decidable
from adk_ros.calibration.height_slope import HeightSlope, height_slope
from adk_ros.calibration.signs_and_units import unit_of
from adk_ros.calibration.streams import Stream, Streams
from adk_ros.numerics.constants import GRAVITY
from adk_ros.road.profile import RoadProfile

_REMEDY = (
    "no parameter for this: correct the unit or the scale of the height, or of a_x if "
    "`acceleration_scale` is a finding as well"
)


def check_heights(
    profile: RoadProfile | None, streams: Streams
) -> tuple[list[Finding], Mapping[str, HeightSlope]]:
    """
    Return the findings on the heights, and what they say of the grade by their source.

    Nothing where neither odometry nor a receiver reports a height that varies.
    """
    findings: list[Finding] = []
    slopes: dict[str, HeightSlope] = {}
    if profile is None or streams.odometry is None:
        return findings, slopes
    for source, height in streams.heights.items():
        name = f"{source}_height"
        slope = height_slope(profile, streams.odometry, height)
        if slope is None:
            reason = f"{height.name} and the grade have too few blocks of 5 s in common"
            findings.append(not_decidable(name, reason))
            continue
        slopes[source] = slope
        findings.append(_judged(name, height, slope))
    return findings, slopes


def _judged(name: str, height: Stream, slope: HeightSlope) -> Finding:
    about = f"correlation {slope.correlation:.2f}, RMS difference {slope.rms:.2%}; {_level(slope)}"
    evidence = (
        f"rise of {height.name} over {slope.block_s:g} s of driving against that of the grade, "
        "with columns for its level and for a delay of the height"
    )
    if slope.correlation < -MIN_CORRELATION:
        text = f"{height.name} has its sign flipped against the grade: {about}"
        return found(name, text, evidence)
    if slope.correlation < MIN_CORRELATION:
        reason = f"the slope of {height.name} follows the grade too little: {about}"
        return not_decidable(name, reason, evidence)
    unit = unit_of(slope.scale.value, ("ft",)) if slope.scale.value > 0.0 else None
    text = f"the slope of {height.name} is not to the scale of the grade"
    text += f" (it looks like {unit}): ratio" if unit else ": ratio"
    finding = judged(name, slope.scale, 1.0, text, evidence, kind="height_scale", remedy=_REMEDY)
    title = "slope of the height over the grade: " if finding.verdict is Verdict.OK else ""
    return replace(finding, text=f"{title}{finding.text}; {about}")


def _level(slope: HeightSlope) -> str:
    level = slope.level
    text = (
        f"the mean of its slope differs from that of the grade by {level.value:+.1%} "
        f"({level.low:+.1%} to {level.high:+.1%})"
    )
    if abs(level.value) < MATERIAL["road_grade"].size or level.low < 0.0 < level.high:
        return text
    return f"{text}, as an offset of a_x by {-level.value * GRAVITY:.2f} m/s² would make it"


def heights_json(slopes: Mapping[str, HeightSlope]) -> dict[str, dict[str, float]]:
    """Return what heights say of the grade, by their source, for JSON."""
    return {
        source: {
            "scale": x.scale.value,
            "scale_low": x.scale.low,
            "scale_high": x.scale.high,
            "correlation": x.correlation,
            "rms_difference": x.rms,
            "level": x.level.value,
            "level_low": x.level.low,
            "level_high": x.level.high,
            "block_s": x.block_s,
        }
        for source, x in slopes.items()
    }
