# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Render a self-contained HTML page from a template that extends `base.html.j2`."""

from __future__ import annotations

import base64
import re
from pathlib import Path
from typing import Any, NamedTuple

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from adk_ros.files.pages.provenance import Provenance

_HEADING = re.compile(r'<h2 id="([^"]+)">(.*?)</h2>', re.DOTALL)


class Figure(NamedTuple):
    """A figure embedded in a page: alternative text and PNG content in base64."""

    alt: str
    png_base64: str


def embed(path: Path, alt: str) -> Figure:
    """Return a PNG file as a figure for a page."""
    return Figure(alt, base64.b64encode(path.read_bytes()).decode())


def render_page(
    package: str, template: str, provenance: Provenance | None = None, **values: Any
) -> str:
    """
    Return a page as HTML text.

    `template` lies in the folder `templates` of `package` and extends `base.html.j2`, which adds
    style, table of contents and provenance. Values are escaped; a missing one is an error.
    """
    environment = Environment(
        loader=ChoiceLoader([PackageLoader(package), PackageLoader("adk_ros.files.pages")]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals["headings"] = headings
    text = environment.get_template(template).render(provenance=provenance, **values)
    return re.sub(r"\n{3,}", "\n\n", text)


def headings(content: Markup) -> list[tuple[str, Markup]]:
    """Return (anchor, title) of each `<h2 id="...">` in rendered content."""
    return [(anchor, Markup(title)) for anchor, title in _HEADING.findall(str(content))]
