# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Units and signs by consistency: which ones make the channels satisfy the kinematics of a car."""

from __future__ import annotations

from collections.abc import Mapping

from adk_ros.importing.relations import at_grid, common_grid
from adk_ros.importing.sign_choice import choose_signs
from adk_ros.importing.source_channels import SourceChannel
from adk_ros.importing.steering_choice import choose_steering
from adk_ros.importing.unit_choice import Findings, choose_units


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
    choose_units(signals, known, found)
    choose_signs(signals, found)
    if "delta" in signals:
        choose_steering(signals, known, is_hand_wheel, found)
    return found
