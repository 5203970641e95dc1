# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Recognise channels by the names that loggers give their columns, in English and German."""

from __future__ import annotations

import re
from functools import lru_cache
from typing import NamedTuple

from adk_ros.importing.channels import CHANNELS
from adk_ros.importing.units import is_unit_of

TIME = "time"


class ColumnName(NamedTuple):
    """
    What the name of a column says.

    `channel`: name of the channel, `TIME`, or empty. `quality`: 3 the channel's own name, 2 the
    whole name is known, 1 a part of it. `unit`: as given in the name, empty if it is not.
    """

    channel: str
    quality: int
    unit: str


_UNIT_IN_BRACKETS = re.compile(r"[\[({<]\s*([^\])}>]*?)\s*[\])}>]\s*$")
_UNIT_AT_END = {
    "kmh": "km/h", "kph": "km/h", "km_h": "km/h", "mph": "mph", "mps": "m/s", "m_s": "m/s",
    "mps2": "m/s^2", "mpss": "m/s^2", "m_s2": "m/s^2", "ms2": "m/s^2", "deg_s": "deg/s",
    "degs": "deg/s", "degps": "deg/s", "dps": "deg/s", "deg_per_s": "deg/s", "rad_s": "rad/s",
    "rads": "rad/s", "radps": "rad/s", "deg": "deg", "rad": "rad", "nm": "N m", "knm": "kN m",
    "bar": "bar", "kpa": "kPa", "rpm": "rpm", "pct": "%", "percent": "%", "g": "g",
}  # fmt: skip
"""Ending of a name -> unit."""

_TIME_AT_END = {"ns": "ns", "us": "us", "ms": "ms", "s": "s", "sec": "s", "seconds": "s"}

_LONG = r"(?:long(?:itudinal)?|lon|laengs|langs|fwd|forward)"
_LAT = r"(?:lat(?:eral)?|quer|side)"
_VERT = r"(?:vert(?:ical)?|hoch)"
_ACC = r"(?:acc(?:el(?:eration)?)?|beschl(?:eunigung)?|a|force)"
_VEL = r"(?:vel(?:ocity)?|speed|spd|geschw(?:indigkeit)?|v)"
_CAR = r"(?:veh(?:icle)?|car|fzg|fahrzeug|ego|ist)"
_STEER = r"(?:steer(?:ing)?|str|strg|lenk)"
_WHEEL_WORD = r"(?:wheel|whl|rad)"
_WHEEL_QUANTITY = r"(?:speed|spd|drehzahl|geschw(?:indigkeit)?|vel(?:ocity)?|omega|n|v|rpm)"
_POSITIONS = {
    "front_left": r"(?:fl|lf|vl|front_?left|left_?front|vorne?_?links|links_?vorne?)",
    "front_right": r"(?:fr|rf|vr|front_?right|right_?front|vorne?_?rechts|rechts_?vorne?)",
    "rear_left": r"(?:rl|lr|hl|rear_?left|left_?rear|hinten_?links|links_?hinten)",
    "rear_right": r"(?:rr|hr|rear_?right|right_?rear|hinten_?rechts|rechts_?hinten)",
}
_GYRO = r"(?:gyro|rate|omega|w)"
_TORQUE = r"(?:torque|trq|drehmoment|moment)(?:_?(?:sum|total|net))?"
_RATE = r"(?:rate|vel(?:ocity)?|speed|geschw(?:indigkeit)?|dot|winkelgeschw(?:indigkeit)?)"

_WHEEL_NAMES = {
    f"wheel_speed_{wheel}": (
        rf"{_WHEEL_WORD}?_?{_WHEEL_QUANTITY}_?{_WHEEL_WORD}?_?{at}",
        rf"{_WHEEL_WORD}_?{at}_?{_WHEEL_QUANTITY}?",
        rf"{at}_?{_WHEEL_WORD}_?{_WHEEL_QUANTITY}",
    )
    for wheel, at in _POSITIONS.items()
}
_AXLE_NAMES = {
    f"wheel_speed_{axle}": (
        rf"{_WHEEL_WORD}s?_?{_WHEEL_QUANTITY}_?{at}",
        rf"{at}_?(?:axle_?)?{_WHEEL_WORD}s?_?{_WHEEL_QUANTITY}",
    )
    for axle, at in (("front", r"(?:front|vorne?|va)"), ("rear", r"(?:rear|hinten|ha)"))
}
# In the order in which they are tried: the special before the general.
_NAMES: dict[str, tuple[str, ...]] = {
    TIME: (
        r"(?:log_?)?(?:t|time|zeit|timestamp|time_?stamp|stamp|date_?time|datum|epoch|clock)",
        r"(?:stamp|timestamp|time)_?(?:ns|us|ms|s)",
        r"(?:utc|unix|gps)_?time",
        r"elapsed(?:_?time)?",
    ),
    **_WHEEL_NAMES,
    **_AXLE_NAMES,
    "gps_speed": (
        rf"(?:gps|gnss|ground)_?{_VEL}|sog",
        rf"{_VEL}_?(?:gps|gnss|over_?ground)",
    ),
    "gps_course": (
        r"(?:gps|gnss)_?(?:course|heading|track|kurs)",
        r"cog|course(?:_?over_?ground)?",
    ),
    "latitude": (r"(?:gps_?|gnss_?)?(?:lat(?:itude)?|breite(?:ngrad)?)",),
    "longitude": (r"(?:gps_?|gnss_?)?(?:lon(?:g(?:itude)?)?|lng|laenge(?:ngrad)?)",),
    "altitude": (r"(?:gps_?|gnss_?)?(?:alt(?:itude)?|hoehe)",),
    "roll_rate": (rf"(?:roll|wank)_?{_RATE}", rf"{_GYRO}_?x", r"angular_velocity_x"),
    "pitch_rate": (rf"(?:pitch|nick)_?{_RATE}", rf"{_GYRO}_?y", r"angular_velocity_y"),
    "yaw_rate": (
        rf"(?:yaw|gier)_?{_RATE}",
        rf"{_GYRO}_?z(?:_?imu)?",
        r"psi_?(?:dot|p)|d_?psi|yaw_?r|yr|r",
        r"angular_(?:velocity|rate)_?z",
    ),
    "a_x": (
        rf"{_ACC}_?x|ax|x_?{_ACC}|linear_acceleration_x",
        rf"{_ACC}_?{_LONG}|{_LONG}_?{_ACC}|{_LONG}_?g|g_?{_LONG}",
    ),
    "a_y": (
        rf"{_ACC}_?y|ay|y_?{_ACC}|linear_acceleration_y",
        rf"{_ACC}_?{_LAT}|{_LAT}_?{_ACC}|{_LAT}_?g|g_?{_LAT}",
    ),
    "a_z": (
        rf"{_ACC}_?z|az|z_?{_ACC}|linear_acceleration_z",
        rf"{_ACC}_?{_VERT}|{_VERT}_?{_ACC}",
    ),
    "v_y": (rf"{_VEL}_?y|vy|(?:twist_)*linear_y", rf"{_VEL}_?{_LAT}|{_LAT}_?{_VEL}"),
    "v_x": (
        rf"{_VEL}_?x|vx|(?:twist_)*linear_x|tacho|{_VEL}(?:_?kmh)?",
        rf"{_VEL}_?{_LONG}|{_LONG}_?{_VEL}|{_CAR}_?{_VEL}|{_VEL}_?{_CAR}",
    ),
    "odometry_yaw_rate": (r"odom(?:etry)?_?yaw_?rate|(?:twist_)*angular_z",),
    "delta": (
        rf"{_STEER}_?{_WHEEL_WORD}?_?(?:angle|ang|winkel|position|pos)?",
        r"swa|lws_?(?:angle|winkel)?|delta(?:_?[hf])?",
        r"(?:hand_?wheel|hw)_?(?:angle|ang)|lenkrad_?(?:winkel)?",
        r"(?:road_?wheel|tire|tyre)_?angle|radlenkwinkel|wheel_?angle",
    ),
    "torque": (
        rf"(?:net_?|total_?)?(?:(?:wheel|drive|axle|rad|antriebs|motor|engine)_?)?{_TORQUE}",
        r"m_(?:wheel|rad|antrieb)",
    ),
    "motor_speed": (r"(?:engine|motor|eng|mot)_?(?:speed|spd|rpm|drehzahl)|drehzahl|rpm",),
    "brake_pressure": (
        r"(?:brake|brk|brems?)_?(?:pressure|press|druck|p)",
        r"p_?(?:brake|brems?e?)",
    ),
    "brake_pedal": (r"(?:brake|brk|brems?)_?(?:pedal|position|pos)?",),
    "throttle": (
        r"throttle(?:_?(?:position|pos|pedal))?|tps|gas",
        r"(?:accelerator|acc|gas|fahr)_?pedal(?:_?(?:position|pos|stellung))?",
    ),
    "gear": (r"gear|gang",),
    "heading": (r"heading|yaw(?:_?angle)?|psi|gierwinkel|kurswinkel",),
    "roll": (r"roll(?:_?angle)?|wankwinkel",),
    "pitch": (r"pitch(?:_?angle)?|nickwinkel",),
    "x": (r"(?:pos(?:ition)?_?)?(?:x|east|easting)", r"x_?pos(?:ition)?|(?:pose_)*position_x"),
    "y": (r"(?:pos(?:ition)?_?)?(?:y|north|northing)", r"y_?pos(?:ition)?|(?:pose_)*position_y"),
    "z": (r"(?:pos(?:ition)?_?)?(?:z|height)", r"z_?pos(?:ition)?|(?:pose_)*position_z"),
}
_PATTERNS = tuple(
    (channel, re.compile("|".join(f"(?:{name})" for name in names)))
    for channel, names in _NAMES.items()
)
_PARTS_OF_OTHERS = {"x", "y", "z", "roll", "pitch", "gear", "brake_pedal", TIME, "delta"}
"""Channels that only their whole name stands for: a part of a name says little."""
_NEVER = re.compile(
    r"covariance|variance|stamp_sec|nanosec|_seq$|(?:^|_)(?:std|stddev|valid|status|flag|counter"
    r"|crc|checksum|target|setpoint|soll|temp(?:erature)?|limit|max|min|demand|request|error)"
    r"(?:_|$)"
)
_SPELLING = str.maketrans({"ä": "ae", "ö": "oe", "ü": "ue", "ß": "ss", "ψ": "psi", "δ": "delta"})


def wheel_position(name: str) -> str:
    """Return which wheel a name such as `rear_left_wheel_joint` is of, or an empty text."""
    normalised = _normalised(name)
    found = [
        wheel
        for wheel, at in _POSITIONS.items()
        if re.fullmatch(rf"(?:.*_)?{at}(?:_.*)?", normalised)
    ]
    return found[0] if len(found) == 1 else ""


@lru_cache(maxsize=4096)
def recognise(column: str) -> ColumnName:
    """Return what a column's name says: channel and unit."""
    body, unit = _split_unit(column)
    if body in CHANNELS or body == TIME:
        return ColumnName(body, 3, unit)
    name = _normalised(body)
    if name in CHANNELS:
        return ColumnName(name, 3, unit)
    channel, quality = _match(name)
    if not channel and not unit:
        # No channel's name ends like a unit, but a name may: a_g is read as a in g.
        for ending, named in (_UNIT_AT_END | _TIME_AT_END).items():
            if name.endswith(f"_{ending}"):
                channel, quality = _match(name[: -len(ending) - 1])
                fits = (channel == TIME) == (ending in _TIME_AT_END)
                if channel and fits:
                    return ColumnName(channel, quality, named)
        return ColumnName("", 0, "")
    if not unit and channel:
        unit = _unit_at_end(name, channel)
    return ColumnName(channel, quality, unit)


def _split_unit(column: str) -> tuple[str, str]:
    """Return a name without the unit in brackets at its end, and that unit."""
    found = _UNIT_IN_BRACKETS.search(column)
    # Digits are an index, as in `wheels[0]`.
    if found is None or found[1].isdigit() or not column[: found.start()].strip():
        return column.strip(), ""
    return column[: found.start()].strip(), found[1]


def _unit_at_end(name: str, channel: str) -> str:
    if channel == TIME:
        return next((unit for end, unit in _TIME_AT_END.items() if name.endswith(f"_{end}")), "")
    for ending, unit in _UNIT_AT_END.items():
        if name.endswith(f"_{ending}") and is_unit_of(unit, CHANNELS[channel].unit):
            return unit
    return ""


def _normalised(text: str) -> str:
    """Return a name in lower case with `_` between its words."""
    # Abbreviations are words: `LongACC` is `long_acc`, `vFL` is `v_fl`.
    text = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", text)
    text = re.sub(r"[^a-z0-9]+", "_", text.lower().translate(_SPELLING))
    return text.strip("_")


def _match(name: str) -> tuple[str, int]:
    if _NEVER.search(name):
        return "", 0
    for channel, pattern in _PATTERNS:
        if pattern.fullmatch(name):
            return channel, 2
    words = name.split("_")
    # Beginnings and ends: names of devices, messages and buses stand in front, sensors behind.
    for length in range(len(words) - 1, 0, -1):
        for part in ("_".join(words[-length:]), "_".join(words[:length])):
            for channel, pattern in _PATTERNS:
                if len(part) < 2 or (channel in _PARTS_OF_OTHERS and len(part) < 5):
                    continue
                if pattern.fullmatch(part):
                    return channel, 1
    return "", 0
