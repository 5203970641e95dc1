# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Message types: those of ROS 2 Jazzy, and each of a bag's as the bag defines it.

A bag's type gets a store of its own, so that two topics whose types share a name, or one whose
definition is beyond understanding, do not get in each other's way.
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
    """Return the store of ROS 2 Jazzy's common interfaces, with what `add_type` has added."""
    return get_typestore(Stores.ROS2_JAZZY)


def add_type(msgtype: str, definition: str) -> None:
    """
    Teach `message` and `BagWriter` a type that ROS 2's common interfaces lack.

    `definition` is the text of its .msg file, with those of the types it uses appended as in
    rosbag2: a line of 80 `=`, then `MSG: pkg/Type`, then the text.
    """
    jazzy().register(get_types_from_msg(definition, msgtype))
    typestore.cache_clear()


@lru_cache(maxsize=256)
def typestore(
    msgtype: str, definition: str, definition_format: str, known: str
) -> Typestore | None:
    """
    Return a store with one type as its definition has it, or None where that is unknown.

    `known` says what may fill in for a definition that is missing: "all" of Jazzy's types, only
    its "header", which is to replace that of ROS 1 with its sequence number, or "none" of them
    but the time and the duration that are built in.
    """
    common = (jazzy() if known == "all" else get_typestore(Stores.EMPTY)).fielddefs
    types: Typesdict = {}
    # A definition comes from outside: whatever its text makes the parser do, it is "unknown".
    with suppress(Exception):
        if "idl" in definition_format:
            types = _types_from_idl(definition)
        elif definition.strip():
            types = get_types_from_msg(definition, msgtype)
    if known == "header":
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
            # Every type has its part; rosbags does not know how to go by `#include`.
            types.update(get_types_from_idl(re.sub(r"(?m)^\s*#.*$", "", text)))
    return types


def _nested(fields: list[tuple[str, FieldDesc]]) -> list[str]:
    inner = [x[1][0] if x[0] in {Nodetype.ARRAY, Nodetype.SEQUENCE} else x for _, x in fields]
    return [str(x[1]) for x in inner if x[0] == Nodetype.NAME]
