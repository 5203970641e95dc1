# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Options for a bag without any command topic, which is read without commands."""

from __future__ import annotations

import math
from dataclasses import replace

from adk_ros.bags import COMMAND_TYPES, Bag
from adk_ros.bags.recording import RecordingOptions
from adk_ros.importing.column_names import wheel_position


def with_absent_command(bag: Bag, options: RecordingOptions) -> RecordingOptions:
    """
    Return options that read no command, where a bag has no topic that could be one.

    Unchanged where the options name a topic, or where the bag has messages of any type of command:
    one of another type than the configured one is refused, as its values must not be lost
    unnoticed. Joint states of wheels alone, without efforts, are no command.
    """
    types = set(COMMAND_TYPES.values())
    candidates = [x for x in bag.topics if x.msgtype in types and x.count]
    if options.command is not None or not all(
        x.msgtype == COMMAND_TYPES["joint_state"] and _are_wheels(bag, x.name) for x in candidates
    ):
        return options
    return replace(options, command="")


def _are_wheels(bag: Bag, topic: str) -> bool:
    """Whether the first message of a topic has the speeds of wheels and nothing else."""
    first = next((msg for _, _, msg in bag.messages([topic])), None)
    joints = list(getattr(first, "name", ()))
    drives = any(math.isfinite(x) and x != 0.0 for x in getattr(first, "effort", ()))
    return bool(joints) and not drives and all(wheel_position(str(x)) for x in joints)
