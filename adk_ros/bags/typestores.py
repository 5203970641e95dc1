# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Message types: those of ROS 2 Jazzy, and those that a bag defines.

Each type of a bag gets a separate store, so that two types with the same name, or a type whose
definition cannot be parsed, do not affect each other.
"""

from __future__ import annotations

import re
from contextlib import suppress
from functools import lru_cache

from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import FieldDesc, Typesdict
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from adk_ros.bags.storage import ros2_type

_HEADER = "std_msgs/msg/Header"


@lru_cache(maxsize=1)
def jazzy() -> Typestore:
    """Return the store of the common interfaces of ROS 2 Jazzy and of the added types."""
    return get_typestore(Stores.ROS2_JAZZY)


def add_type(msgtype: str, definition: str) -> None:
    """
    Make a type that ROS 2's common interfaces lack available to `message` and `BagWriter`.

    `definition` is the text of its .msg file, with those of the types it uses appended as in
    rosbag2: a line of 80 `=`, then `MSG: pkg/Type`, then the text.
    """
    jazzy().register(get_types_from_msg(definition, msgtype))
    typestore.cache_clear()


@lru_cache(maxsize=256)
def typestore(
    msgtype: str, definition: str, definition_format: str, fallback: str
) -> Typestore | None:
    """
    Return a store with one type by its definition, or None if the type is unknown.

    `fallback` names the types that replace missing definitions: "all" of Jazzy's types, only its
    "header" (which replaces the ROS 1 header with its sequence number), or "none" except the
    built-in time and duration.
    """
    common = (jazzy() if fallback == "all" else get_typestore(Stores.EMPTY)).fielddefs
    types: Typesdict = {}
    # Untrusted definition: any exception of the parser means an unknown type.
    with suppress(Exception):
        if "idl" in definition_format:
            types = _types_from_idl(definition)
        elif definition.strip():
            types = get_types_from_msg(definition, msgtype)
    if fallback == "header":
        types[_HEADER] = jazzy().fielddefs[_HEADER]
    for defined in (types, {}):
        needed: Typesdict = {}
        pending = [msgtype]
        with suppress(Exception):
            while pending:
                name = pending.pop()
                if name not in needed:
                    needed[name] = defined[name] if name in defined else common[name]
                    pending += _nested(needed[name][1])
            store = get_typestore(Stores.EMPTY)
            store.register(needed)
            store.get_msgdef(msgtype)
            return store
    return None


def _types_from_idl(definition: str) -> Typesdict:
    types: Typesdict = {}
    for part in definition.split("=" * 80 + "\n"):
        head, _, text = part.partition("\n")
        if head.startswith("MSG: "):
            types.update(get_types_from_msg(text, ros2_type(head[5:].strip())))
        elif part.strip():
            text = text if head.startswith("IDL: ") else part
            # Each type has its part of the text; rosbags does not support `#include`.
            types.update(get_types_from_idl(re.sub(r"(?m)^\s*#.*$", "", text)))
    return types


def _nested(fields: list[tuple[str, FieldDesc]]) -> list[str]:
    inner = [x[1][0] if x[0] in {Nodetype.ARRAY, Nodetype.SEQUENCE} else x for _, x in fields]
    return [str(x[1]) for x in inner if x[0] == Nodetype.NAME]
