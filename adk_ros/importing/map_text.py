# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A proposed map, and its text: YAML with the reason of each line as a comment."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from adk_ros.importing.column_names import TIME
from adk_ros.importing.table import Table
from adk_ros.importing.time_column import TimeGuess

CHECK = "check: "
"""Beginning of the comment of a line that a person has to check."""
_MAX_NAMED = 40
"""Columns without a channel that are listed."""


@dataclass(frozen=True)
class Guess:
    """A proposed line of the map: its entry, and why; `certain`: nothing about it is a guess."""

    channel: str
    entry: dict[str, Any]
    reason: str
    is_certain: bool


@dataclass(frozen=True)
class Proposal:
    """
    A proposed map.

    `text`: as YAML with a reason for each line. `guesses`: its channels; `computed`: those that
    are computed from others. `uncertain`: the lines to check, by channel; `time` is the time
    column. `unused`: columns without a channel.
    """

    text: str
    guesses: tuple[Guess, ...]
    computed: tuple[Guess, ...]
    uncertain: tuple[str, ...]
    unused: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """Return what `adk import --propose --json` prints."""
        return {
            "channels": _entries(self.guesses),
            "computed": _entries(self.computed),
            "check": list(self.uncertain),
            "unused": list(self.unused),
            "text": self.text,
        }


def _entries(guesses: Sequence[Guess]) -> dict[str, dict[str, Any]]:
    """Return the entries of guesses by channel, each with its reason."""
    return {
        guess.channel: guess.entry | {"reason": guess.reason, "certain": guess.is_certain}
        for guess in guesses
    }


def written(
    files: Sequence[Path],
    guesses: tuple[Guess, ...],
    computed: tuple[Guess, ...],
    times: Sequence[tuple[Table, TimeGuess]],
    reference: str,
    unused: tuple[str, ...],
    notes: Sequence[str],
) -> Proposal:
    """
    Return the proposal with its YAML text.

    :param times: the tables of the channels with their time columns.
    :param reference: what the signs were compared with; empty if only with each other.
    """
    names = " ".join(path.name for path in files)
    lines = [
        f"# Proposed from {names}. Correct what is marked 'check', then:",
        f"#   adk import {names} --map map.yaml --out BAG",
        "# value = unit(sign * (scale * raw + offset)) / ratio; axes: x forward, y left, z up.",
    ]
    uncertain: list[str] = []
    lines += _time_lines(times, uncertain)
    for key, part in (("channels", guesses), ("computed", computed)):
        lines += [f"{key}:"] if part else []
        for guess in part:
            mark = "" if guess.is_certain else CHECK
            lines.append(f"  {guess.channel}: {_flow(guess.entry)}  # {mark}{guess.reason}")
            if not guess.is_certain:
                uncertain.append(guess.channel)
    given = {guess.channel for guess in (*guesses, *computed)}
    turning = [x for x in ("yaw_rate", "a_y", "delta", "v_y") if x in given]
    if turning and not reference:
        lines.append(
            f"# Signs are made to agree with each other; if left turns are negative, flip "
            f"{', '.join(turning)}."
        )
    for missing, meaning in (
        ("v_x", "speed"),
        ("delta", "steering angle"),
        ("torque", _no_torque(given)),
        ("yaw_rate", "yaw rate"),
    ):
        if not any(name.startswith(missing) for name in given):
            lines.append(f"# not found: {missing} ({meaning})")
    if unused:
        more = f" and {len(unused) - _MAX_NAMED} more" if len(unused) > _MAX_NAMED else ""
        shown = ", ".join(" ".join(name.split()) for name in unused[:_MAX_NAMED])
        lines.append(f"# not used: {shown}{more}")
    lines += [f"# {' '.join(note.split())}" for note in notes]
    return Proposal("\n".join(lines) + "\n", guesses, computed, tuple(uncertain), unused)


def _no_torque(given: set[str]) -> str:
    """Return what is missing without a torque, and what can take its place."""
    if "throttle" in given:
        return "net wheel torque; adk check --vehicle estimates a map of the pedals"
    return "net wheel torque; a pedal in % or 1 may take its place"


def _time_lines(times: Sequence[tuple[Table, TimeGuess]], uncertain: list[str]) -> list[str]:
    """Return the lines of the time columns: one for all files if they name it alike."""
    columns = [(table, guess) for table, guess in times if guess.time is not None]
    if not columns:
        return []
    first = columns[0][1]
    assert first.time is not None
    # The tables of a MAT file name it by their structure: imu.t, odometry.t.
    ending = (first.time.column or "").rsplit(".", 1)[-1]
    if all(guess.time and table.find(ending) == guess.time.column for table, guess in columns):
        columns = [
            (table, replace(guess, time=guess.time.model_copy(update={"column": ending})))
            for table, guess in columns
            if guess.time
        ]
        first = columns[0][1]
    if not first.is_certain:
        uncertain.append(TIME)
    lines = [f"time: {_time_text(first)}"]
    others = {table.path.name: guess for table, guess in columns if guess.time != first.time}
    if others:
        lines.append("files:")
    for key, guess in others.items():
        lines += [f"  {_quoted(key)}:", f"    time: {_time_text(guess)}"]
        if not guess.is_certain:
            uncertain.append(f"time of {key}")
    return lines


def _time_text(guess: TimeGuess) -> str:
    assert guess.time is not None
    entry: dict[str, Any] = {"column": guess.time.column, "unit": guess.time.unit}
    if guess.time.format is not None:
        entry["format"] = guess.time.format
    return f"{_flow(entry)}  # {'' if guess.is_certain else CHECK}{guess.reason}"


def _flow(entry: Mapping[str, Any]) -> str:
    """Return a mapping as YAML in one line."""
    parts = [
        f"{key}: {_quoted(value) if isinstance(value, str) else f'{value:g}'}"
        for key, value in entry.items()
    ]
    return "{" + ", ".join(parts) + "}"


def _quoted(text: str) -> str:
    """Return a text as YAML: plain if that is safe, else in double quotes."""
    if re.fullmatch(r"[A-Za-z_][\w./ ^]*[\w./^]|[A-Za-z_]", text) and text.lower() not in {
        "y", "n", "yes", "no", "on", "off", "true", "false", "null",
    }:  # fmt: skip
        return text
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    printable = "".join(
        c if c.isprintable() else f"\\u{ord(c):04x}" if ord(c) < 65536 else "?" for c in escaped
    )
    return f'"{printable}"'
