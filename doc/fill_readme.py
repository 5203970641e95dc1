# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Write into README.md what the code itself says: the tables of parameters and diagnostics.

    .venv/bin/python doc/fill_readme.py

A test holds that README.md is what this would write.
"""

from __future__ import annotations

import json
import re
from pathlib import Path

from adk_ros.ros import diagnostics
from adk_ros.ros.parameters import TABLE

README = Path(__file__).resolve().parent.parent / "README.md"


def parameters() -> str:
    """The node's parameters as a Markdown table."""
    rows = ["| parameter | default | what |", "| --- | --- | --- |"]
    for spec in TABLE:
        default = "empty" if spec.default == "" else f"`{json.dumps(spec.default)}`"
        rows.append(f"| `{spec.name}` | {default} | {spec.text} |")
    return "\n".join(rows)


def diagnosed() -> str:
    """The table in the docstring of the diagnostics."""
    lines = (diagnostics.__doc__ or "").splitlines()
    return "\n".join(line for line in lines if line.startswith("|"))


def filled(text: str) -> str:
    """README's text with both tables as they should be."""
    for name, table in (("parameters", parameters()), ("diagnostics", diagnosed())):
        marked = re.compile(rf"(<!-- {name} -->\n).*?(\n<!-- /{name} -->)", re.DOTALL)
        text, count = marked.subn(lambda m, t=table: m[1] + t + m[2], text)
        if count != 1:
            raise SystemExit(f"README.md needs <!-- {name} --> ... <!-- /{name} --> once")
    return text


if __name__ == "__main__":
    README.write_text(filled(README.read_text()))
