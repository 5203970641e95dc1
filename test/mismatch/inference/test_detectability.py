# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Detectable sizes on a generated drive."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from helpers.mismatch import case

from adk_ros.mismatch.inference.detectability import NOISE, TOLERANCE, Drive
from adk_ros.mismatch.inference.detectable_sizes import (
    DetectableSize,
    active_effect,
    detectable_sizes,
)
from adk_ros.mismatch.inference.hypothesis import ActiveEffect
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.planned_drive import is_detectable, planned_drive, typical_noise
from adk_ros.mismatch.simulator import surrogate_of
from adk_ros.mismatch.surrogate.identification import SurrogateModel

_CHEAP = ("aero_drag", "payload", "imu_lever_arm")


@cache
def _drive(factor: float = 1.0) -> Drive:
    c = case()
    surrogate = None if factor == 1.0 else _surrogate()
    return planned_drive(c.simulation, c.nominal, factor * typical_noise(), surrogate)


def _surrogate() -> SurrogateModel:
    c = case()
    return surrogate_of(c.simulation, c.simulation, c.nominal, lambda done, text: None)[0]


@cache
def _table() -> dict[tuple[str, str, float], DetectableSize]:
    others = frozenset(set(EFFECTS) - set(_CHEAP))
    found = detectable_sizes(_drive(), (2.0, 30.0), others)
    return {(x.effect, x.parameter, x.minutes): x for x in found}


@pytest.mark.slow
def test_an_effect_above_its_size_is_detectable_and_one_below_is_not() -> None:
    for (effect, parameter, minutes), row in _table().items():
        neutral = next(p.neutral for p in EFFECTS[effect].parameters if p.name == parameter)
        for factor, expected in ((2.0, True), (0.4, False)):
            values = {parameter: neutral + factor * row.size}
            assert is_detectable(_drive(), effect, values, minutes) == expected, (effect, factor)


@pytest.mark.slow
def test_driving_longer_reveals_smaller_effects_where_noise_limits() -> None:
    table = _table()
    short, long = (table["imu_lever_arm", "x", minutes] for minutes in (2.0, 30.0))
    assert long.size < short.size
    assert long.alone[NOISE] < 0.5 * short.alone[NOISE]


@pytest.mark.slow
def test_a_payload_is_limited_by_build_tolerance() -> None:
    row = _table()["payload", "mass", 30.0]
    assert row.limit == TOLERANCE
    assert row.size > EFFECTS["payload"].parameters[0].materiality_threshold


@pytest.mark.slow
def test_more_noise_hides_more() -> None:
    drives = [_drive(), _drive(4.0)]
    noise = [drive.partial[NOISE] for drive in drives]
    column = [
        drive.columns([model], _arm())[0] for drive, model in zip(drives, noise, strict=True)
    ]
    reached = [m.non_centrality(c, 1.0) for m, c in zip(noise, column, strict=True)]
    assert reached[1] == pytest.approx(reached[0] / 16.0, rel=0.3)
    assert np.isfinite(reached).all()


def _arm() -> ActiveEffect:
    return active_effect(EFFECTS["imu_lever_arm"], {"x": 0.3}, None)
