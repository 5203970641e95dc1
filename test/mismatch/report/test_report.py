# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The page of `adk mismatch`: self-contained, and written with all its files or not at all."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from helpers.mismatch_report import bank, drag, identified, late, odd, result_of
from helpers.pages import (
    PROVENANCE,
    Page,
    assert_contents,
    assert_provenance,
    assert_self_contained,
)

from adk_ros.cli.main import main
from adk_ros.errors import UsageError
from adk_ros.files.output_folder import check_output_folder
from adk_ros.files.pages.provenance import Provenance
from adk_ros.mismatch.inference.result import MismatchResult
from adk_ros.mismatch.report import result_files
from adk_ros.mismatch.report.report_page import FIGURES, page_title, write_page
from adk_ros.mismatch.report.result_files import as_dict, write_report
from adk_ros.mismatch.report.summary import sentence

ALWAYS = {"map.png", "timeline.png", "errors.png", "remains.png"}
MADE: dict[str, Callable[[], MismatchResult]] = {
    "none": result_of,
    "drag": drag,
    "bank": bank,
    "late": late,
    "odd": lambda: odd(identified()),
}


def page_of(folder: Path) -> Page:
    return Page((folder / "report.html").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    base = tmp_path_factory.mktemp("reports")
    for name, make in MADE.items():
        write_report(make(), base / name, provenance=PROVENANCE)
    return {name: base / name for name in MADE}


@pytest.mark.parametrize("name", MADE)
def test_the_page_is_self_contained_and_states_provenance(
    name: str, folders: dict[str, Path]
) -> None:
    page = page_of(folders[name])
    assert_self_contained(page)
    assert_contents(page)
    assert_provenance(page)
    assert {"table", "img"} <= page.tags
    assert sentence(MADE[name]()) in page.text
    errors = "Simulation error" if name == "none" else "Improvement on held-out data"
    headings = list(page.headings.values())
    for heading in (
        "Summary", "Location of the differences", errors, "Unexplained residual",
        "What to record next", "Method and notes", "Provenance",
    ):  # fmt: skip
        assert heading in headings


@pytest.mark.parametrize("name", MADE)
def test_all_figures_are_files_and_embedded(name: str, folders: dict[str, Path]) -> None:
    page = page_of(folders[name])
    files = {path.name: path.read_bytes() for path in folders[name].glob("*.png")}
    assert set(files) >= ALWAYS
    assert set(files) <= set(FIGURES)
    assert sorted(picture for _, picture in page.images) == sorted(files.values())
    assert all(alt for alt, _ in page.images)
    for content in files.values():
        image = matplotlib.image.imread(io.BytesIO(content))
        assert min(image.shape[:2]) > 200
        dark = image[..., :3].min(axis=2) < 0.7
        # Dark pixels all over the picture, more than an empty frame has.
        assert (dark.mean(axis=0) > 0.0).mean() > 0.5
        assert np.var(image[..., :3]) > 1e-3


def test_each_effect_and_each_feature_term_has_a_figure(folders: dict[str, Path]) -> None:
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


def test_the_folder_holds_result_and_models(folders: dict[str, Path]) -> None:
    for name, folder in folders.items():
        written = json.loads((folder / "mismatch.json").read_text())
        assert written["verdict"] == MADE[name]().verdict
        assert (folder / "simulation.yaml").read_text() == "model: surrogate\n"
        assert (folder / "corrected.yaml").exists()
        assert not list(folder.parent.glob(".mismatch_*"))


def test_no_mismatch_shows_no_evidence_and_no_alternatives(folders: dict[str, Path]) -> None:
    text = page_of(folders["none"]).text
    assert "The simulation agrees with the recording" in text
    assert "Evidence" not in text
    assert "Alternatives" not in text


@pytest.mark.usefixtures("unrendered")
def test_an_underfitting_surrogate_makes_the_result_inconclusive(tmp_path: Path) -> None:
    base = MADE["none"]()
    off = replace(base, surrogate_error=base.surrogate_error | {"v_x": 0.1})
    write_report(off, tmp_path / "off")
    text = page_of(tmp_path / "off").text
    assert "The simulation agrees with the recording" not in text
    assert "No further recording is needed" not in text
    assert "on a flat road" in text
    written = json.loads((tmp_path / "off" / "mismatch.json").read_text())
    assert "odometry speed (0.1 m/s)" in written["caveat"]
    assert written["surrogate_error"]["v_x"] == 0.1
    assert "caveat" not in as_dict(base)


def test_competing_effects_are_written_with_their_loss_difference(
    folders: dict[str, Path],
) -> None:
    written = json.loads((folders["drag"] / "mismatch.json").read_text())
    (effect,) = written["effects"]
    assert effect["alternatives"] == ["headwind"]
    assert effect["competing_effects"] == [
        {"name": "headwind", "loss_difference": 3.0},
        {"name": "payload", "loss_difference": 20000.0},
    ]


def test_alternatives_and_ties_are_listed(folders: dict[str, Path]) -> None:
    text = page_of(folders["drag"]).text
    assert "Alternatives and why they were rejected" in text
    assert "not distinguishable in this recording" in text
    assert "rejected: only a part of the loss reduction" in text
    assert "air drag or longitudinal wind" in text


def test_residuals_and_models_have_different_labels(folders: dict[str, Path]) -> None:
    text = page_of(folders["drag"]).text
    assert "with identified effects" in text
    assert "corrected vehicle model" in text
    assert "with identified effects and formula" in page_of(folders["odd"]).text
    assert "within build tolerance noise" in page_of(folders["none"]).text


def test_the_unexplained_residual_is_shown_with_its_formula(folders: dict[str, Path]) -> None:
    text = page_of(folders["odd"]).text
    assert "No effect of the catalogue explains a yaw acceleration" in text
    assert "d(yaw_rate)/dt += -6.1 r / v_x" in text
    assert "41 % of the excess loss" in text


@pytest.mark.parametrize(
    ("sources", "title"),
    [
        (("a/flat", "b/hilly"), "Simulation vs recording: flat vs hilly"),
        (("a/simulation", "b/recording"), "Simulation vs recording: a/simulation vs b/recording"),
        (("simulation", "recording"), "Simulation vs recording"),
    ],
)
def test_the_title_names_the_inputs(sources: tuple[str, str], title: str) -> None:
    inputs = tuple(
        replace(file, source=source)
        for file, source in zip(PROVENANCE.inputs, sources, strict=True)
    )
    assert page_title(replace(PROVENANCE, inputs=inputs)) == title


def test_terms_are_defined_once(folders: dict[str, Path]) -> None:
    text = page_of(folders["drag"]).text
    for definition in (
        "residual of the surrogate model on the simulation itself",
        "differences between a car and its",
        "sum of squared whitened residuals",
        "Huber",
    ):
        assert text.count(definition) == 1


@pytest.mark.usefixtures("unrendered")
def test_texts_are_escaped(tmp_path: Path) -> None:
    base = odd()
    assert base.unexplained is not None
    evil = replace(
        base,
        notes=['<b>bold</b> & "quoted"'],
        unexplained=replace(base.unexplained, expression="<script>alert(1)</script>"),
    )
    page = Page(write_page(evil, tmp_path).read_text())
    assert '<b>bold</b> & "quoted"' in page.text
    assert "<script>alert(1)</script>" in page.text
    assert not page.tags & {"b", "script"}


def test_a_recording_without_laps_has_all_figures(tmp_path: Path) -> None:
    base = drag()
    alone = replace(base, lap_m=None, series=replace(base.series, distance=None))
    assert len(Page(write_page(alone, tmp_path).read_text()).images) == 5


@pytest.mark.usefixtures("unrendered")
def test_a_report_replaces_an_earlier_one_and_nothing_else(tmp_path: Path) -> None:
    out = tmp_path / "report"
    write_report(drag(), out)
    (out / "mine.txt").write_text("keep")
    write_report(result_of(), out)
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
@pytest.mark.usefixtures("unrendered")
def test_an_interruption_leaves_no_partial_report(
    error: type[BaseException], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(result: MismatchResult, out: Path, *, provenance: Provenance | None) -> Path:
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


@pytest.mark.usefixtures("unrendered")
def test_an_unwritable_folder_is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "file"
    file.write_text("")
    for out in (file, file / "report"):
        with pytest.raises(UsageError, match="cannot be written"):
            write_report(result_of(), out)
        with pytest.raises(UsageError, match=r"is a file; name another folder for --out"):
            check_output_folder(out)
    check_output_folder(tmp_path / "a" / "b")
    # Refused before anything is read or computed.
    bags = ["--simulation", str(tmp_path / "no"), "--recording", str(tmp_path / "no")]
    assert main(["mismatch", *bags, "--out", str(file / "report")]) == 2
    said = capsys.readouterr().err.strip()
    assert said.count("\n") == 0
    assert "cannot be written" in said
