# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Damaged bags: truncated, not closed, modified, without metadata or contradicting it."""

import os
import random
import re
import shutil
import signal
import sqlite3
import struct
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest
from helpers.bags import (
    COMMAND,
    IMU,
    JAZZY,
    ODOMETRY,
    START_NS,
    TYPES,
    drive,
    imu,
    mcap_file,
    record,
    same,
    text,
    write,
    write_ros1,
)
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionMode

from adk_ros.bags import Bag, BagWriter, find_topics, message
from adk_ros.errors import AdkError, DataError

CUT = re.compile(r"^\S+ is damaged or cut off after (\d+\.\d) s: (.*); (\d+) messages read$")


def damage(warning: str) -> re.Match[str]:
    """Return the parts of the warning about a damaged bag: seconds, fault, messages read."""
    match = CUT.match(warning)
    assert match is not None, warning
    return match


def ends(content, messages, page=None, ros1=False):
    """Return the end offset in `content` of each message, or of its database page."""
    found = []
    for topic, _, msg in messages:
        raw = bytes(JAZZY.serialize_cdr(msg, TYPES[topic]))
        if ros1:
            raw = bytes(JAZZY.cdr_to_ros1(raw, TYPES[topic]))[4:]
        end = content.index(raw) + len(raw)
        found.append(end if page is None else -(-end // page) * page)
    assert len(set(found)) == len(found) or page is not None
    return found


def until(messages, places, cut):
    return [x for x, end in zip(messages, places, strict=True) if end <= cut]


def read_cut(path, content, cut, expected):
    """Read `content` truncated at `cut`; require exactly the expected messages and a warning."""
    path.write_bytes(content[:cut])
    if not expected:
        with pytest.raises(DataError, match=r"contains no messages|is empty|is neither"):
            Bag(path)
        return ""
    with Bag(path) as bag:
        (warning,) = bag.warnings
        after_s, fault, kept = damage(warning).groups()
        assert int(kept) == len(expected) == bag.message_count
        last_s = (max(t for _, t, _ in expected) - min(t for _, t, _ in expected)) * 1e-9
        assert float(after_s) == pytest.approx(last_s, abs=0.051)
        same(bag.messages(), sorted(expected, key=lambda x: x[1]))
        assert len(list(bag.raw())) == len(expected)
        assert bag.warnings == [warning]
    return fault


def cuts(content, count, seed=1):
    return sorted(random.Random(seed).sample(range(len(content)), count))


@pytest.mark.parametrize("compression", [None, ""])
def test_cut_mcap(tmp_path, compression):
    """Uncompressed, with and without chunks: all messages before the cut are read."""
    messages = drive(300)
    content = mcap_file(tmp_path / "x.mcap", messages, compression, closed=False).read_bytes()
    places = ends(content, messages)
    for cut in [*cuts(content, 25), len(content)]:
        expected = until(messages, places, cut)
        fault = read_cut(tmp_path / "cut.mcap", content, cut, expected)
        assert fault in {"", "it ends without an index"}


def test_cut_mcap_of_rosbags(tmp_path):
    """One chunk followed by the index: cuts in the chunk and in the index."""
    messages = drive(300)
    content = (write(tmp_path / "bag", messages) / "bag.mcap").read_bytes()
    end = content.index(b"serialized_metadata")
    faults = set()
    places = ends(content, messages)
    for cut in [*cuts(content, 25), end, end + 800, len(content) - 40]:
        expected = until(messages, places, cut)
        faults.add(read_cut(tmp_path / "cut.mcap", content, cut, expected))
    assert faults == {
        "",
        "it ends without an index",
        "no message is lost, but the index is missing",
    }


def test_cut_sqlite(tmp_path):
    """Every row in a page before the cut is read, although the tree above it may be lost."""
    messages = drive(1500)
    content = (write(tmp_path / "bag", messages, "sqlite3") / "bag.db3").read_bytes()
    page = int.from_bytes(content[16:18], "big")
    places = ends(content, messages, page)
    for cut in [*cuts(content, 12), page - 1, 3 * page, len(content) - 1]:
        expected = until(messages, places, cut)
        fault = read_cut(tmp_path / "cut.db3", content, cut, expected)
        assert fault.startswith("it ends before its last page" if expected else "")


def test_cut_sqlite_in_a_message_longer_than_a_page(tmp_path):
    """Rows with overflow pages are read completely or skipped."""
    messages = [
        (COMMAND, START_NS + i, message(TYPES[COMMAND], effort=[float(i)] * (40 + 37 * i)))
        for i in range(60)
    ]
    content = (write(tmp_path / "bag", messages, "sqlite3") / "bag.db3").read_bytes()
    (tmp_path / "cut.db3").write_bytes(content[: len(content) // 2])
    with Bag(tmp_path / "cut.db3") as bag:
        found = list(bag.messages())
        assert 20 < len(found) == bag.message_count < 60
        times = [t for _, t, _ in found]
        assert times == sorted(times)
        for _, log_ns, msg in found:
            i = log_ns - START_NS
            assert list(msg.effort) == [float(i)] * (40 + 37 * i)
    # One page more than the header states: nothing is missing, but the tree is not used.
    (tmp_path / "open.db3").write_bytes(content + bytes(int.from_bytes(content[16:18], "big")))
    with Bag(tmp_path / "open.db3") as bag:
        assert damage(bag.warnings[0])[2] == "it was not closed"
        efforts = [(t, list(msg.effort)) for _, t, msg in bag.messages()]
        assert efforts == [(t, list(msg.effort)) for _, t, msg in messages]


def test_cut_ros1(tmp_path):
    messages = drive(300)
    content = write_ros1(tmp_path / "x.bag", messages).read_bytes()
    places = ends(content, messages, ros1=True)
    for cut in [*cuts(content, 25), len(content) - 1]:
        expected = until(messages, places, cut)
        fault = read_cut(tmp_path / "cut.bag", content, cut, expected)
        assert fault in {"", "it ends without an index"}


def test_ros1_of_a_killed_recorder(tmp_path):
    """A .bag.active file: the header has no index position yet."""
    messages = drive(100)
    content = bytearray(write_ros1(tmp_path / "x.bag", messages).read_bytes())
    at = content.index(b"index_pos=") + len(b"index_pos=")
    end = int.from_bytes(content[at : at + 8], "little")
    content[at : at + 8] = bytes(8)
    path = tmp_path / "x.bag.active"
    path.write_bytes(content[:end])
    with Bag(path) as bag:
        same(bag.messages(), messages)
        assert damage(bag.warnings[0])[2] == "it ends without an index"


@pytest.mark.parametrize("kind", ["zstd", "lz4", "file", "message", "bz2", "ros1-lz4"])
def test_cut_compressed(tmp_path, kind):
    """The first messages are read; a later cut leaves more of them."""
    messages = drive(6000)
    path = tmp_path / "cut"
    if kind == "lz4":
        source = mcap_file(tmp_path / "x.mcap", messages, "lz4")
    elif kind in {"bz2", "ros1-lz4"}:
        form = Ros1Writer.CompressionFormat
        source = write_ros1(tmp_path / "x.bag", messages, form.BZ2 if kind == "bz2" else form.LZ4)
    else:
        modes = {"zstd": "STORAGE", "file": "FILE", "message": "MESSAGE"}
        write(tmp_path / "bag", messages, mode=CompressionMode[modes[kind]])
        (source,) = (tmp_path / "bag").glob("bag.mcap*")
    content = source.read_bytes()
    counts = []
    for share in (0.35, 0.5, 0.75, 0.9):
        path.write_bytes(content[: int(share * len(content))])
        with Bag(path) as bag:
            found = list(bag.messages())
            same(found, messages[: len(found)])
            counts.append(len(found))
            (warning,) = bag.warnings
            assert int(damage(warning)[3]) == len(found)
    assert counts == sorted(counts)
    assert 0.1 * len(messages) < counts[0] < counts[-1] <= len(messages)
    assert counts[-1] > 0.7 * len(messages)


def test_missing_damaged_or_wrong_metadata(tmp_path):
    messages = drive(100)
    folder = write(tmp_path / "bag", messages, "sqlite3")
    metadata = folder / "metadata.yaml"
    original = metadata.read_text()
    for changed, warning in [
        ("a: [", "metadata.yaml cannot be parsed: the bag is read without it"),
        ("", "metadata.yaml cannot be parsed: the bag is read without it"),
        (original[:200], "metadata.yaml cannot be parsed: the bag is read without it"),
        (original.replace("version: 9", "version: 99"), None),
        (
            original.replace("bag.db3", "drive.db3"),
            "metadata.yaml lists drive.db3: only the files present are read",
        ),
        (
            original.replace("message_count: 100", "message_count: 120"),
            "metadata.yaml lists 120 messages, the bag has 100",
        ),
        (original.replace("sqlite3", "mcap"), None),
    ]:
        metadata.write_text(changed)
        with Bag(folder) as bag:
            same(bag.messages(), messages)
            assert bag.warnings == ([] if warning is None else [warning])
    metadata.unlink()
    with Bag(folder) as bag:
        same(bag.messages(), messages)
        assert bag.warnings == ["metadata.yaml is missing: the recording was not closed"]


def test_expected_message_count_is_reported(tmp_path):
    messages = drive(400)
    folder = write(tmp_path / "bag", messages)
    file = folder / "bag.mcap"
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    with Bag(folder) as bag:
        kept = bag.message_count
        assert 100 < kept < 300
        cut, expected = bag.warnings
        assert cut.startswith("bag.mcap is damaged or cut off after ")
        assert expected == f"metadata.yaml lists 400 messages, the bag has {kept}"
        assert find_topics(bag).odometry == ODOMETRY


def test_one_file_of_several_is_unreadable(tmp_path):
    """The last file of a split recording is empty; the others are read."""
    messages = drive(100)
    folder = write(tmp_path / "bag", messages)
    (folder / "bag_1.mcap").touch()
    (folder / "bag_2.mcap").write_bytes(bytes(100))
    (folder / "metadata.yaml").unlink()
    with Bag(folder) as bag:
        same(bag.messages(), messages)
        assert bag.warnings[1:] == [
            "bag_1.mcap is empty: read without it",
            "bag_2.mcap is neither MCAP, SQLite nor a ROS 1 bag (CSV is not read): "
            "read without it",
        ]


@pytest.mark.parametrize("mode", [CompressionMode.NONE, CompressionMode.STORAGE])
def test_damage_within_an_indexed_mcap(tmp_path, mode):
    """A chunk in the middle is destroyed, the index is intact: the other chunks are read."""
    messages = [x for x in drive(24_000) if x[0] == ODOMETRY]
    folder = write(tmp_path / "bag", messages, mode=mode)
    file = folder / "bag.mcap"
    content = bytearray(file.read_bytes())
    middle = len(content) // 2
    content[middle : middle + 2000] = b"\xa5" * 2000
    file.write_bytes(content)
    with Bag(folder) as bag:
        found = [t for _, t, _ in bag.messages()]
        (warning,) = bag.warnings
        expected = [t for _, t, _ in messages]
        assert set(found) < set(expected)
        assert found == sorted(set(found))
        assert found[:1500] == expected[:1500]
        assert found[-1500:] == expected[-1500:]
        pattern = r"bag.mcap is damaged after \d+\.\d s: .+; (\d+) of 6000 messages read"
        match = re.fullmatch(pattern, warning)
        assert match is not None
        assert int(match[1]) == len(found)


def test_damage_within_an_indexed_database(tmp_path):
    messages = drive(1500)
    file = write(tmp_path / "bag", messages, "sqlite3") / "bag.db3"
    content = bytearray(file.read_bytes())
    page = int.from_bytes(content[16:18], "big")
    middle = len(content) // 2 // page * page
    content[middle : middle + page] = b"\xa5" * page
    file.write_bytes(content)
    with Bag(file) as bag:
        found = [t for _, t, _ in bag.messages()]
        lost = {t for _, t, _ in messages} - set(found)
        assert found == sorted(set(found))
        assert 0 < len(lost) < 20
        (warning,) = bag.warnings
        assert (
            damage(warning)[2]
            == f"{len(lost)} messages are missing before its last readable message"
        )


def test_write_ahead_log_is_read(tmp_path):
    """A killed recorder leaves its last messages in the log next to the database."""
    messages = drive(200)
    folder = write(tmp_path / "bag", messages[:100], "sqlite3")
    database = sqlite3.connect(folder / "bag.db3")
    database.execute("PRAGMA journal_mode=WAL")
    topics = dict(database.execute("SELECT name, id FROM topics").fetchall())
    for topic, log_ns, msg in messages[100:]:
        raw = bytes(JAZZY.serialize_cdr(msg, TYPES[topic]))
        row = (topics[topic], log_ns, raw)
        database.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES(?, ?, ?)", row)
    database.commit()
    killed = tmp_path / "killed"
    killed.mkdir()
    for file in folder.glob("bag.db3*"):
        shutil.copy(file, killed)
    database.close()
    before = {x.name: x.read_bytes() for x in killed.iterdir()}
    assert "bag.db3-wal" in before
    with Bag(killed) as bag:
        same(bag.messages(), messages)
        assert bag.warnings == ["metadata.yaml is missing: the recording was not closed"]
    assert {x.name: x.read_bytes() for x in killed.iterdir()} == before


def test_killed_writer(tmp_path):
    """A killed `BagWriter`: all messages on disk are read."""
    program = f"""
        import os, signal
        from helpers.bags import TYPES, drive
        from adk_ros.bags import BagWriter
        writer = BagWriter({str(tmp_path / "bag")!r})
        for topic, log_ns, msg in drive(20_000):
            writer.add_topic(topic, TYPES[topic])
            writer.write(topic, msg, log_ns)
        os.kill(os.getpid(), signal.SIGKILL)
    """
    paths = os.pathsep.join([str(Path(__file__).resolve().parents[1]), *sys.path])
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program)],
        env={**os.environ, "PYTHONPATH": paths},
        check=False,
    )
    assert done.returncode == -signal.SIGKILL
    with Bag(tmp_path / "bag") as bag:
        found = [t for _, t, _ in bag.messages()]
        expected = [t for _, t, _ in drive(20_000)]
        assert len(found) > 10_000
        assert found == expected[: len(found)]
        assert bag.warnings[0] == "metadata.yaml is missing: the recording was not closed"


def test_messages_of_an_undeclared_topic(tmp_path):
    """The record that declares the topic is missing: its messages are reported as lost."""
    messages = drive(100)
    content = mcap_file(tmp_path / "x.mcap", messages).read_bytes()
    channel = struct.pack("<HH", 3, 3) + text(COMMAND) + text("cdr") + text("")
    assert content.count(record(0x04, channel)) == 1
    path = tmp_path / "y.mcap"
    path.write_bytes(content.replace(record(0x04, channel), record(0x0C, channel)))
    with Bag(path) as bag:
        same(bag.messages(), [x for x in messages if x[0] != COMMAND])
        _, fault, kept = damage(bag.warnings[0]).groups()
        assert (fault, kept) == ("the topic of 25 messages is not declared", "75")


def test_chunk_with_wrong_checksum_is_skipped(tmp_path):
    """A chunk with a wrong checksum is skipped, the others are read."""
    messages = drive(150)
    content = bytearray(mcap_file(tmp_path / "x.mcap", messages, "").read_bytes())
    content[ends(content, messages)[70] - 1] ^= 0x10
    (tmp_path / "y.mcap").write_bytes(content)
    with Bag(tmp_path / "y.mcap") as bag:
        same(bag.messages(), messages[:50] + messages[100:])
        _, fault, kept = damage(bag.warnings[0]).groups()
        assert re.fullmatch(r"the chunk at byte \d+ has a wrong checksum and is skipped", fault)
        assert kept == "100"


@pytest.mark.parametrize("kind", ["mcap", "zstd", "loose", "db3", "message", "bag", "bz2"])
def test_random_damage_gives_messages_or_a_refusal(tmp_path, kind):
    """Random bytes overwritten, removed and inserted: messages or a one-line refusal."""
    messages = drive(60)
    if kind == "loose":
        source = mcap_file(tmp_path / "x.mcap", messages)
    elif kind in {"bag", "bz2"}:
        form = None if kind == "bag" else Ros1Writer.CompressionFormat.BZ2
        source = write_ros1(tmp_path / "x.bag", messages, form)
    else:
        mode = {"zstd": "STORAGE", "message": "MESSAGE"}.get(kind, "NONE")
        storage = "sqlite3" if kind in {"db3", "message"} else "mcap"
        write(tmp_path / "bag", messages, storage, CompressionMode[mode])
        (source,) = (tmp_path / "bag").glob("bag.*")
    content = source.read_bytes()
    random_ = random.Random(kind)
    readable = 0
    refusals = []
    for _ in range(120):
        damaged = bytearray(content)
        for _ in range(random_.choice((1, 2, 8))):
            at = random_.randrange(len(damaged))
            width = random_.choice((1, 1, 4, 64))
            new = random_.choice((random_.randbytes(width), b"\xff" * width, bytes(width), b""))
            damaged[at : at + random_.choice((0, width, width))] = new
        path = tmp_path / "damaged"
        path.write_bytes(damaged)
        try:
            with Bag(path) as bag:
                readable += len(list(bag.messages())) > 0
                list(bag.raw())
                assert all("\n" not in x for x in bag.warnings)
        except AdkError as error:
            refusals.append(str(error))
    assert not [x for x in refusals if "\n" in x]
    assert readable > 20


def test_damaged_zstd_file(tmp_path):
    folder = write(tmp_path / "bag", drive(400), mode=CompressionMode.FILE)
    (file,) = folder.glob("*.zstd")
    file.write_bytes(file.read_bytes()[:10])
    with pytest.raises(DataError, match=r"bag.mcap.zstd is empty"):
        Bag(folder)


def test_reading_leaves_no_temporary_files(tmp_path, monkeypatch):
    """Decompressed copies are removed with the bag, also when it is refused."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "temporary"))
    (tmp_path / "temporary").mkdir()
    folder = write(tmp_path / "bag", drive(400), mode=CompressionMode.FILE)
    with Bag(folder) as bag:
        assert len(list((tmp_path / "temporary").iterdir())) == 1
        assert bag.message_count == 400
    with BagWriter(tmp_path / "none", "sqlite3", "zstd") as writer:
        writer.add_topic(IMU, TYPES[IMU])
    with pytest.raises(DataError, match="contains no messages"):
        Bag(tmp_path / "none")
    assert list((tmp_path / "temporary").iterdir()) == []
    assert imu(START_NS, 1.0).linear_acceleration.y == 1.0
