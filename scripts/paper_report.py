# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Copy a report of `adk bench paper` into doc/paper, and summarise it for the results page."""

from __future__ import annotations

import base64
import io
import re
import shutil
from pathlib import Path

from PIL import Image

from adk_ros.bench.paper.criteria import brief
from adk_ros.bench.paper.criterion import CRITERIA_FILE, EARLIER_CRITERIA_FILE
from adk_ros.signals.score import DISPLAY_NAMES

PAPER = Path(__file__).resolve().parents[1] / "doc" / "paper"
FILES = ("report.html", "headline.md", "headline.csv", "claims.md", CRITERIA_FILE)
FOLDERS = {"tables": (".md", ".csv"), "figures": (".png",)}
MAX_BYTES = 6_000_000
COLOURS = 64
"""Palette size of a figure: lines and letters need no more."""
RENAMED_CRITERIA = {
    "no-cell-above-1": "no-combination-above-1",
    "coverage-by-cell": "coverage-by-combination",
}
"""Names in reports that `adk bench paper` has written before, and the present ones."""


def _stored(folder: Path, name: str) -> Path:
    """Return the path of a file of a report, also of one of 0.1.0."""
    if name == CRITERIA_FILE and not (folder / name).exists():
        return folder / EARLIER_CRITERIA_FILE
    return folder / name


def paper_summary(folder: Path = PAPER) -> str:
    """Return headline table, figure and criteria of the report in `folder`; "" without one."""
    if not (folder / "headline.md").is_file():
        return ""
    headline = re.sub(r"^### (.*)$", r"**\1**", (folder / "headline.md").read_text(), flags=re.M)
    for stored, shown in DISPLAY_NAMES.items():
        headline = headline.replace(stored, shown)
    lines = [
        headline.strip(),
        "",
        "![RMSE relative to the best naive predictor, by horizon](paper/figures/summary.png)",
        "",
        "Acceptance criteria and results:",
        "",
    ]
    for line in _stored(folder, CRITERIA_FILE).read_text().splitlines():
        verdict, stored, figure = line.split(" ", 2)
        name = RENAMED_CRITERIA.get(stored, stored)
        lines.append(f"- **{verdict}** `{name}`: {brief(figure)}")
    lines += [
        "",
        "All tables, figures and the reason for each failed criterion: "
        "[paper/report.html](paper/report.html). Each claim of the paper with its comparisons: "
        "[paper/claims.md](paper/claims.md).",
    ]
    return "\n".join(lines)


def take_report(run: Path, paper: Path = PAPER) -> int:
    """
    Copy the report in folder `run` to `paper`, figures with a reduced palette; return its bytes.

    Raises SystemExit, and changes nothing, if a file is missing or the report is too large.
    """
    missing = [name for name in (*FILES, *FOLDERS) if not _stored(run, name).exists()]
    if missing:
        raise SystemExit(f"{run} is not a report of `adk bench paper`: it has no {missing[0]}")
    contents = {name: _stored(run, name).read_bytes() for name in FILES}
    for folder, endings in FOLDERS.items():
        for path in sorted((run / folder).iterdir()):
            if path.suffix in endings:
                contents[f"{folder}/{path.name}"] = path.read_bytes()
    page = contents["report.html"]
    for name in [name for name in contents if name.endswith(".png")]:
        original = contents[name]
        contents[name] = reduced_palette(original)
        page = page.replace(base64.b64encode(original), base64.b64encode(contents[name]))
    contents["report.html"] = page
    size = sum(map(len, contents.values()))
    if size > MAX_BYTES:
        raise SystemExit(
            f"{run} has {size / 1e6:.1f} MB for doc/paper: {MAX_BYTES / 1e6:g} at most"
        )
    for name in FILES:
        _stored(paper, name).unlink(missing_ok=True)
    for folder in FOLDERS:
        shutil.rmtree(paper / folder, ignore_errors=True)
        (paper / folder).mkdir(parents=True)
    for name, content in contents.items():
        (paper / name).write_bytes(content)
    return size


def reduced_palette(picture: bytes) -> bytes:
    """Return a PNG with a palette of COLOURS; the given one if that is not smaller."""
    buffer = io.BytesIO()
    with Image.open(io.BytesIO(picture)) as image:
        reduced = image.convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE)
    reduced.save(buffer, "PNG", optimize=True)
    return min(picture, buffer.getvalue(), key=len)
