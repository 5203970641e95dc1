# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings in folders, globs and URLs, their content hashes, and the table of tags."""

from __future__ import annotations

import errno
import os
import shutil
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from adk_ros.errors import DataError, UsageError
from adk_ros.fleet import store
from adk_ros.fleet.recording_work import run_on_recording
from adk_ros.fleet.recordings import (
    RecordingChanged,
    _is_stored,
    content_hash,
    find_recordings,
    local_recording,
)
from adk_ros.fleet.tags import Tags, read_tags, tags_beside, write_tags


def touch(path, text="x"):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


@pytest.fixture
def drives(tmp_path):
    folder = tmp_path / "drives"
    touch(folder / "town" / "metadata.yaml")
    touch(folder / "town" / "town_0.mcap")
    touch(folder / "town" / "town_1.mcap")
    touch(folder / "car" / "a.mcap", "a")
    touch(folder / "car" / "b.db3", "b")
    touch(folder / "cut" / "cut_0.mcap")
    touch(folder / "cut" / "cut_1.mcap")
    touch(folder / "old.bag")
    touch(folder / ".hidden" / "c.mcap")
    touch(folder / "notes.txt")
    return folder


def names(*given):
    return [recording.name for recording in find_recordings([str(each) for each in given])]


def test_folder(drives) -> None:
    assert names(drives) == ["car/a.mcap", "car/b.db3", "cut", "old.bag", "town"]
    by_name = {recording.name: recording for recording in find_recordings([str(drives)])}
    assert len(by_name["cut"].files) == 2
    assert len(by_name["town"].files) == 3


def test_a_single_bag_a_file_and_a_glob(drives) -> None:
    assert names(drives / "town") == ["town"]
    assert names(drives / "car" / "a.mcap") == ["a.mcap"]
    assert names(drives / "c*") == ["car/a.mcap", "car/b.db3", "cut"]
    assert names(drives / "car" / "*.db3", drives / "town") == ["b.db3", "town"]


def test_overlapping_arguments_give_a_recording_once(drives) -> None:
    assert len(find_recordings([str(drives), str(drives / "town")])) == 5


def test_folders_behind_links(drives, tmp_path) -> None:
    disk = tmp_path / "disk"
    touch(disk / "car 7" / "far.mcap")
    touch(disk / "one.mcap", "first")
    (drives / "linked").symlink_to(disk / "car 7")
    (drives / "same").symlink_to(drives / "car")
    (drives / "car" / "loop").symlink_to(drives)
    (drives / "one.mcap").symlink_to(disk / "one.mcap")
    expected = ["car/a.mcap", "car/b.db3", "cut", "linked/far.mcap", "old.bag", "one.mcap", "town"]
    assert names(drives) == expected
    assert names(drives / "*" / "far.mcap") == ["far.mcap"]
    assert names(drives / "li*") == ["linked/far.mcap"]
    # Written again behind its link: size and time are those of what the link leads to.
    (before,) = find_recordings([str(drives / "one.mcap")])
    touch(disk / "one.mcap", "other")
    os.utime(disk / "one.mcap", (1.0, 1.0))
    (after,) = find_recordings([str(drives / "one.mcap")])
    assert after.size == before.size == 5
    assert after.version != before.version
    (disk / "one.mcap").unlink()
    assert names(drives) == expected
    shutil.rmtree(disk)
    with pytest.raises(UsageError, match=rf"linked is a link to {disk}/car 7, which is not there"):
        find_recordings([str(drives)])


def test_a_folder_that_cannot_be_read(drives, monkeypatch) -> None:
    scan, locked = os.scandir, str(drives / "car")

    def refusing(path):
        if path == locked:
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), path)
        return scan(path)

    touch(drives / "lost+found" / "x.mcap")
    assert "lost+found/x.mcap" not in names(drives)
    monkeypatch.setattr(os, "scandir", refusing)
    with pytest.raises(UsageError, match=rf"^{locked} cannot be read: Permission denied"):
        find_recordings([str(drives)])


@pytest.mark.parametrize("place", [b"caf\xe9.mcap", b"caf\xe9/metadata.yaml"])
def test_a_name_that_is_not_utf8_is_a_line(drives, place) -> None:
    touch(drives / os.fsdecode(place))
    touch(drives / os.fsdecode(b"notes \xe9.txt"))
    with pytest.raises(
        UsageError, match=r"drives/caf\\udce9\S*: .* not UTF-8: rename it"
    ) as found:
        find_recordings([str(drives)])
    assert str(found.value).isascii()


def test_what_is_refused(drives, tmp_path) -> None:
    with pytest.raises(UsageError, match="no-such does not exist"):
        find_recordings([str(tmp_path / "no-such")])
    with pytest.raises(UsageError, match="no recording"):
        find_recordings([str(touch(tmp_path / "empty" / "x.txt").parent)])
    shutil.copytree(drives / "town", tmp_path / "other" / "town")
    with pytest.raises(UsageError, match="both named town"):
        find_recordings([str(drives), str(tmp_path / "other")])
    with pytest.raises(UsageError, match="unheard"):
        find_recordings(["unheard://bucket/x"])


def test_the_hash_is_that_of_the_content(drives, tmp_path) -> None:
    (town,) = find_recordings([str(drives / "town")])
    before = content_hash(town)
    shutil.move(drives / "town", tmp_path / "moved")
    (moved,) = find_recordings([str(tmp_path / "moved")])
    assert moved.name == "moved"
    assert content_hash(moved) == before
    touch(tmp_path / "moved" / "town_1.mcap", "longer")
    (changed,) = find_recordings([str(tmp_path / "moved")])
    assert changed.version != moved.version
    assert content_hash(changed) != before


def test_files_of_other_names_count_as_the_same_file(tmp_path) -> None:
    for name, text in (("a", "same"), ("b", "same"), ("c", "other")):
        touch(tmp_path / f"{name}.mcap", text)
    a, b, c = map(content_hash, find_recordings([str(tmp_path)]))
    assert a == b != c


def test_a_removed_file_is_a_refusal(drives) -> None:
    (recording,) = find_recordings([str(drives / "old.bag")])
    (drives / "old.bag").unlink()
    with pytest.raises(UsageError, match=r"old\.bag cannot be read"):
        content_hash(recording)


def test_a_store_in_memory_is_copied_and_removed_again() -> None:
    system, _ = store.file_system("memory://fleet")
    for name in ("town/metadata.yaml", "town/town_0.mcap", "a.mcap"):
        with system.open(f"/fleet/{name}", "w") as file:
            file.write(name)
    a, town = find_recordings(["memory://fleet"])
    assert (a.name, town.name) == ("a.mcap", "town")
    assert a.uri == "memory:///fleet/a.mcap"
    with local_recording(town) as path:
        assert sorted(each.name for each in path.iterdir()) == ["metadata.yaml", "town_0.mcap"]
    assert not path.parent.exists()
    with local_recording(a) as path:
        assert path.read_text() == "a.mcap"
    assert not path.exists()
    assert len(content_hash(town)) == 64


def test_an_object_that_was_replaced_is_not_the_one_that_was_listed() -> None:
    system, _ = store.file_system("memory://fleet")
    system.pipe("/replaced/a.mcap", b"first")
    (recording,) = find_recordings(["memory://replaced"])
    assert len(content_hash(recording)) == 64
    tagged = replace(recording, entity_tags=("1",))

    def with_tag(tag: str) -> SimpleNamespace:
        info = {"name": "/replaced/a.mcap", "size": 5, "ETag": f'"{tag}"'}
        return SimpleNamespace(invalidate_cache=lambda: None, info=lambda _: info)

    assert _is_stored(with_tag("1"), tagged)
    assert not _is_stored(with_tag("2"), tagged)
    system.pipe("/replaced/a.mcap", b"second")
    with pytest.raises(RecordingChanged, match="has changed while it was read"):
        content_hash(recording)
    with (
        pytest.raises(RecordingChanged, match="has changed while it was read"),
        local_recording(recording),
    ):
        pass
    system.rm("/replaced/a.mcap")
    with (
        pytest.raises(RecordingChanged, match="has been removed from the store"),
        local_recording(recording),
    ):
        pass


def test_an_outage_is_survived_or_reported_in_a_line() -> None:
    calls = []

    def fails_twice():
        calls.append(1)
        if len(calls) < 3:
            raise ConnectionError("refused")
        return "there"

    assert store.with_retries("s3://bucket", fails_twice, outage_s=10.0) == "there"

    def fails():
        raise ConnectionError("refused")

    with pytest.raises(store.StoreUnreachable, match="does not answer for 0 s"):
        store.with_retries("s3://bucket", fails, outage_s=0.0)
    with pytest.raises(ConnectionError):
        store.with_retries("/a/folder", fails)

    class Refused(RuntimeError):
        response = {"Error": {"Code": "ExpiredToken"}}  # noqa: RUF012

    def expired():
        cause = Refused("The provided token has expired.")
        raise PermissionError("The provided token has expired.") from cause

    with pytest.raises(store.StoreUnreachable, match=r"credentials \(ExpiredToken\): renew"):
        store.with_retries("s3://bucket", expired)

    def denied():
        raise PermissionError("Access Denied")

    with pytest.raises(PermissionError):
        store.with_retries("s3://bucket", denied)
    with pytest.raises(FileNotFoundError):
        store.with_retries("s3://bucket", Path("/no/such/file").read_text)


def test_a_row_without_a_name_is_of_no_recording(tmp_path) -> None:
    """Names of rosbag2 folders have no ending, which left an empty name for one of them."""
    for name in ("run_01", "run_02"):
        (tmp_path / "drives" / name).mkdir(parents=True)
        touch(tmp_path / "drives" / name / "metadata.yaml", "x")
        touch(tmp_path / "drives" / name / f"{name}_0.mcap", name)
    found = find_recordings([str(tmp_path / "drives")])
    table = touch(tmp_path / "fleet.csv", "recording,vehicle,time\nrun_02,B,\n,,\n")
    assert {name: each.vehicle for name, each in read_tags(table, found).tags.items()} == {
        "run_02": "B"
    }
    table = touch(tmp_path / "fleet.csv", "recording,vehicle,time\nrun_02,B,\n,C,\n")
    with pytest.raises(UsageError, match=r"fleet\.csv:3: the name of the recording is missing"):
        read_tags(table, found)


TABLE = """recording,vehicle,time,rain,tyres
town, car 1 ,2026-03-01T10:00:00,no,summer
old,car 2,2026-03-02T10:00:00+01:00,yes,winter
car/a.mcap,car 2,,no,
"""


def test_tags(drives, tmp_path) -> None:
    found = find_recordings([str(drives)])
    tags = read_tags(touch(tmp_path / "fleet.csv", TABLE), found).tags
    assert tags["town"] == Tags("car 1", 1772359200.0, {"rain": "no", "tyres": "summer"})
    assert tags["old.bag"].time_s == 1772442000.0
    assert tags["car/a.mcap"].time_s is None
    write_tags(tmp_path / "again.csv", tags)
    assert read_tags(tmp_path / "again.csv", found).tags == tags


def test_tags_beside_a_glob(drives, tmp_path, monkeypatch) -> None:
    path = touch(drives / "fleet.csv", TABLE)
    monkeypatch.chdir(tmp_path)
    for given in ("*", "c*", "?ar/", "[ct]*/*.mcap", ""):
        assert Path(str(tags_beside([f"{drives}/{given}"]))) == path, given
    assert tags_beside([str(drives / "c*"), str(drives / "t*")]) == str(path)
    assert tags_beside(["drives/*"]) == "drives/fleet.csv"
    assert tags_beside([str(drives / "car" / "*")]) is None
    assert tags_beside(["dr*"]) is None
    touch(tmp_path / "fleet.csv", TABLE)
    assert tags_beside(["dr*"]) == "./fleet.csv"
    with pytest.raises(UsageError, match="name one file for all recordings with --tags"):
        tags_beside(["dr*", "drives/*"])


def test_a_table_names_paths_below_its_folder(drives) -> None:
    path = touch(drives / "fleet.csv", TABLE)
    found = find_recordings([str(drives / "*" / "a.*"), str(drives / "town")])
    assert [each.name for each in found] == ["a.mcap", "town"]
    tags = read_tags(path, found).tags
    assert {name: each.vehicle for name, each in tags.items()} == {
        "a.mcap": "car 2", "town": "car 1"
    }  # fmt: skip


def test_tags_in_a_store() -> None:
    system, _ = store.file_system("memory://tagged")
    for name, text in (("a.mcap", "x"), ("car/b.mcap", "y"), ("fleet.csv", TABLE)):
        with system.open(f"/tagged/drives/{name}", "w") as file:
            file.write(text.replace("car/a.mcap", "car/b"))
    for given, expected in (
        ("memory://tagged/drives", {"car/b.mcap": "car 2"}),
        ("memory://tagged/drives/", {"car/b.mcap": "car 2"}),
        ("memory://tagged/drives/*/*", {"b.mcap": "car 2"}),
    ):
        path = tags_beside([given])
        assert path == "memory://tagged/drives/fleet.csv"
        tags = read_tags(path, find_recordings([given])).tags
        assert {name: each.vehicle for name, each in tags.items()} == expected
    assert tags_beside(["memory://tagged"]) is None
    system.pipe("/tagged/fleet.csv", b"recording,vehicle\n")
    with pytest.raises(UsageError, match=r"memory://tagged/fleet.csv: column time missing"):
        read_tags("memory://tagged/fleet.csv", [])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("recording,car\nx,y\n", "column vehicle, time missing"),
        ("", "column recording, vehicle, time missing"),
        ("recording,vehicle,time,rain,rain\n", "column rain in line 1"),
        ("recording,vehicle,time\ntown,A\n", "fleet.csv:2: 3 columns expected"),
        ("recording,vehicle,time\ntown,A,,x\n", "fleet.csv:2: 3 columns expected"),
        ("recording,vehicle,time\ntown,,\n", "fleet.csv:2: vehicle is empty"),
        ("recording,vehicle,time\ntown,A,yesterday\n", "fleet.csv:2: time 'yesterday' is not"),
        ("recording,vehicle,time\ntown,A,\ntown,B,\n", "fleet.csv:3: town is listed twice"),
        ("recording,vehicle,time\nx,A,\n", "lists none of the recordings"),
    ],
)
def test_tags_that_are_refused(drives, tmp_path, text, message) -> None:
    with pytest.raises(UsageError, match=message):
        read_tags(touch(tmp_path / "fleet.csv", text), find_recordings([str(drives)]))


def test_a_table_that_cannot_be_read(drives, tmp_path) -> None:
    with pytest.raises(UsageError, match="cannot be read"):
        read_tags(tmp_path / "none.csv", [])
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(UsageError, match="cannot be read"):
        read_tags(tmp_path / "binary.csv", [])


@dataclass(frozen=True)
class NamingStage:
    """Names the path that it reads; refuses a recording of one byte."""

    name: str = "naming"
    inputs_hash: str = ""
    shared_paths: tuple[str, ...] = ()

    def run(self, path, recording):
        if path.stat().st_size == 1:
            raise DataError(f"bag {path} is damaged")
        return [{"finding": "path", "text": f"{path} is read", "value": 1.0}]


def test_texts_name_the_recording_and_not_its_copy() -> None:
    memory, _ = store.file_system("memory://texts")
    memory.pipe("/texts/a.mcap", b"aa")
    memory.pipe("/texts/b.mcap", b"b")
    good, bad = find_recordings(["memory://texts"])
    (row,) = run_on_recording(NamingStage(), good)
    assert row == {"finding": "path", "text": f"{good.uri} is read", "value": 1.0}
    with pytest.raises(DataError, match=f"^bag {bad.uri} is damaged$"):
        run_on_recording(NamingStage(), bad)
