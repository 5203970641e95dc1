# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Results made by hand, so that a report of each verdict can be written without an analysis."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from adk_ros.mismatch.inference.hypothesis import ActiveEffect
from adk_ros.mismatch.inference.identifiability import CompetingEffect
from adk_ros.mismatch.inference.result import (
    EXPLAINED,
    NONE,
    UNKNOWN,
    IdentifiedEffect,
    Interval,
    MismatchResult,
    ResidualSeries,
    SelectionStep,
    UnexplainedResidual,
)
from adk_ros.mismatch.inference.segments import SpatialProfile
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.recording.sensor_log import CHANNELS
from adk_ros.mismatch.surrogate.feature_terms import FeatureTerm
from adk_ros.mismatch.surrogate.residuals import BIN_S

SECONDS = 120.0
LAP = 600.0
NOISE = np.array([0.02, 0.02, 1e-3, 0.01, 0.01, 1e-3])


def series(missing: str = "") -> ResidualSeries:
    """
    Two laps of an oval; `missing` is the effect in the residuals before correction.

    One of "" (nothing), "drag" (a_x against v_x^2), "bank" (v_y at 100 to 200 m of each lap),
    "late" (yaw rate against the steering rate from 60 s on), "odd" (yaw rate against r / v_x).
    """
    time_s = np.arange(0.5 * BIN_S, SECONDS, BIN_S)
    rng = np.random.default_rng(3)
    v_x = 12.0 + 6.0 * np.sin(0.11 * time_s)
    distance = np.cumsum(v_x) * BIN_S
    distance *= 2.3 * LAP / distance[-1]
    angle = 2.0 * np.pi * distance / LAP
    yaw_rate = 0.15 + 0.1 * np.sin(3.0 * angle)
    delta = 2.6 * yaw_rate / v_x
    signals = {
        "v_x": v_x,
        "v_y": 0.02 * yaw_rate,
        "yaw_rate": yaw_rate,
        "a_x": np.gradient(v_x, BIN_S),
        "a_y": v_x * yaw_rate,
        "torque": 500.0 * np.gradient(v_x, BIN_S),
        "delta": delta,
    }
    after = NOISE[:, None] * rng.standard_normal((6, time_s.size))
    before = after.copy()
    if missing == "drag":
        before[0] -= 5e-4 * v_x**2
    elif missing == "bank":
        before[4] += 0.3 * ((distance % LAP > 100.0) & (distance % LAP < 200.0))
    elif missing == "late":
        before[2] += 0.5 * np.gradient(delta, BIN_S) * (time_s > 60.0)
    elif missing == "odd":
        before[2] += 3.0 * yaw_rate / v_x
    return ResidualSeries(
        time_s,
        95.0 * np.cos(angle),
        60.0 * np.sin(angle),
        signals,
        before,
        after,
        NOISE,
        distance % LAP,
    )


def result_of(missing: str = "", effects: tuple[IdentifiedEffect, ...] = ()) -> MismatchResult:
    """Return a result with the verdict none or explained, for `series`."""
    names = [effect.effect.name for effect in effects]
    return MismatchResult(
        verdict=EXPLAINED if effects else NONE,
        effects=list(effects),
        unexplained=None,
        horizon_s=1.0,
        before={"v_x": 0.145, "v_y": 0.018, "yaw_rate": 0.005},
        after={"v_x": 0.012, "v_y": 0.0044, "yaw_rate": 0.001}
        if effects
        else {"v_x": 0.145, "v_y": 0.018, "yaw_rate": 0.005},
        groups=[[f.effect.name, *f.alternatives] for f in effects if f.alternatives],
        suggestion="; ".join(f.effect.manoeuvre for f in effects if f.alternatives),
        simulation_yaml="model: surrogate\n",
        corrected_yaml="model: surrogate\nterms: []\n",
        series=series(missing),
        surrogate_error=dict.fromkeys(CHANNELS, 1e-3),
        steps=[
            SelectionStep((), 52000.0),
            *([SelectionStep(tuple(names), 16400.0, 35600.0, 9000.0)] if names else []),
        ],
        expected_loss=16000.0,
        lap_m=LAP,
        profiles=[],
        notes=["no <vehicle> & no b"],
    )


def identified(
    name: str = "aero_drag",
    value: float = 0.92,
    low: float = 0.88,
    high: float = 0.97,
    **changes: Any,
) -> IdentifiedEffect:
    """Return an effect with the same interval for each parameter; `changes` replace fields."""
    effect = EFFECTS[name]
    competitor = next(other for other in EFFECTS.values() if other.name != name)
    default = IdentifiedEffect(
        effect,
        {p.name: Interval(value, low, high, p.unit) for p in effect.parameters},
        0.97,
        [],
        "always",
        [[0.0, SECONDS]],
        35600.0,
        (
            CompetingEffect(
                name,
                competitor.name,
                9000.0,
                ActiveEffect(competitor, (1.0,) * len(competitor.parameters)),
                False,
            ),
        ),
    )
    return replace(default, **changes)


def drag() -> MismatchResult:
    """Return air drag, not distinguishable from longitudinal wind."""
    fitted = ActiveEffect(EFFECTS["headwind"], (-4.0,))
    tied = CompetingEffect("aero_drag", "headwind", 3.0, fitted, True)
    lost = CompetingEffect(
        "aero_drag", "payload", 20000.0, ActiveEffect(EFFECTS["payload"], (150.0,)), False
    )
    return result_of("drag", (identified(alternatives=["headwind"], competitors=(tied, lost)),))


def bank() -> MismatchResult:
    """Return a road bank on one segment of the lap."""
    base = result_of(
        "bank",
        (
            identified(
                "road_bank",
                0.102,
                0.1,
                0.104,
                kind="place",
                segments=((100.0, 200.0),),
                time_intervals_s=[[9.0, 17.0], [60.0, 69.0]],
            ),
        ),
    )
    at = (np.arange(60, dtype=np.float64) + 0.5) * LAP / 60
    inside = ((at > 100.0) & (at < 200.0)).astype(np.float64)
    return replace(base, profiles=[SpatialProfile("road_bank", at, 0.1 * inside)])


def late() -> MismatchResult:
    """Return a steering delay that begins in the middle of the recording."""
    return result_of(
        "late",
        (
            identified(
                "steering_delay",
                0.062,
                0.058,
                0.066,
                kind="time",
                onset_s=60.0,
                time_intervals_s=[[60.0, SECONDS]],
            ),
        ),
    )


def odd(*effects: IdentifiedEffect) -> MismatchResult:
    """Return a residual that no effect explains, in addition to `effects`."""
    text = "yaw acceleration against relative wheel-speed difference"
    unexplained = UnexplainedResidual(
        ["yaw_rate"],
        0.41,
        text,
        "d(yaw_rate)/dt += -6.1 r / v_x [rad/s^2]",
        (FeatureTerm("yaw_rate", "yaw_rate_per_speed", -6.1, 900.0),),
    )
    return replace(
        result_of("odd", effects),
        verdict=UNKNOWN,
        unexplained=unexplained,
        after={"v_x": 0.14, "v_y": 0.016, "yaw_rate": 0.001},
    )
