# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Output paths: what is refused, what `--force` replaces, and that a folder is written whole."""

from __future__ import annotations

from pathlib import Path

import pytest

from adk_ros.errors import UsageError
from adk_ros.files.output_folder import check_output_folder, refuse_existing, staged_folder

RESULT = ("mismatch.json", "report.html")


@pytest.mark.parametrize("force", [False, True])
def test_missing_paths_and_empty_folders_are_accepted(tmp_path: Path, force: bool) -> None:
    refuse_existing(tmp_path / "missing.csv", force)
    refuse_existing(tmp_path / "missing" / "folder", force, result_files=RESULT)
    empty = tmp_path / "empty"
    empty.mkdir()
    refuse_existing(empty, force, result_files=RESULT)
    (empty / ".gitkeep").touch()
    refuse_existing(empty, force, result_files=RESULT)


def test_an_existing_file_needs_force(tmp_path: Path) -> None:
    path = tmp_path / "prediction.csv"
    path.write_text("kept")
    with pytest.raises(UsageError, match=r"prediction\.csv exists already: add --force"):
        refuse_existing(path)
    refuse_existing(path, True)
    assert path.read_text() == "kept"


def test_a_dangling_link_counts_as_existing(tmp_path: Path) -> None:
    path = tmp_path / "link.csv"
    path.symlink_to(tmp_path / "elsewhere.csv")
    with pytest.raises(UsageError, match="exists already"):
        refuse_existing(path)


@pytest.mark.parametrize("force", [False, True])
def test_file_and_folder_are_not_exchanged(tmp_path: Path, force: bool) -> None:
    with pytest.raises(UsageError, match="is a folder: name a file for --out"):
        refuse_existing(tmp_path, force)
    path = tmp_path / "notes.txt"
    path.touch()
    with pytest.raises(UsageError, match="is a file: name a folder for --out"):
        refuse_existing(path, force, result_files=RESULT)


@pytest.mark.parametrize("force", [False, True])
def test_a_folder_without_an_earlier_result_is_refused(tmp_path: Path, force: bool) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(UsageError, match="not empty and holds no earlier result") as caught:
        refuse_existing(tmp_path, force, result_files=RESULT)
    assert "\n" not in str(caught.value)
    assert (tmp_path / "thesis.tex").read_text() == "years of work"


def test_an_earlier_result_needs_force(tmp_path: Path) -> None:
    (tmp_path / "mismatch.json").write_text("{}")
    (tmp_path / "notes.txt").touch()
    with pytest.raises(UsageError, match="holds an earlier result: add --force to replace it"):
        refuse_existing(tmp_path, result_files=RESULT)
    refuse_existing(tmp_path, True, result_files=RESULT)


def test_result_files_may_be_patterns(tmp_path: Path) -> None:
    (tmp_path / "predicted").mkdir()
    (tmp_path / "predicted" / "bag_0.mcap").touch()
    with pytest.raises(UsageError, match="holds an earlier result"):
        refuse_existing(tmp_path, result_files=("predicted/*.mcap",))


def test_check_output_folder_names_the_file_in_the_way(tmp_path: Path) -> None:
    blocking = tmp_path / "file"
    blocking.touch()
    with pytest.raises(UsageError, match=r"file is a file; name another folder for --out"):
        check_output_folder(blocking / "below")
    check_output_folder(tmp_path / "a" / "b")


def test_staged_folder_replaces_an_earlier_result_and_keeps_other_files(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with staged_folder(out, RESULT) as staged:
        (staged / "mismatch.json").write_text("1")
        (staged / "figures").mkdir()
        (staged / "figures" / "old.png").touch()
    (out / "notes.txt").write_text("mine")
    (out / "old.png").touch()
    with staged_folder(out, RESULT, ("old.png",)) as staged:
        (staged / "mismatch.json").write_text("2")
        (staged / "figures").mkdir()
        (staged / "figures" / "new.png").touch()
    assert (out / "mismatch.json").read_text() == "2"
    assert [path.name for path in (out / "figures").iterdir()] == ["new.png"]
    assert sorted(path.name for path in out.iterdir()) == ["figures", "mismatch.json", "notes.txt"]


def test_an_exception_leaves_the_folder_unchanged(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with staged_folder(out, RESULT) as staged:
        (staged / "mismatch.json").write_text("1")

    def interrupted() -> None:
        with staged_folder(out, RESULT) as staged:
            (staged / "mismatch.json").write_text("2")
            raise RuntimeError("interrupted")

    with pytest.raises(RuntimeError, match="interrupted"):
        interrupted()
    assert [(path.name, path.read_text()) for path in out.iterdir()] == [("mismatch.json", "1")]
