# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What to say about a topic that nobody publishes: which topics of its type there are."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence

from adk_ros.signals.channels import Source


def waiting_hint(
    missing: Mapping[Source, tuple[str, str]], published: Sequence[tuple[str, Sequence[str]]]
) -> str:
    """
    Return one line on topics without a message.

    :param missing: full name and message type of the topic, by source. :param published: names and
        types of the topics that have a publisher.
    """
    parts = []
    for source, (topic, msgtype) in missing.items():
        name = source.name.lower()
        others = [other for other, types in published if msgtype in types and other != topic]
        if any(other == topic for other, _ in published):
            parts.append(f"{name}: {topic} is published but sends nothing that arrives")
        elif others:
            (closest,) = difflib.get_close_matches(topic, others, 1, 0.0)
            parts.append(f"{name}: nobody publishes {topic}; did you mean -r {name}:={closest}?")
        else:
            parts.append(f"{name}: nobody publishes {topic} or any other {msgtype}")
    return "waiting for " + "; ".join(parts)
