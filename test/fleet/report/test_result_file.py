# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The result of a fleet as a file: read back, and the page that is written again from it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.small_fleet_result import RECORDINGS, small_result

from adk_ros.errors import DataError
from adk_ros.files.pages.provenance import InputFile, Provenance
from adk_ros.fleet.report.file_names import DATA, PAGE
from adk_ros.fleet.report.fleet_page import rewrite_fleet_page, write_fleet_page
from adk_ros.fleet.report.result_file import PageContext, read_result, write_result

REPORT = "recordings/0a/day%201/report.html"
CONTEXT = PageContext(
    {"drive24": REPORT},
    {"drive23": "stands still <always>"},
    (("bad.mcap", "bag is truncated"),),
    3,
    Provenance(
        "adk fleet mismatch drives", "0.1.0", "2026-03-01 12:00:00 UTC", 61.5,
        (InputFile("simulation", "sim", "sim/a.mcap", 9, "00ff"),),
    ),
)  # fmt: skip


def written(folder: Path) -> Path:
    """Write result, page, a corrected model and a report; return the page."""
    report = folder / "recordings" / "0a" / "day 1" / "report.html"
    report.parent.mkdir(parents=True)
    report.touch()
    return write_fleet_page(small_result(), folder, CONTEXT, {"corrected_all.yaml": "terms: []"})


def test_a_result_is_read_back(tmp_path: Path) -> None:
    write_result(small_result(), CONTEXT, tmp_path / DATA)
    assert read_result(tmp_path / DATA) == (small_result(), CONTEXT)
    write_result(small_result(), PageContext(), tmp_path / DATA)
    assert read_result(tmp_path / DATA) == (small_result(), PageContext())
    assert [path.name for path in tmp_path.iterdir()] == [DATA]


@pytest.mark.usefixtures("unrendered")
def test_the_page_is_written_again_without_analysis(tmp_path: Path) -> None:
    page = written(tmp_path)
    text, data = page.read_text(), (tmp_path / DATA).read_bytes()
    known = (tmp_path / DATA).stat().st_mtime_ns
    for path in (page, tmp_path / "map.png", tmp_path / "trend_0.png"):
        path.unlink()
    assert rewrite_fleet_page(tmp_path) == page
    assert page.read_text() == text
    for part in (
        "more drag area", "onset between day 8.5 and 11.2", "bag is truncated", "61.5 s", "00ff",
        "3 recordings begin at x = y = 0", 'href="corrected_all.yaml"', f'href="{REPORT}"',
    ):  # fmt: skip
        assert part in text, part
    # Its time says whether evidence is newer than the result.
    assert (tmp_path / DATA).read_bytes() == data
    assert (tmp_path / DATA).stat().st_mtime_ns == known
    assert (tmp_path / "corrected_all.yaml").is_file()


@pytest.mark.usefixtures("unrendered")
def test_a_report_that_is_gone_is_not_linked(tmp_path: Path) -> None:
    page = written(tmp_path)
    (tmp_path / "recordings" / "0a" / "day 1" / "report.html").unlink()
    rewrite_fleet_page(tmp_path)
    assert REPORT not in page.read_text()
    assert "<code>--reports 1</code>" in page.read_text()


@pytest.mark.usefixtures("unrendered")
def test_each_of_the_worst_recordings_has_a_report_or_says_what_makes_it(tmp_path: Path) -> None:
    text = written(tmp_path).read_text()
    table = text[text.index("Worst recordings</h2>") :]
    rows = [row for row in table[: table.index("</tbody>")].split("<tr>") if "<td>drive" in row]
    # The worst first, twenty of them.
    assert [row.split("</td>")[0] for row in rows] == [
        f"<td>drive{i:02d}" for i in range(RECORDINGS - 1, RECORDINGS - 21, -1)
    ]
    last = [row.split("<td>")[-1].split("</td>")[0] for row in rows]
    assert last[0] == f'<a href="{REPORT}">report</a>'
    assert last[1] == "failed: stands still &lt;always&gt; (--retry-failed)"
    assert last[2:] == [f"<code>--reports {i}</code>" for i in range(3, 21)]


@pytest.mark.usefixtures("unrendered")
def test_all_reports_that_were_asked_for_are_listed(tmp_path: Path) -> None:
    reports = {r.name: f"recordings/{r.name}/report.html" for r in small_result().recordings}
    text = write_fleet_page(small_result(), tmp_path, PageContext(reports)).read_text()
    assert text.count(">report</a>") == RECORDINGS
    assert "--reports 2" not in text


def of_schema(content: dict[str, Any]) -> None:
    content["schema"] = 1


def without_onsets(content: dict[str, Any]) -> None:
    del content["claims"][1]["onset_low_day"]


def with_text_as_size(content: dict[str, Any]) -> None:
    content["places"][0]["size"] = "large"


def of_an_unknown_effect(content: dict[str, Any]) -> None:
    content["not_claimed"][0]["effect"] = "magnetism"


def without_a_vehicle(content: dict[str, Any]) -> None:
    content["vehicles"].pop()


def without_the_claim_of_a_trend(content: dict[str, Any]) -> None:
    content["claims"].pop()


def without_cells(content: dict[str, Any]) -> None:
    content["places"][0]["centres"] = []


def without_page(content: dict[str, Any]) -> None:
    del content["page"]


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (of_schema, r"is of another version of adk_ros \(schema 1, not 2\)"),
        (without_onsets, r"is damaged \(claims\.1\.onset_low_day: Field required\)"),
        (with_text_as_size, r"is damaged \(places\.0\.size: "),
        (of_an_unknown_effect, r"is damaged \('magnetism\.mass' is no parameter"),
        (without_a_vehicle, r"is damaged \(a vehicle lacks a parameter\)"),
        (without_the_claim_of_a_trend, r"is damaged \(a trend is without a claim\)"),
        (without_cells, r"is damaged \(no recording, or a place without a cell\)"),
        (without_page, r"is damaged \(page: "),
    ],
)
def test_a_damaged_or_older_result_is_a_line(
    tmp_path: Path, change: Callable[[dict[str, Any]], None], problem: str
) -> None:
    path = tmp_path / DATA
    write_result(small_result(), CONTEXT, path)
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))
    with pytest.raises(DataError, match=rf"{DATA} {problem}.*: run 'adk fleet mismatch' again"):
        rewrite_fleet_page(tmp_path)
    assert not (tmp_path / PAGE).exists()


@pytest.mark.parametrize("content", [b"", b'{"schema": 2', b"[]", b"\xff\xfe"])
def test_what_is_no_json_is_a_line(tmp_path: Path, content: bytes) -> None:
    (tmp_path / DATA).write_bytes(content)
    with pytest.raises(DataError, match=r"fleet\.json is damaged \(.*\): run 'adk fleet"):
        read_result(tmp_path / DATA)
    with pytest.raises(DataError, match=r"none\.json cannot be read: No such file"):
        read_result(tmp_path / "none.json")
