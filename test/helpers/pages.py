# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""An HTML page as a browser parses it, and the checks that every page must pass."""

from __future__ import annotations

import base64
import re
from html.parser import HTMLParser

from adk_ros.files.pages.provenance import InputFile, Provenance

VOID = {"meta", "img", "br", "hr", "link", "input"}
PNG = "data:image/png;base64,"

PROVENANCE = Provenance(
    "adk verb --recording 'my bag'",
    "1.2.3",
    "2026-01-02 03:04:05 UTC",
    61.25,
    (
        InputFile("simulation", "runs/sim", "runs/sim/sim_0.mcap", 12345, "ab" * 32),
        InputFile("recording", "runs/my bag", "runs/my bag/bag_0.mcap", 678, "cd" * 32),
    ),
)


class Page(HTMLParser):
    """Tags, anchors, images with alternative texts, table rows with cell classes, and text."""

    def __init__(self, source: str) -> None:
        super().__init__()
        self.source = source
        self.open: list[str] = []
        self.tags: set[str] = set()
        self.ids: list[str] = []
        self.links: list[str] = []
        self.images: list[tuple[str, bytes]] = []
        self.rows: list[list[str]] = []
        self.cell_classes: list[list[str]] = []
        self.words: list[str] = []
        self.headings: dict[str, str] = {}
        self._last_id = ""
        self.feed(source)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        given = dict(attrs)
        if "id" in given:
            self._last_id = given["id"] or ""
            self.ids.append(self._last_id)
        if tag == "a":
            self.links.append(given["href"] or "")
        if tag == "img":
            address = given["src"] or ""
            assert address.startswith(PNG)
            content = base64.b64decode(address.removeprefix(PNG), validate=True)
            self.images.append((given["alt"] or "", content))
        if tag not in VOID:
            self.open.append(tag)
        if tag == "tr":
            self.rows.append([])
            self.cell_classes.append([])
        if tag in {"td", "th"}:
            self.rows[-1].append("")
            self.cell_classes[-1].append(given.get("class") or "")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] in {"td", "th"}:
            self.rows[-1][-1] += data
        if self.open and self.open[-1] == "h2":
            self.headings[self._last_id] = data
        if self.open and self.open[-1] != "style":
            self.words.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())


def assert_self_contained(page: Page) -> None:
    """Assert that a page is well formed, loads nothing and adapts to dark and narrow screens."""
    assert page.open == []
    assert {"html", "head", "title", "body", "main", "h1"} <= page.tags
    assert not page.tags & {"script", "link", "iframe", "object", "embed", "base"}
    for external in ("http:", "https:", "url(", "@import", "src=//"):
        assert external not in page.source
    assert "@media screen and (prefers-color-scheme: dark)" in page.source
    assert re.search(r"@media \(max-width: \d+px\)", page.source)
    assert 'name="viewport"' in page.source
    assert all(alt for alt, _ in page.images)
    assert page.source.count('<figure tabindex="0"><img') == len(page.images)
    assert page.source.count("<table") == page.source.count(
        '<div class="wide" tabindex="0"><table'
    )


def assert_contents(page: Page) -> None:
    """Assert that the table of contents links to every section, in order."""
    assert len(set(page.ids)) == len(page.ids)
    anchors = [link.removeprefix("#") for link in page.links if link.startswith("#")]
    assert anchors == list(page.headings)
    assert set(anchors) <= set(page.ids)
    assert anchors[-1] == "provenance"


def assert_provenance(page: Page, expected: Provenance = PROVENANCE) -> None:
    """Assert that a page states where its result comes from."""
    assert expected.command in page.text
    assert f"adk_ros {expected.version}" in page.text
    assert expected.started in page.text
    assert f"{expected.duration_s:.1f} s" in page.text
    for item in expected.inputs:
        assert [item.role, item.path, str(item.size_bytes), item.sha256] in page.rows
