# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From a channel's stored bytes to messages, or to the CDR bytes of a ROS 2 message."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rosbags.serde.errors import SerdeError
from rosbags.typesys.store import Typestore

from adk_ros.bags.compression import ZSTD_MAGIC, inflate
from adk_ros.bags.storage import Channel
from adk_ros.bags.typestores import typestore

Decoder = Callable[[bytes], Any]


class NoTypeError(Exception):
    """A message type is neither defined in the bag nor a common one, or it is not CDR."""


def deserialiser(channel: Channel) -> Decoder:
    """
    Return what makes messages of a channel's bytes.

    Raises:
        NoTypeError: the type is not known, or the channel's encoding is not.
    """
    ros1, msgtype = channel.encoding == "ros1", channel.msgtype
    store = _store_of(channel, "none" if ros1 else "all")
    if ros1:
        return lambda data: store.deserialize_ros1(data, msgtype)

    def decode(data: bytes) -> Any:
        data = _unpacked(data)
        try:
            return store.deserialize_cdr(data, msgtype)
        except SerdeError:
            # rclpy's serialize_message adds 4 bytes after a trailing empty sequence of doubles.
            return store.deserialize_cdr(data[:-4], msgtype)

    return decode


def to_cdr(channel: Channel) -> Decoder:
    """Return what makes CDR of a channel's bytes; raises as `deserialiser` does."""
    if channel.encoding == "ros1":
        store = _store_of(channel, "header")
        return lambda data: bytes(store.ros1_to_cdr(data, channel.msgtype))
    return _unpacked


def _unpacked(data: bytes) -> bytes:
    """Return a message's bytes: rosbag2 can compress them one by one."""
    return inflate("zstd", data) if data[:4] == ZSTD_MAGIC else bytes(data)


def _store_of(channel: Channel, known: str) -> Typestore:
    if channel.encoding not in {"cdr", "ros1"}:
        raise NoTypeError(f"{channel.topic} is encoded as {channel.encoding!r}, not CDR")
    store = typestore(channel.msgtype, channel.definition, channel.definition_format, known)
    if store is None:
        raise NoTypeError(f"{channel.topic}: type {channel.msgtype} is not defined in the bag")
    return store
