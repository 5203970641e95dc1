# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Write into README.md what the code itself says, and what `adk bench paper` measured.

    .venv/bin/python doc/fill_readme.py                       # from the code and doc/paper
    .venv/bin/python doc/fill_readme.py --paper paper_out     # take that run's report first

The second copies a run's report into doc/paper: page, tables, figures, claims, bars and headline,
not the scores. A test holds that README.md is what this would write.
"""

from __future__ import annotations

import argparse
import base64
import io
import json
import re
import shutil
from pathlib import Path

from PIL import Image

from adk_ros.bench.paper.criteria import brief
from adk_ros.ros import diagnostics
from adk_ros.ros.parameter_table import TABLE

ROOT = Path(__file__).resolve().parent.parent
README = ROOT / "README.md"
PAPER = ROOT / "doc" / "paper"
FILES = ("report.html", "headline.md", "headline.csv", "claims.md", "bars.txt")
FOLDERS = {"tables": (".md", ".csv"), "figures": (".png",)}
MOST_BYTES = 6_000_000
COLOURS = 64
"""Of a figure: lines and letters, no photograph."""


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


def measured(folder: Path = PAPER) -> str:
    """The headline of the report in a folder, its figure and its bars; "" if there is none."""
    if not (folder / "headline.md").is_file():
        return ""
    headline = re.sub(r"^### (.*)$", r"**\1**", (folder / "headline.md").read_text(), flags=re.M)
    lines = [
        "### Beside the paper and other libraries",
        "",
        "Beside the paper's predictors, other people's libraries and a tuned physics model, on "
        "ten tests (`adk bench paper`, [doc/paper.md](doc/paper.md)):",
        "",
        headline.strip(),
        "",
        "![RMSE over the best naive predictor's, by horizon](doc/paper/figures/summary.png)",
        "",
        "What was asked of it, and whether it came out so:",
        "",
    ]
    cut = False
    for line in (folder / "bars.txt").read_text().splitlines():
        verdict, name, figure = line.split(" ", 2)
        short = brief(figure)
        cut |= short != figure
        lines.append(f"- **{verdict}** `{name}`: {short}")
    more = "which cells, and why, " if cut else ""
    lines += [
        "",
        f"{more}the other tables and figures: [doc/paper/report.html](doc/paper/report.html), one "
        f"page to be opened in a browser; the paper's claims, one by one: "
        f"[doc/paper/claims.md](doc/paper/claims.md).",
    ]
    lines[-1] = lines[-1][0].upper() + lines[-1][1:]
    return "\n".join(lines)


def filled(text: str, paper: Path = PAPER) -> str:
    """README's text with its marked parts as they should be."""
    parts = {
        "parameters": parameters(), "diagnostics": diagnosed(), "paper": measured(paper),
    }  # fmt: skip
    for name, part in parts.items():
        marked = re.compile(rf"(<!-- {name} -->\n).*?(<!-- /{name} -->)", re.DOTALL)
        body = f"{part}\n" if part else ""
        text, count = marked.subn(lambda m, t=body: m[1] + t + m[2], text)
        if count != 1:
            raise SystemExit(f"README.md needs <!-- {name} --> ... <!-- /{name} --> once")
    return text


def take(run: Path, paper: Path = PAPER) -> int:
    """
    Copy from a run's folder what belongs in the repository, figures in fewer colours.

    Returns its bytes. A folder that lacks something, or holds too much, changes nothing.
    """
    lacking = [name for name in (*FILES, *FOLDERS) if not (run / name).exists()]
    if lacking:
        raise SystemExit(f"{run} is no report of `adk bench paper`: it has no {lacking[0]}")
    found = {name: (run / name).read_bytes() for name in FILES}
    for folder, endings in FOLDERS.items():
        for path in sorted((run / folder).iterdir()):
            if path.suffix in endings:
                found[f"{folder}/{path.name}"] = path.read_bytes()
    page = found["report.html"]
    for name in [name for name in found if name.endswith(".png")]:
        whole = found[name]
        found[name] = fewer_colours(whole)
        page = page.replace(base64.b64encode(whole), base64.b64encode(found[name]))
    found["report.html"] = page
    size = sum(map(len, found.values()))
    if size > MOST_BYTES:
        most = MOST_BYTES / 1e6
        raise SystemExit(f"{run} has {size / 1e6:.1f} MB for doc/paper: {most:g} at most")
    for name in FILES:
        (paper / name).unlink(missing_ok=True)
    for folder in FOLDERS:
        shutil.rmtree(paper / folder, ignore_errors=True)
        (paper / folder).mkdir(parents=True)
    for name, content in found.items():
        (paper / name).write_bytes(content)
    return size


def fewer_colours(picture: bytes) -> bytes:
    """A PNG with a palette; the one given where that is no smaller."""
    buffer = io.BytesIO()
    with Image.open(io.BytesIO(picture)) as image:
        reduced = image.convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE)
    reduced.save(buffer, "PNG", optimize=True)
    return min(picture, buffer.getvalue(), key=len)


def main() -> None:
    """Fill README.md."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument("--paper", type=Path, help="folder that `adk bench paper` wrote")
    run = parser.parse_args().paper
    if run is not None:
        size = take(run)
        print(f"doc/paper: {size / 1e6:.1f} MB")
    README.write_text(filled(README.read_text()))


if __name__ == "__main__":
    main()
