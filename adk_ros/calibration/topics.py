# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The topics of a bag to check: every role is optional, and of several the fullest is taken."""

from __future__ import annotations

from adk_ros.bags import COMMAND_TYPES, Bag
from adk_ros.bags.recording import RecordingOptions
from adk_ros.errors import UsageError


def optional_topic(
    bag: Bag,
    role: str,
    name: str | None,
    msgtype: str,
    notes: list[str],
    steer_joint: str | None = None,
) -> str | None:
    """Return the topic of a role: the named one, else the only or the fullest one of its type."""
    if name == "":
        return None
    if name is not None:
        if not any(x.name == name and x.msgtype == msgtype and x.count for x in bag.topics):
            raise UsageError(
                f"bag {bag.path} has no topic {name} (--{role}) of type {msgtype} with messages; "
                f"it has {bag.summary()}"
            )
        return name
    matching = [x for x in bag.topics if x.msgtype == msgtype and x.count]
    if steer_joint is not None and len(matching) > 1:
        # Wheel speeds are JointState as well: the command is the one with the steering.
        matching = [x for x in matching if steer_joint in _joints(bag, x.name)] or matching
    matching.sort(key=lambda x: (-x.count, x.name))
    if len(matching) > 1:
        notes.append(
            f"{len(matching)} topics are of type {msgtype}: {matching[0].name} is checked, which "
            f"has most messages; choose another with --{role}"
        )
    return matching[0].name if matching else None


def _joints(bag: Bag, topic: str) -> list[str]:
    """Return the joints in a topic's first message."""
    first = next((msg for _, _, msg in bag.messages([topic])), None)
    return [str(name) for name in getattr(first, "name", [])]


def command_topic(bag: Bag, options: RecordingOptions, notes: list[str]) -> tuple[str | None, str]:
    """Return the command's topic and type: the configured type first, then any other."""
    configured = options.sensors.command_type
    kinds = [configured, *(kind for kind in COMMAND_TYPES if kind != configured)]
    for kind in kinds:
        if options.command is not None and not any(
            x.name == options.command and x.msgtype == COMMAND_TYPES[kind] for x in bag.topics
        ):
            continue
        joint = options.sensors.steer_joint if kind == "joint_state" else None
        topic = optional_topic(bag, "command", options.command, COMMAND_TYPES[kind], notes, joint)
        if topic is not None:
            return topic, kind
    if options.command:
        optional_topic(bag, "command", options.command, COMMAND_TYPES[configured], notes)
    return None, ""
