# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The base page: contents, provenance, escaping; and the hashes of input files."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest
from helpers.pages import (
    PROVENANCE,
    Page,
    assert_contents,
    assert_provenance,
    assert_self_contained,
)
from jinja2 import DictLoader, PackageLoader, UndefinedError

from adk_ros.errors import UsageError
from adk_ros.files.pages import page as page_module
from adk_ros.files.pages.page import render_page
from adk_ros.files.pages.provenance import Provenance, input_files, sha256_of

CHILD = """{% extends "base.html.j2" %}
{% from "macros.html.j2" import table %}
{% block title %}{{ name }}{% endblock %}
{% block heading %}{{ name }}{% endblock %}
{% block content %}
<h2 id="first">First & {{ name }}</h2>
{{ table(["a", "b"], [["1", "2"]]) }}
<h2 id="second">Second</h2>
<h2 id="third">Third</h2>
{% endblock %}
"""


@pytest.fixture
def rendered(monkeypatch: pytest.MonkeyPatch) -> Page:
    return Page(render(monkeypatch, PROVENANCE))


def render(monkeypatch: pytest.MonkeyPatch, provenance: Provenance | None) -> str:
    def loader(package: str) -> object:
        return (
            DictLoader({"child.html.j2": CHILD}) if package == "child" else PackageLoader(package)
        )

    monkeypatch.setattr(page_module, "PackageLoader", loader)
    return render_page("child", "child.html.j2", provenance, name="<b>bold</b>")


def test_a_page_is_self_contained(rendered: Page) -> None:
    assert_self_contained(rendered)
    assert_contents(rendered)
    assert_provenance(rendered)
    assert ["1", "2"] in rendered.rows


def test_values_are_escaped_in_headings_and_contents(rendered: Page) -> None:
    assert "First & <b>bold</b>" in rendered.text
    assert rendered.source.count("&lt;b&gt;bold&lt;/b&gt;") == 4


def test_a_page_without_provenance_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    page = Page(render(monkeypatch, None))
    assert_self_contained(page)
    assert "Not recorded. The command adk records input files" in page.text


def test_a_missing_value_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(globals(), "CHILD", CHILD.replace("name", "nobody"))
    with pytest.raises(UndefinedError):
        render(monkeypatch, None)


def test_every_file_of_a_folder_is_hashed(tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    bag.mkdir()
    (bag / "bag_0.mcap").write_bytes(b"data" * 1_000_000)
    (bag / "metadata.yaml").write_bytes(b"")
    first, second = input_files("recording", bag)
    assert (first.role, first.source, first.size_bytes) == ("recording", str(bag), 4_000_000)
    assert first.sha256 == hashlib.sha256(b"data" * 1_000_000).hexdigest()
    assert second.path == str(bag / "metadata.yaml")
    assert second.sha256 == hashlib.sha256().hexdigest()
    (alone,) = input_files("vehicle", bag / "bag_0.mcap")
    assert alone.sha256 == first.sha256 == sha256_of(bag / "bag_0.mcap")


def test_an_unreadable_input_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"missing\.mcap cannot be read: No such file"):
        input_files("recording", tmp_path / "missing.mcap")


def test_provenance_names_its_sources() -> None:
    assert PROVENANCE.source_name("recording") == "my bag"
    assert PROVENANCE.source_name("vehicle") == ""
