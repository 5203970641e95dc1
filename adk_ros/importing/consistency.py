# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Units and signs by consistency: which ones make the channels satisfy the kinematics of a car."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from adk_ros.importing.relations import at_grid, common_grid
from adk_ros.importing.sign_choice import choose_signs
from adk_ros.importing.source_channels import SourceChannel
from adk_ros.importing.steering_choice import choose_steering
from adk_ros.importing.unit_choice import Findings, choose_units

_MAX_RADIANS, _MAX_DEGREES = 7.0, 361.0
"""Largest angle in rad and in degrees, of a heading that is not counted over several turns."""


def find_consistent_units(
    channels: Mapping[str, SourceChannel], known: Mapping[str, str], is_hand_wheel: bool | None
) -> Findings:
    """
    Return the units and signs that make raw channels consistent.

    :param channels: raw values by channel.
    :param known: units that the files state, by channel; these are not questioned.
    :param is_hand_wheel: whether the name of `delta` says so; None: it says nothing.
    """
    grid = common_grid(channels)
    found = Findings()
    if grid is None:
        return found
    signals = {name: at_grid(channel, grid) for name, channel in channels.items()}
    stated = dict(known)
    if "heading" in channels and "heading" not in known:
        # By its range before it is unwrapped: relations see only its ratio to the yaw rate.
        size = float(np.abs(channels["heading"].values).max())
        stated["heading"] = found.units["heading"] = "rad" if size < _MAX_RADIANS else "deg"
        found.reasons["heading"] = f"range of the values, up to {size:.3g}"
        if size < _MAX_DEGREES:
            found.certain.add("heading")
    choose_units(signals, stated, found)
    choose_signs(signals, found)
    if "delta" in signals:
        choose_steering(signals, known, is_hand_wheel, found)
    return found
