# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Propose a map: channels by the names of columns, units and signs by names and statistics."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from adk_ros.errors import AdkError, DataError
from adk_ros.importing.channels import (
    ANGLE,
    CHANNELS,
    DEGREE,
    PRESSURE,
    RATE,
    SHARE,
    SPEED,
    TORQUE,
    is_wheel_speed,
)
from adk_ros.importing.column_names import TIME, recognise
from adk_ros.importing.consistency import find_consistent_units
from adk_ros.importing.map_file import ChannelMap, ImportMap
from adk_ros.importing.map_text import Guess, Proposal, written
from adk_ros.importing.row_stamps import row_stamps
from adk_ros.importing.source_channels import SourceChannel
from adk_ros.importing.source_files import open_tables
from adk_ros.importing.table import Table, as_numbers
from adk_ros.importing.time_column import TimeGuess, guess_time
from adk_ros.importing.unit_choice import Findings
from adk_ros.importing.units import factor_to_si, is_unit_of
from adk_ros.importing.velocity_choice import (
    USUAL_RADIUS,
    computed_position,
    computed_velocity,
    speed_to_compare,
)
from adk_ros.numerics.arrays import FloatArray

_HAND = re.compile(r"(?i)hand|lenkrad|lws|swa|steering_?\s?wheel|str_?whl|str_?wheel")
_ROAD = re.compile(r"(?i)road|tire|tyre|radlenk|delta")
_MOTOR = re.compile(r"(?i)motor|engine|eng_")


@dataclass(frozen=True)
class _Candidate:
    channel: SourceChannel
    table: Table
    quality: int
    unit: str
    is_constant: bool


def propose(files: Sequence[Path], databases: Sequence[Path]) -> Proposal:
    """
    Propose a map for files.

    :raises UsageError, DataError: a file is missing, cannot be read, or has no known column.
    """
    notes: list[str] = []
    tables = open_tables(files, {}, databases, notes)
    times = {id(table): guess_time(table) for table in tables}
    candidates: dict[str, list[_Candidate]] = {}
    for table in tables:
        for candidate in _candidates(table, times[id(table)], notes):
            candidates.setdefault(candidate.channel.name, []).append(candidate)
    chosen = {name: _best(found) for name, found in candidates.items()}
    _gyro_from_odometry(chosen)
    if not chosen:
        names = ", ".join(table.columns[0] for table in tables[:5])
        if notes:
            raise DataError(f"{'; '.join(dict.fromkeys(notes))}: write the map by hand")
        raise DataError(
            f"{files[0]}: no column has a known name ({names}, ...): write the map by hand, see "
            "doc/how-to/import.md"
        )
    known = {name: item.unit for name, item in chosen.items() if item.unit}
    hand = None
    if "delta" in chosen:
        column = chosen["delta"].channel.column
        hand = True if _HAND.search(column) else False if _ROAD.search(column) else None
    raw = {name: item.channel for name, item in chosen.items()}
    found = find_consistent_units(*_with_speed(raw, known), hand)
    guesses = tuple(
        _guess(name, chosen[name], chosen, found, len(candidates.get(name, ())), tables)
        for name in CHANNELS
        if name in chosen
    )
    velocity = computed_velocity(raw, {guess.channel: guess for guess in guesses})
    computed = [guess for guess in (velocity, computed_position(raw)) if guess is not None]
    used = {(item.channel.table, item.channel.column) for item in chosen.values()}
    time_columns = {(t.label, time.column) for t in tables if (time := times[id(t)].time)}
    unused = tuple(
        column
        for table in tables
        for column in table.columns
        if (table.label, column) not in used | time_columns
    )
    used_tables = [t for t in tables if any(item.table is t for item in chosen.values())]
    return written(
        files,
        guesses,
        tuple(computed),
        [(t, times[id(t)]) for t in used_tables],
        found.reference,
        unused,
        notes,
    )


def _with_speed(
    raw: dict[str, SourceChannel], known: dict[str, str]
) -> tuple[dict[str, SourceChannel], dict[str, str]]:
    """Return channels and known units, with a speed to compare with where v_x is missing."""
    speed = None if "v_x" in raw else speed_to_compare(raw, known)
    if speed is None:
        return raw, known
    channel, unit = speed
    return raw | {"v_x": channel}, known | ({"v_x": unit} if unit else {})


def _candidates(table: Table, time: TimeGuess, notes: list[str]) -> list[_Candidate]:
    """Return the columns of a table with a known name, as raw values."""
    # In a structure or CAN message its own name says nothing; a topic's may.
    prefix = "" if table.name.startswith("/") else f"{table.name}."
    names = {column: recognise(column.removeprefix(prefix)) for column in table.columns}
    wanted = [c for c, name in names.items() if name.channel not in {"", TIME}]
    if not wanted:
        return []
    try:
        stamps = row_stamps(table, ImportMap(time=time.time, channels={}), notes)
    except AdkError as error:
        notes.append(str(error))
        return []
    cells = table.load(wanted)
    found = []
    for column in wanted:
        name = names[column]
        values = as_numbers(cells[column][stamps.row]).values
        known = np.isfinite(values)
        if known.sum() < 2:
            continue
        si = CHANNELS[name.channel].unit
        stated = name.unit or table.units.get(column, "")
        fits = bool(stated) and (
            is_unit_of(stated, si)
            or (is_wheel_speed(name.channel) and is_unit_of(stated, SPEED))
            or (si == TORQUE and is_unit_of(stated, SHARE))
        )
        if stated and not fits and name.quality < 3:
            # A name that fits with a unit that does not is another channel.
            continue
        stamp_ns, first = np.unique(stamps.stamp_ns[known], return_index=True)
        raw = values[known][first]
        channel = SourceChannel(
            name.channel,
            table.label,
            column,
            ChannelMap(column=column, unit=stated if fits else si),
            1.0,
            stamp_ns,
            raw,
            0,
            0,
            0,
        )
        found.append(
            _Candidate(
                channel, table, name.quality, stated if fits else "", bool(np.ptp(raw) == 0.0)
            )
        )
    return found


def _best(found: Sequence[_Candidate]) -> _Candidate:
    """Return the column with the best name; of equal ones the fastest that is not constant."""
    return max(
        found,
        key=lambda c: (not c.is_constant, c.quality, bool(c.unit), c.channel.values.shape[0]),
    )


def _gyro_from_odometry(chosen: dict[str, _Candidate]) -> None:
    """Without a gyro, the yaw rate of odometry is the yaw rate."""
    if "yaw_rate" not in chosen and "odometry_yaw_rate" in chosen and "a_x" not in chosen:
        chosen["yaw_rate"] = chosen.pop("odometry_yaw_rate")


def _guess(
    name: str,
    item: _Candidate,
    chosen: Mapping[str, _Candidate],
    found: Findings,
    choices: int,
    tables: Sequence[Table],
) -> Guess:
    entry: dict[str, Any] = {"column": item.channel.column}
    if sum(item.channel.column in table.columns for table in tables) > 1:
        entry["file"] = item.table.name or item.table.path.name
    reasons: list[str] = []
    doubts: list[str] = []
    if item.unit:
        entry["unit"] = item.unit
        reasons.append("unit stated")
    elif name in found.units:
        entry["unit"] = found.units[name]
        reasons.append(found.reasons.get(name, ""))
        if name not in found.certain:
            doubts.append("unit guessed")
    else:
        unit, why, is_certain = _unit_by_size(name, item.channel.values, chosen, found)
        entry["unit"] = unit
        reasons.append(why)
        if not is_certain:
            doubts.append("unit guessed")
    if name in found.flipped:
        entry["sign"] = -1
        reasons.append(found.flipped[name])
        if name in found.doubtful_signs:
            doubts.append("sign guessed")
    if name in found.offsets:
        entry["offset"] = round(found.offsets[name] / factor_to_si(entry["unit"], "rad"), 6)
        reasons.append(found.reasons[name])
        doubts.append("offset guessed")
    if name == "delta" and found.ratio is not None:
        if found.ratio != 1.0:
            entry["ratio"] = found.ratio
        reasons.append(found.ratio_reason)
        if not found.is_ratio_certain and (found.ratio != 1.0 or not item.unit):
            doubts.append("ratio guessed")
    if is_wheel_speed(name) and is_unit_of(entry["unit"], SPEED):
        entry["wheel_radius"] = USUAL_RADIUS
        doubts.append("wheel radius guessed")
    if name == "torque" and _MOTOR.search(item.channel.column):
        doubts.append("torque of the motor: give the ratio of the gears as scale")
    if item.quality == 1:
        reasons.append("part of the name")
    if choices > 1:
        reasons.append(f"of {choices} columns")
    if item.is_constant:
        doubts.append("constant")
    reason = "; ".join([*doubts, *filter(None, reasons)])
    return Guess(name, entry, reason, not doubts)


def _unit_by_size(
    name: str, values: FloatArray, chosen: Mapping[str, _Candidate], found: Findings
) -> tuple[str, str, bool]:
    """Return unit, reason, and whether it is certain, by the size of the values."""
    size = float(np.quantile(np.abs(values), 0.99))
    si = CHANNELS[name].unit
    text = f"values up to {size:.3g}"
    if si == DEGREE:
        return "deg", text, True
    if name in {"x", "y", "z", "altitude"}:
        return "m", text, True
    if is_wheel_speed(name):
        v = chosen.get("v_x")
        unit = (v.unit or found.units.get("v_x", "m/s")) if v is not None else "km/h"
        same = v is not None and 0.7 < size / np.quantile(np.abs(v.channel.values), 0.99) < 1.4
        return (unit, "as large as v_x", False) if same else ("rpm", text, False)
    if si == PRESSURE:
        return ("bar" if size < 400.0 else "kPa" if size < 4e4 else "Pa"), text, False
    if si == TORQUE:
        return ("1", f"{text}: a pedal", False) if size <= 1.5 else ("N m", text, size > 150.0)
    if si == SHARE:
        return ("%", text, size > 10.0) if size > 1.5 and name != "gear" else ("1", text, True)
    if name == "motor_speed":
        return "rpm", text, size > 600.0
    if si == ANGLE:
        return ("deg", text, True) if size > 7.0 else ("rad", text, False)
    if name == "v_y" and (unit := _unit_of("v_x", chosen, found)):
        return unit, "as v_x", True
    if si == RATE:
        unit = _unit_of("yaw_rate", chosen, found)
        return (unit, "as the yaw rate", True) if unit else ("rad/s", text, False)
    return si, text, False


def _unit_of(name: str, chosen: Mapping[str, _Candidate], found: Findings) -> str:
    if name not in chosen:
        return ""
    return chosen[name].unit or found.units.get(name, "")
