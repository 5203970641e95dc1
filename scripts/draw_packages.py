# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Draw the packages of adk_ros and who imports whom, from the sources, as an SVG file.

    .venv/bin/python scripts/draw_packages.py       # writes doc/packages.svg

A package may import only from packages below it, so every arc points down; an import uphill ends
the script with an error. A test compares the file with what this draws.
"""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from xml.sax.saxutils import escape

ROOT = Path(__file__).resolve().parents[1]
PICTURE = ROOT / "doc" / "packages.svg"
ORDER = (
    "cli", "bench", "fleet", "api", "ros", "exporting", "offline", "importing", "mismatch",
    "calibration", "road",
    "train", "model", "plant", "bags", "signals", "files", "numerics", "shutdown", "errors",
)  # fmt: skip
"""From top to bottom."""

ROW, TOP, BOX_X, BOX_WIDTH, BOX_HEIGHT, WIDTH = 62, 56, 24, 580, 46, 820
STYLE = """
  .page { fill: #ffffff } .box { fill: #eef2fb; stroke: #5b6fa8 } .name { fill: #1c2750 }
  .text { fill: #444c60 } .arc { stroke: #5b6fa8; fill: none; opacity: .55 } .tip { fill: #5b6fa8 }
  text { font-family: system-ui, sans-serif; font-size: 13px }
  .name { font-weight: 600; font-size: 15px } .name tspan { font-weight: 400; font-size: 13px }
  @media (prefers-color-scheme: dark) {
    .page { fill: #1e2129 } .box { fill: #2b3145; stroke: #93a5dd } .name { fill: #e7ebfa }
    .text { fill: #c3c9d9 } .arc { stroke: #93a5dd } .tip { fill: #93a5dd }
  }
"""


def package_of(path: Path, package: Path) -> str:
    """Return the first-level package or module that a source file belongs to; "" for adk_ros."""
    parts = path.relative_to(package).with_suffix("").parts
    return "" if parts[0] == "__init__" else parts[0]


def imports(path: Path, root: Path = ROOT) -> Iterator[str]:
    """Yield the first-level packages of adk_ros that a file imports."""
    module = path.relative_to(root).with_suffix("").parts
    for node in ast.walk(ast.parse(path.read_text())):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                inside = module[: len(module) - node.level]
                base = ".".join([*inside, base] if base else inside)
            names = [f"{base}.{alias.name}" for alias in node.names]
        for name in names:
            parts = name.split(".")
            if parts[0] == "adk_ros" and len(parts) > 1:
                yield parts[1]


def graph(root: Path = ROOT) -> Counter[tuple[str, str]]:
    """Return (importer, imported) -> number of imports between first-level packages."""
    package = root / "adk_ros"
    count: Counter[tuple[str, str]] = Counter()
    for path in sorted(package.rglob("*.py")):
        source = package_of(path, package)
        for target in imports(path, root):
            known = (package / target).is_dir() or (package / f"{target}.py").is_file()
            if source and target != source and known:
                count[source, target] += 1
    return count


def direct(counts: Counter[tuple[str, str]]) -> list[tuple[str, str]]:
    """Return the imports that no chain of other imports implies (transitive reduction)."""
    below: dict[str, set[str]] = {}
    for source, target in counts:
        below.setdefault(source, set()).add(target)

    def reached(name: str) -> set[str]:
        return set().union(*({t} | reached(t) for t in below.get(name, ())))

    return sorted(
        (source, target)
        for source, target in counts
        if not any(target in reached(other) for other in below[source] - {target})
    )


def shortened(text: str, most: int = 84) -> str:
    """Return a purpose without backquotes, up to its last clause that fits."""
    text = text.replace("`", "")
    while len(text) > most:
        text = text[: max(text.rfind(mark) for mark in ",;:")].rstrip()
    return text


def purpose(path: Path) -> str:
    """Return the first paragraph's first sentence of a package's or module's docstring."""
    source = path / "__init__.py" if path.is_dir() else path
    text = (ast.get_docstring(ast.parse(source.read_text())) or "").split("\n\n")[0]
    return " ".join(text.split()).split(". ")[0].rstrip(".")


def packages(root: Path = ROOT) -> list[Path]:
    """Return every package folder of adk_ros and every first-level module, in drawing order."""
    package = root / "adk_ros"
    found = [path.parent for path in package.rglob("__init__.py") if path.parent != package]
    found += [path for path in package.glob("*.py") if path.name != "__init__.py"]
    unknown = {path.relative_to(package).parts[0].removesuffix(".py") for path in found}
    if unknown - set(ORDER):
        raise SystemExit(f"add to ORDER in {Path(__file__).name}: {sorted(unknown - set(ORDER))}")

    def rank(path: Path) -> tuple[int, str]:
        relative = path.relative_to(package)
        return ORDER.index(relative.parts[0].removesuffix(".py")), relative.as_posix()

    return sorted(found, key=rank)


def table(root: Path = ROOT) -> str:
    """Return the packages and their purposes as a Markdown table."""
    rows = ["| package | contents |", "| --- | --- |"]
    for path in packages(root):
        rows.append(f"| `{path.relative_to(root).as_posix()}` | {purpose(path)} |")
    return "\n".join(rows)


def drawing(root: Path = ROOT) -> str:
    """Return the picture: one box per first-level package, one arc per import relation."""
    package = root / "adk_ros"
    counts = graph(root)
    top_level = [path for path in packages(root) if path.parent == package]
    names = [path.name.removesuffix(".py") for path in top_level]
    y = {name: TOP + ROW * i for i, name in enumerate(names)}
    height = TOP + ROW * len(names) + 8
    label = (
        "Packages of adk_ros. Arcs are imports and point down; imports that follow from "
        "others are left out."
    )
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" role="img" '
        f'aria-label="{label}">',
        f"<style>{STYLE}</style>",
        f'<rect class="page" width="{WIDTH}" height="{height}" rx="8"/>',
        f'<text class="text title" x="{BOX_X}" y="32">{label}</text>',
    ]
    right = BOX_X + BOX_WIDTH
    for source, target in counts:
        if y[source] >= y[target]:
            raise SystemExit(f"adk_ros/{source} imports adk_ros/{target}, which is not below it")
    for source, target in direct(counts):
        n = counts[source, target]
        begin, end = y[source] + BOX_HEIGHT * 0.65, y[target] + BOX_HEIGHT * 0.35
        bulge = right + 22 + 0.5 * (end - begin)
        bulge = min(bulge, right + 225)
        width = min(0.8 + 0.35 * n**0.5, 3.0)
        parts.append(
            f'<path class="arc" stroke-width="{width:.1f}" d="M{right} {begin:.0f} '
            f'C{bulge:.0f} {begin:.0f} {bulge:.0f} {end:.0f} {right + 7} {end:.0f}">'
            f"<title>{source} imports {target}: {n}</title></path>"
        )
        tip = f"{right + 1},{end:.0f} {right + 9},{end - 4:.0f} {right + 9},{end + 4:.0f}"
        parts.append(f'<polygon class="tip" points="{tip}"/>')
    for path, name in zip(top_level, names, strict=True):
        folders = [p.name for p in packages(root) if p.parent == path] if path.is_dir() else []
        inner = f'<tspan class="text">  {", ".join(folders)}</tspan>' if folders else ""
        parts.append(
            f'<rect class="box" x="{BOX_X}" y="{y[name]}" width="{BOX_WIDTH}" '
            f'height="{BOX_HEIGHT}" rx="6"/>'
        )
        x = BOX_X + 12
        parts.append(f'<text class="name" x="{x}" y="{y[name] + 19}">{escape(name)}{inner}</text>')
        text = escape(shortened(purpose(path)))
        parts.append(f'<text class="text" x="{x}" y="{y[name] + 37}">{text}</text>')
    return "\n".join([*parts, "</svg>", ""])


if __name__ == "__main__":
    PICTURE.write_text(drawing())
