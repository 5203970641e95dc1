# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Write into the documentation what the code itself says, and what `adk bench paper` measured.

    .venv/bin/python scripts/generate_docs.py                       # from the code and doc/paper
    .venv/bin/python scripts/generate_docs.py --paper paper_out     # take that run's report first

Generated text stands between two comments, `<!-- name -->` and `<!-- /name -->`. A test compares
the files with what this script writes.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator
from pathlib import Path

import draw_packages
from paper_report import PAPER, paper_summary, take_report
from reference_pages import (
    command_reference,
    diagnostics_table,
    effects_reference,
    parameter_table,
)

ROOT = Path(__file__).resolve().parents[1]


def generated(paper: Path = PAPER) -> dict[str, dict[str, str]]:
    """Return path -> name of a marked part -> its text."""
    return {
        "CONTRIBUTING.md": {"packages": draw_packages.table()},
        "doc/reference/parameters.md": {"parameters": parameter_table()},
        "doc/reference/diagnostics.md": {"diagnostics": diagnostics_table()},
        "doc/reference/commands.md": {"commands": command_reference()},
        "doc/reference/effects.md": {"effects": effects_reference()},
        "doc/results.md": {"paper": paper_summary(paper)},
    }


def fill(text: str, parts: dict[str, str], file: str) -> str:
    """
    Return `text` with its marked parts replaced by `parts`.

    Raises SystemExit if a part is not marked exactly once.
    """
    for name, part in parts.items():
        marked = re.compile(rf"(<!-- {name} -->\n).*?(<!-- /{name} -->)", re.DOTALL)
        found = list(marked.finditer(text))
        if len(found) != 1:
            raise SystemExit(f"{file} needs <!-- {name} --> ... <!-- /{name} --> once")
        body = f"\n{part}\n\n" if part else ""
        text = text[: found[0].end(1)] + body + text[found[0].start(2) :]
    return text


def files(paper: Path = PAPER) -> Iterator[tuple[Path, str]]:
    """Yield every generated file and the text that it should have."""
    for name, parts in generated(paper).items():
        path = ROOT / name
        yield path, fill(path.read_text(), parts, name)
    yield draw_packages.PICTURE, draw_packages.drawing()


def main() -> None:
    """Write all generated parts."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[1])
    parser.add_argument("--paper", type=Path, help="folder that `adk bench paper` wrote")
    run = parser.parse_args().paper
    if run is not None:
        print(f"doc/paper: {take_report(run) / 1e6:.1f} MB")
    for path, text in files():
        if path.read_text() != text:
            path.write_text(text)
            print(f"updated {path.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
