# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A map from the pedals to a wheel torque, for a recording that has no torque, as a finding."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from adk_ros.calibration.criteria import MIN_CORRELATION
from adk_ros.calibration.finding import Finding, Verdict, not_decidable
from adk_ros.calibration.grid import Signals
from adk_ros.calibration.informative import MAX_PEDAL, implied_length_scale
from adk_ros.calibration.pedal_map import ForceTable, PedalMap, PedalSamples, fit_pedals
from adk_ros.calibration.regression import Estimate
from adk_ros.calibration.streams import Stream, Streams
from adk_ros.numerics.arrays import FloatArray

_NAME = "pedal_map"
_BRAKES = ("brake_pressure", "brake_pedal")
"""Channels of the brake, the one that says more first."""


def check_pedals(
    s: Signals,
    streams: Streams,
    mass: float | None,
    wheel_radius: float | None,
    length_scale: float | None = None,
) -> Iterator[Finding]:
    """
    Yield the map of the pedals, if there are pedals and no torque.

    `length_scale`: of the vehicle; None: that which steering and curvature imply.
    """
    if length_scale is None:
        length_scale = implied_length_scale(streams.odometry, streams.command, streams.imu)
    is_combined = s.torque is not None and float(np.abs(s.torque).max()) <= MAX_PEDAL
    is_combined = is_combined and length_scale == 1.0
    if s.torque is not None and not is_combined:
        return
    pedals = dict(streams.pedals)
    brake_name = next((name for name in _BRAKES if _varies(pedals.get(name))), "")
    throttle = _held(s, pedals.get("throttle"))
    brake = _held(s, pedals.get(brake_name))
    if throttle is None and brake is None and is_combined and s.torque is not None:
        throttle, brake_name = np.maximum(s.torque, 0.0), _BRAKES[1]
        brake = np.maximum(-s.torque, 0.0) if float(s.torque.min()) < 0.0 else None
    if throttle is None and brake is None:
        return
    if mass is None or wheel_radius is None:
        yield not_decidable(_NAME, "a force needs mass and wheel radius: give --vehicle")
        return
    if s.v_x is None or s.longitudinal is None:
        yield not_decidable(_NAME, "it needs a speed")
        return
    has_imu = s.a is not None and float(np.ptp(s.a[0])) > 0.0
    acceleration = s.a[0] if s.a is not None and has_imu else s.longitudinal
    gear = _held(s, pedals.get("gear"))
    # Backwards, the pedals act the other way.
    weights = s.moving * (s.v_x > 0.0)
    fit = fit_pedals(PedalSamples(mass * acceleration, s.v_x, weights, throttle, brake, gear))
    sensed = "mass times a_x" if has_imu else "mass times dv_x/dt, on a level road"
    evidence = (
        f"non-negative least squares of {sensed} ({mass:g} kg) on monotone functions of the "
        "pedals, v_x² and a constant; blocks of 5 s left out"
    )
    if fit is None:
        yield not_decidable(_NAME, "there is too little driving", evidence)
        return
    if fit.r_squared < MIN_CORRELATION**2:
        reason = (
            f"the pedals explain {100.0 * max(fit.r_squared, 0.0):.0f} % of the force on "
            "stretches that were left out (slope without an IMU, gears that are not recorded, "
            "another pedal)"
        )
        yield not_decidable(_NAME, reason, evidence)
        return
    yield _finding(fit, brake_name, wheel_radius, is_combined, evidence)


def _finding(
    fit: PedalMap, brake_name: str, wheel_radius: float, is_combined: bool, evidence: str
) -> Finding:
    parts = []
    for title, force in (("full throttle", fit.full_throttle), ("full brake", fit.full_brake)):
        if force is not None:
            parts.append(f"{title} {_force_text(force)}")
    explained = f"{100.0 * fit.r_squared:.0f} %"
    text = (
        f"the recording has no torque, and pedals that explain {explained} of the force on "
        f"stretches that were left out: {', '.join(parts)}, {fit.delay_s:.1f} s after the pedal; "
        "an error of the mass scales it, and engine braking counts as resistance"
    )
    columns = "throttle" if fit.brake is None else f"throttle and {brake_name}"
    if is_combined:
        columns += " (both of the command's column, the latter with sign -1)"
    remedy = (
        f"import again with {columns} in the map and computed: {{torque: "
        f"{map_entry(fit, brake_name, wheel_radius)}}}; use it to predict, it says nothing about "
        "longitudinal physics"
    )
    force = fit.full_throttle or fit.full_brake
    assert force is not None
    return Finding(
        _NAME,
        Verdict.FINDING,
        text,
        round(force.value, 1),
        round(force.low, 1),
        round(force.high, 1),
        "N",
        evidence=evidence,
        seconds=fit.seconds,
        remedy=remedy,
    )


def map_entry(fit: PedalMap, brake_name: str, wheel_radius: float) -> str:
    """Return the entry of a map of `adk import` as YAML in one line."""
    parts = ["from: pedals", f"wheel_radius: {wheel_radius:g}"]
    for name, table in (("throttle", fit.throttle), (brake_name, fit.brake)):
        if table is not None:
            parts.append(f"{name}: {_table_text(table)}")
    return "{" + ", ".join(parts) + "}"


def _table_text(table: ForceTable) -> str:
    rows = [_numbers(row, ".0f") for row in table.force]
    force = rows[0] if table.at is None else f"[{', '.join(rows)}]"
    at = "" if table.at is None else f"{table.by}: {_four_digits(table.at)}, "
    return f"{{pedal: {_four_digits(table.pedal)}, {at}force: {force}}}"


def _four_digits(values: FloatArray) -> str:
    """Return values without an exponent: YAML takes `4e+06` for a text."""
    rounded = [float(f"{value:.4g}") + 0.0 for value in values]
    return f"[{', '.join(np.format_float_positional(x, trim='-') for x in rounded)}]"


def _numbers(values: FloatArray, form: str) -> str:
    return "[" + ", ".join(f"{value + 0.0:{form}}" for value in values) + "]"


def _force_text(force: Estimate) -> str:
    return f"{force.value:.0f} N ({force.low:.0f} to {force.high:.0f})"


def _varies(stream: Stream | None) -> bool:
    return stream is not None and stream.has("value")


def _held(s: Signals, stream: Stream | None) -> FloatArray | None:
    """Return the values (n,) on the grid, each held until the next; None if they do not vary."""
    if stream is None or not _varies(stream):
        return None
    latest = np.searchsorted(stream.at_s, s.at_s, side="right") - 1
    return stream["value"][np.maximum(latest, 0)]
