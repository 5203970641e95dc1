# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Convert stored bytes to message objects, or to the CDR bytes of a ROS 2 message."""

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
    """A message type is defined neither in the bag nor in ROS 2, or its encoding is not CDR."""


def deserialiser(channel: Channel) -> Decoder:
    """
    Return a function that converts a channel's bytes to messages.

    :raises NoTypeError: the type or the encoding of the channel is unknown.
    """
    ros1, msgtype = channel.encoding == "ros1", channel.msgtype
    store = _store_of(channel, "none" if ros1 else "all")
    if ros1:
        return lambda data: store.deserialize_ros1(data, msgtype)

    def decode(data: bytes) -> Any:
        data = _decompressed(data)
        try:
            return store.deserialize_cdr(data, msgtype)
        except SerdeError:
            # rclpy's serialize_message appends 4 bytes to a trailing empty sequence of doubles.
            return store.deserialize_cdr(data[:-4], msgtype)

    return decode


def to_cdr(channel: Channel) -> Decoder:
    """Return a function that converts a channel's bytes to CDR; errors as in `deserialiser`."""
    if channel.encoding == "ros1":
        store = _store_of(channel, "header")
        return lambda data: bytes(store.ros1_to_cdr(data, channel.msgtype))
    return _decompressed


def _decompressed(data: bytes) -> bytes:
    """Return the bytes of a message, which rosbag2 may have compressed individually."""
    return inflate("zstd", data) if data[:4] == ZSTD_MAGIC else bytes(data)


def _store_of(channel: Channel, fallback: str) -> Typestore:
    if channel.encoding not in {"cdr", "ros1"}:
        raise NoTypeError(f"{channel.topic} is encoded as {channel.encoding!r}, not CDR")
    store = typestore(channel.msgtype, channel.definition, channel.definition_format, fallback)
    if store is None:
        raise NoTypeError(f"{channel.topic}: type {channel.msgtype} is not defined in the bag")
    return store
