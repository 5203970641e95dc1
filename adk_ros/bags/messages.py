# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Create ROS 2 messages without ROS, from given fields and defaults."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import FieldDesc

from adk_ros.bags.typestores import jazzy


def message(msgtype: str, **fields: Any) -> Any:
    """
    Return a message of a ROS 2 type; omitted fields are zero or empty.

    A nested message may be given as a mapping, a `builtin_interfaces/msg/Time` as integer
    nanoseconds, and an array as any sequence of numbers. Quaternions default to the identity.

    :raises TypeError: the type is unknown, or has no such field.
    """
    store = jazzy()
    if msgtype not in store.types:
        raise TypeError(f"message type {msgtype} is unknown")
    if msgtype == "geometry_msgs/msg/Quaternion":
        fields = {"w": 1.0, **fields}
    values = {
        name: _field(desc, fields.pop(name)) if name in fields else _field(desc)
        for name, desc in store.fielddefs[msgtype][1]
    }
    if fields:
        raise TypeError(f"{msgtype} has no field {', '.join(fields)}")
    return store.types[msgtype](**values)


def _field(desc: FieldDesc, value: Any = None) -> Any:
    """Return the value of a field in the form that rosbags serialises; None: the default."""
    if desc[0] == Nodetype.NAME:
        if value is None or isinstance(value, Mapping):
            return message(str(desc[1]), **(value or {}))
        if desc[1] == "builtin_interfaces/msg/Time" and isinstance(value, int | np.integer):
            return message(desc[1], sec=int(value // 10**9), nanosec=int(value % 10**9))
        return value
    if desc[0] == Nodetype.BASE:
        kind = desc[1][0]
        default = "" if "string" in kind else False if kind == "bool" else 0
        value = default if value is None else value
        return float(value) if "float" in kind else value
    (subkind, sub), length = desc[1]
    count = length if desc[0] == Nodetype.ARRAY else 0
    if subkind == Nodetype.NAME or "string" in sub[0]:
        item: Any = (subkind, sub)
        return [_field(item, x) for x in ([None] * count if value is None else value)]
    dtype = np.dtype({"char": "uint8"}.get(sub[0], sub[0]))
    return np.zeros(count, dtype) if value is None else np.asarray(value, dtype)
