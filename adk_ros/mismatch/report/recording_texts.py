# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Places and onsets in one of several recordings, as text."""

from __future__ import annotations

from adk_ros.mismatch.inference.result import IdentifiedEffect, RecordingSpan
from adk_ros.mismatch.report.vocabulary import listed
from adk_ros.mismatch.surrogate.activation import segments_by_route

_JOINT_S = 2.0
"""s around the start of a recording within which an onset is stated as that start."""


def segment_texts(identified: IdentifiedEffect) -> list[str]:
    """
    Return "306 to 617 m" by segment; "1700 m over the start to 60 m" past the lap's end.

    With several routes, the recordings of the route are named.
    """
    routes = routes_of(identified.recordings)
    if len(routes) < 2:
        return _texts(identified.segments, identified.lap_m)
    by_route = segments_by_route(identified.segments, len(routes))
    out = []
    for spans, segments in zip(routes, by_route, strict=True):
        if segments:
            where = listed(_texts(segments, spans[0].lap_m))
            out.append(f"{where} of the route of {listed([span.name for span in spans])}")
    return out


def routes_of(recordings: tuple[RecordingSpan, ...]) -> list[list[RecordingSpan]]:
    """Return the recordings of each route."""
    count = 1 + max((s.route for s in recordings if s.route is not None), default=-1)
    return [[span for span in recordings if span.route == i] for i in range(count)]


def _texts(segments: tuple[tuple[float, float], ...], lap: float | None) -> list[str]:
    parts = []
    within = ((a % lap, b % lap) if lap else (a, b) for a, b in segments)
    for begin, end in sorted(within):
        over = " m over the start" if end < begin else ""
        parts.append(f"{begin:.0f}{over} to {end:.0f} m")
    return parts


def onset_text(identified: IdentifiedEffect) -> str:
    """Return "from 63.2 s on"; with several recordings, in which of them."""
    onset_s = identified.onset_s or 0.0
    for i, span in enumerate(identified.recordings):
        if onset_s < span.begin_s + (_JOINT_S if i > 0 else 0.0):
            return f"from the start of {span.name} on"
        if onset_s < span.end_s - _JOINT_S:
            return f"from {onset_s - span.begin_s:.1f} s of {span.name} on"
    return f"from {onset_s:.1f} s on"
