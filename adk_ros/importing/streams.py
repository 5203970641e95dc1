# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Join channels to messages.

Channels of one message that share their stamps are stored at these. Otherwise the message has the
stamps of its leading channel, and the others are interpolated there: linearly, commands by
zero-order hold. Nothing else is resampled. In a gap of a channel that all messages need, there is
no message; one that is optional, such as a position, takes no message with it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from adk_ros.importing.source_channels import SourceChannel
from adk_ros.numerics.arrays import BoolArray, FloatArray, IntArray

_MAX_GAP_NS = 150_000_000
"""ns; gaps up to this length, or `_MAX_GAP_PERIODS`, are interpolated, as in `signals.record`."""
_MAX_GAP_PERIODS = 2.5
_MIN_COMPLETE = 0.75
"""
Share of rows with all channels from which on the others are defects: half as many is a channel of
half the rate.
"""
_CIRCULAR = ("heading", "gps_course", "roll", "pitch")


@dataclass(frozen=True)
class MessageStream:
    """
    Values (n,) of each channel of a message at its stamps (n,), ns, ascending strictly.

    `unknown` (n,): by the name of an optional channel, where it is in a gap; its value there is
    interpolated over the gap.
    """

    stamp_ns: IntArray
    values: Mapping[str, FloatArray]
    unknown: Mapping[str, BoolArray] = field(default_factory=dict)

    def __len__(self) -> int:
        return int(self.stamp_ns.shape[0])


def joined(
    name: str, channels: Sequence[SourceChannel], notes: list[str], hold: bool = False
) -> MessageStream:
    """
    Return the stream of a message with these channels, the leading one first.

    :param name: of the message, for the lines that say what was lost or interpolated.
    :param hold: hold the last value instead of interpolating.
    """
    stamps = [channel.stamp_ns for channel in channels]
    everywhere = stamps[0]
    for others in stamps[1:]:
        everywhere = np.intersect1d(everywhere, others, assume_unique=True)
    one_table = len({channel.table for channel in channels}) == 1
    most = max(each.shape[0] for each in stamps)
    if everywhere.shape[0] == most or (one_table and everywhere.shape[0] >= _MIN_COMPLETE * most):
        if lost := np.unique(np.concatenate(stamps)).shape[0] - everywhere.shape[0]:
            names = ", ".join(channel.name for channel in channels)
            notes.append(f"{name}: {lost} rows lack one of {names}: skipped")
        values = {
            channel.name: channel.values[np.searchsorted(channel.stamp_ns, everywhere)]
            for channel in channels
        }
        return MessageStream(everywhere, values)
    return _resampled(name, channels, notes, hold)


def _resampled(
    name: str, channels: Sequence[SourceChannel], notes: list[str], hold: bool
) -> MessageStream:
    lead = channels[0]
    values = {lead.name: lead.values}
    known = np.ones(lead.stamp_ns.shape[0], dtype=bool)
    for channel in channels[1:]:
        if np.array_equal(channel.stamp_ns, lead.stamp_ns):
            values[channel.name] = channel.values
            continue
        at, inside = _at(channel, lead.stamp_ns, hold)
        values[channel.name] = at
        known &= inside
        how = "held" if hold else "interpolated"
        notes.append(
            f"{name}: {channel.name} ({rate_text(channel.stamp_ns)}) is {how} at the stamps of "
            f"{lead.name} ({rate_text(lead.stamp_ns)})"
        )
    if lost := int((~known).sum()):
        notes.append(f"{name}: {lost} of {known.shape[0]} stamps lie in gaps: skipped")
    return MessageStream(
        lead.stamp_ns[known], {key: column[known] for key, column in values.items()}
    )


def with_optional(
    name: str,
    stream: MessageStream,
    channels: Sequence[SourceChannel],
    lead: str,
    notes: list[str],
) -> MessageStream:
    """
    Return the stream with further channels at its stamps, without which messages are complete.

    In their gaps they are interpolated, and `unknown`. Before the first and after the last value
    of one there is no message: not every reader looks at the mark, and a position that is held
    while the car moves is worse than none.

    :param name: of the message, and `lead` of the channel with its stamps, for the lines.
    """
    stream = _within(name, stream, channels, notes)
    values, unknown = dict(stream.values), dict(stream.unknown)
    for channel in channels:
        if np.isin(stream.stamp_ns, channel.stamp_ns).all():
            rows = np.searchsorted(channel.stamp_ns, stream.stamp_ns)
            values[channel.name] = channel.values[rows]
            continue
        values[channel.name], known = at_stamps(name, channel, stream.stamp_ns, lead, notes)
        if known.all():
            continue
        unknown[channel.name] = ~known
        notes.append(
            f"{name}: {channel.name} is missing at {int((~known).sum())} of {len(stream)} stamps, "
            "in gaps: marked as not measured there"
        )
    return replace(stream, values=values, unknown=unknown)


def _within(
    name: str, stream: MessageStream, channels: Sequence[SourceChannel], notes: list[str]
) -> MessageStream:
    """Return the part of a stream in which each of `channels` has begun and has not ended."""
    stamps = stream.stamp_ns
    inside = np.ones(len(stream), dtype=bool)
    for channel in channels:
        inside &= (stamps >= channel.stamp_ns[0]) & (stamps <= channel.stamp_ns[-1])
    if inside.all():
        return stream
    names = ", ".join(channel.name for channel in channels)
    notes.append(
        f"{name}: {int((~inside).sum())} of {len(stream)} stamps are before the first or after "
        f"the last value of {names}: skipped"
    )
    return replace(
        stream,
        stamp_ns=stamps[inside],
        values={key: value[inside] for key, value in stream.values.items()},
        unknown={key: value[inside] for key, value in stream.unknown.items()},
    )


def at_stamps(
    name: str, channel: SourceChannel, stamp_ns: IntArray, lead: str, notes: list[str]
) -> tuple[FloatArray, BoolArray]:
    """Return a channel interpolated at stamps (n,), and where it is known (n,); it is noted."""
    if not np.array_equal(channel.stamp_ns, stamp_ns):
        notes.append(
            f"{name}: {channel.name} ({rate_text(channel.stamp_ns)}) is interpolated at the "
            f"stamps of {lead} ({rate_text(stamp_ns)})"
        )
    return _at(channel, stamp_ns, hold=False)


def _at(channel: SourceChannel, at_ns: IntArray, hold: bool) -> tuple[FloatArray, BoolArray]:
    stamps = channel.stamp_ns
    before = np.searchsorted(stamps, at_ns, side="right") - 1
    left = np.maximum(before, 0)
    if hold or stamps.shape[0] < 2:
        return channel.values[left], before >= 0 if hold else stamps[left] == at_ns
    right = np.minimum(left + 1, stamps.shape[0] - 1)
    source = np.unwrap(channel.values) if channel.name in _CIRCULAR else channel.values
    gap = (stamps[right] - stamps[left]).astype(np.float64)
    share = (at_ns - stamps[left]) / np.maximum(gap, 1.0)
    values = source[left] + share * (source[right] - source[left])
    longest = longest_gap_ns(stamps)
    exact = stamps[left] == at_ns
    inside = exact | ((before >= 0) & (at_ns <= stamps[-1]) & (gap <= longest))
    return np.where(exact, source[left], values), inside


def longest_gap_ns(stamp_ns: IntArray) -> float:
    """Return the longest time between stamps over which values are interpolated, ns."""
    return max(_MAX_GAP_NS, _MAX_GAP_PERIODS * float(np.median(np.diff(stamp_ns))))


def rate_hz(stamp_ns: IntArray) -> float:
    """Return the median rate of stamps, Hz; 0 of fewer than two."""
    if stamp_ns.shape[0] < 2:
        return 0.0
    return float(1e9 / np.median(np.diff(stamp_ns)))


def rate_text(stamp_ns: IntArray) -> str:
    """Return the rate of stamps as text."""
    return f"{rate_hz(stamp_ns):.4g} Hz"
