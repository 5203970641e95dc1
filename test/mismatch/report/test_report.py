# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The page of `adk mismatch`: whole, by itself, and written with all its files or not at all."""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from helpers.mismatch_report import bank, drag, findings, found, late, odd

from adk_ros.cli.main import main
from adk_ros.errors import UsageError
from adk_ros.files.output_folder import check_output_folder
from adk_ros.mismatch.inference.result import MismatchResult
from adk_ros.mismatch.report import result_files
from adk_ros.mismatch.report.report_page import FIGURES, write_page
from adk_ros.mismatch.report.result_files import as_dict, write_report
from adk_ros.mismatch.report.summary import sentence

VOID = {"meta", "img", "br"}
ALWAYS = {"map.png", "timeline.png", "errors.png", "remains.png"}
MADE: dict[str, Callable[[], MismatchResult]] = {
    "none": findings,
    "drag": drag,
    "bank": bank,
    "late": late,
    "odd": lambda: odd(found()),
}


class Page(HTMLParser):
    """What a browser would meet: tags that match, images with their words, text."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.source = path.read_text(encoding="utf-8")
        self.open: list[str] = []
        self.tags: set[str] = set()
        self.images: list[tuple[str, bytes]] = []
        self.words: list[str] = []
        self.feed(self.source)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        given = dict(attrs)
        if tag == "img":
            head = "data:image/png;base64,"
            address = given["src"] or ""
            assert address.startswith(head)
            picture = base64.b64decode(address.removeprefix(head), validate=True)
            self.images.append((given["alt"] or "", picture))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] != "style":
            self.words.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    base = tmp_path_factory.mktemp("reports")
    for name, make in MADE.items():
        write_report(make(), base / name)
    return {name: base / name for name in MADE}


@pytest.mark.parametrize("name", MADE)
def test_the_page_is_whole_and_stands_by_itself(name: str, folders: dict[str, Path]) -> None:
    page = Page(folders[name] / "report.html")
    assert page.open == []
    assert {"html", "head", "title", "body", "table", "img"} <= page.tags
    assert not page.tags & {"script", "link", "iframe", "object", "embed", "base"}
    assert "http" not in page.source
    assert "url(" not in page.source
    assert sentence(MADE[name]()) in page.text
    better = "How far off the simulation is" if name == "none" else "How much better"
    for heading in ("Where", better, "What remains", "What to drive next", "How it was judged"):
        assert heading in page.text


@pytest.mark.parametrize("name", MADE)
def test_all_figures_lie_beside_the_page_and_in_it(name: str, folders: dict[str, Path]) -> None:
    page = Page(folders[name] / "report.html")
    files = {path.name: path.read_bytes() for path in folders[name].glob("*.png")}
    assert set(files) >= ALWAYS
    assert set(files) <= set(FIGURES)
    assert sorted(picture for _, picture in page.images) == sorted(files.values())
    assert all(alt for alt, _ in page.images)
    for content in files.values():
        image = matplotlib.image.imread(io.BytesIO(content))
        assert min(image.shape[:2]) > 200
        dark = image[..., :3].min(axis=2) < 0.7
        # Ink all over the picture, more than an empty frame has.
        assert (dark.mean(axis=0) > 0.0).mean() > 0.5
        assert np.var(image[..., :3]) > 1e-3


def test_each_effect_and_each_piece_has_its_figure(folders: dict[str, Path]) -> None:
    own = {
        name: {p.name for p in folder.glob("*.png")} - ALWAYS for name, folder in folders.items()
    }
    assert own == {
        "none": set(),
        "drag": {"evidence_aero_drag.png"},
        "bank": {"evidence_road_bank.png"},
        "late": {"evidence_steering_delay.png"},
        "odd": {"evidence_aero_drag.png", "remainder_1.png"},
    }


def test_the_folder_holds_the_contracts_files(folders: dict[str, Path]) -> None:
    for name, folder in folders.items():
        told = json.loads((folder / "mismatch.json").read_text())
        assert told["verdict"] == MADE[name]().verdict
        assert (folder / "simulation.yaml").read_text() == "model: stand_in\n"
        assert (folder / "corrected.yaml").exists()
        assert not list(folder.parent.glob(".mismatch_*"))


def test_none_says_so_and_claims_no_evidence(folders: dict[str, Path]) -> None:
    text = Page(folders["none"] / "report.html").text
    assert "The simulation stands for the car as it is" in text
    assert "The evidence" not in text
    assert "Rivals" not in text


def test_where_little_could_be_found_nothing_is_vouched_for(tmp_path: Path) -> None:
    base = MADE["none"]()
    off = replace(base, surrogate_error=base.surrogate_error | {"v_x": 0.1})
    write_report(off, tmp_path / "off")
    text = Page(tmp_path / "off" / "report.html").text
    assert "The simulation stands for the car as it is" not in text
    assert "Nothing needs to be told apart" not in text
    assert "on a flat road" in text
    told = json.loads((tmp_path / "off" / "mismatch.json").read_text())
    assert "v_x, odometry (0.1 m/s)" in told["caveat"]
    assert told["stand_in_error"]["v_x"] == 0.1
    assert "caveat" not in as_dict(base)


def test_rivals_and_ties_are_there(folders: dict[str, Path]) -> None:
    text = Page(folders["drag"] / "report.html").text
    assert "Rivals, and why they lost" in text
    assert "cannot be told apart on this drive" in text
    assert "explains a part only" in text
    assert "air drag or wind along the road" in text


def test_the_unexplained_is_there_with_its_formula(folders: dict[str, Path]) -> None:
    text = Page(folders["odd"] / "report.html").text
    assert "No effect of the catalogue explains a yaw acceleration" in text
    assert "d(yaw_rate)/dt += -6.1 r / v_x" in text
    assert "41 % of what there was to explain" in text


def test_what_findings_say_is_text_and_not_markup(tmp_path: Path) -> None:
    base = odd()
    assert base.unexplained is not None
    evil = replace(
        base,
        notes=['<b>bold</b> & "quoted"'],
        unexplained=replace(base.unexplained, expression="<script>alert(1)</script>"),
    )
    page = Page(write_page(evil, tmp_path))
    assert '<b>bold</b> & "quoted"' in page.text
    assert "<script>alert(1)</script>" in page.text
    assert not page.tags & {"b", "script"}


def test_a_drive_without_laps_is_drawn_as_it_was_driven(tmp_path: Path) -> None:
    base = drag()
    alone = replace(base, lap_m=None, series=replace(base.series, distance=None))
    assert len(Page(write_page(alone, tmp_path)).images) == 5


def test_a_report_replaces_an_earlier_one_and_nothing_else(tmp_path: Path) -> None:
    out = tmp_path / "report"
    write_report(drag(), out)
    (out / "mine.txt").write_text("keep")
    write_report(findings(), out)
    names = {path.name for path in out.iterdir()}
    assert names == ALWAYS | {
        "report.html",
        "mismatch.json",
        "simulation.yaml",
        "corrected.yaml",
        "held_out.yaml",
        "mine.txt",
    }


@pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError])
def test_interrupted_it_leaves_no_half_report(
    error: type[BaseException], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(what: MismatchResult, out: Path) -> Path:
        (out / "map.png").write_bytes(b"half")
        raise error

    monkeypatch.setattr(result_files, "write_page", stop)
    with pytest.raises(error):
        write_report(drag(), tmp_path / "new")
    assert list(tmp_path.iterdir()) == []
    old = tmp_path / "old"
    old.mkdir()
    (old / "report.html").write_text("earlier")
    with pytest.raises(error):
        write_report(drag(), old)
    assert [path.name for path in old.iterdir()] == ["report.html"]


def test_a_folder_that_cannot_be_written_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "file"
    file.write_text("")
    for out in (file, file / "report"):
        with pytest.raises(UsageError, match="cannot be written"):
            write_report(findings(), out)
        with pytest.raises(UsageError, match=r"is a file; name another folder for --out"):
            check_output_folder(out)
    check_output_folder(tmp_path / "a" / "b")
    # Said before anything is read, let alone computed.
    bags = ["--simulation", str(tmp_path / "no"), "--recording", str(tmp_path / "no")]
    assert main(["mismatch", *bags, "--out", str(file / "report")]) == 2
    said = capsys.readouterr().err.strip()
    assert said.count("\n") == 0
    assert "cannot be written" in said
