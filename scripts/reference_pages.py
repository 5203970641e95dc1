# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reference pages of the documentation, written from the code: commands, effects, parameters."""

from __future__ import annotations

import json
import re
from typing import Any

import typer

from adk_ros.cli.command import readable_usage
from adk_ros.cli.main import app
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.effect_table import effect_table
from adk_ros.ros import diagnostics
from adk_ros.ros.parameter_table import TABLE

EXPONENTS = {"^2": "²", "^3": "³", "m2": "m²", "kg m²": "kg·m²", "N m": "N·m"}


def typeset(text: str) -> str:
    """Return text with superscripts in its units and without what Markdown would interpret."""
    for plain, pretty in EXPONENTS.items():
        text = text.replace(plain, pretty)
    return text.replace("|", "\\|").replace("*", "\\*").replace("<", "&lt;")


def parameter_table() -> str:
    """Return the node's parameters as a Markdown table."""
    rows = ["| parameter | default | meaning |", "| --- | --- | --- |"]
    for spec in TABLE:
        default = "empty" if spec.default == "" else f"`{json.dumps(spec.default)}`"
        rows.append(f"| `{spec.name}` | {default} | {typeset(spec.text)} |")
    return "\n".join(rows)


def diagnostics_table() -> str:
    """Return the table in the docstring of the diagnostics module."""
    lines = (diagnostics.__doc__ or "").splitlines()
    return "\n".join(line for line in lines if line.startswith("|"))


def command_reference() -> str:
    """Return one section per command, from the definitions that `--help` prints."""
    command: Any = typer.main.get_command(app)
    parts = []
    for name in command.commands:
        verb = command.commands[name]
        if hasattr(verb, "commands"):
            parts += [f"## adk {name}", "", _help(verb), ""]
            for inner in verb.commands:
                parts += _section(f"adk {name} {inner}", verb.commands[inner], "###")
        else:
            parts += _section(f"adk {name}", verb, "##")
    return "\n".join(parts).rstrip()


def _help(command: Any) -> str:
    text = " ".join((command.help or "").split("Example:")[0].split())
    return typeset(text)


def _section(title: str, command: Any, heading: str) -> list[str]:
    context = typer.Context(command)
    lines = [f"{heading} {title}", "", _help(command), ""]
    example = re.search(r"Example:\s*(.+)\Z", command.help or "", re.DOTALL)
    if example:
        lines += ["```bash", " ".join(example[1].split()), "```", ""]
    lines += ["| argument or option | meaning |", "| --- | --- |"]
    for parameter in command.params:
        record = parameter.get_help_record(context)
        if record is not None:
            usage, text = record
            lines.append(f"| `{readable_usage(usage)}` | {typeset(text)} |")
    return [*lines, ""]


def effects_reference() -> str:
    """Return every effect that `adk mismatch` identifies by name, as a table."""
    return f"`adk mismatch` knows {len(EFFECTS)} effects by name.\n\n{effect_table()}"
