# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Damaged bags of every format: refused in one line, or what is left of them is read."""

from pathlib import Path

import pytest
from helpers.bags import JAZZY, TYPES, drive, mcap_file, write, write_ros1
from helpers.fuzzing import Edit, assert_one_line, byte_edits, edited_bytes, fuzz
from hypothesis import strategies as st
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionMode

from adk_ros.bags import Bag, find_topics
from adk_ros.errors import AdkError

pytestmark = pytest.mark.slow(seconds=20)
COUNT = 60
"""Messages of a bag: few, so that edits meet its structure as often as its messages."""


def read(path: Path) -> None:
    """Read a bag; require that it is refused in one line, or that its messages are in order."""
    try:
        with Bag(path) as bag:
            assert_one_line(bag.summary())
            times = [log_ns for _, log_ns, _ in bag.messages()]
            assert times == sorted(times)
            assert len(times) <= COUNT * 20
            raw = list(bag.raw())
            assert len(raw) >= len(times)
            for warning in bag.warnings:
                assert_one_line(warning)
            find_topics(bag)
    except AdkError as error:
        assert_one_line(str(error))


@pytest.fixture(scope="module")
def contents(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Return the bytes of a bag in each storage and compression."""
    folder = tmp_path_factory.mktemp("bags")
    messages = drive(COUNT)
    lz4 = Ros1Writer.CompressionFormat.LZ4
    paths = {
        "plain.mcap": mcap_file(folder / "plain.mcap", messages),
        "lz4.mcap": mcap_file(folder / "lz4.mcap", messages, "lz4"),
        "indexed.mcap": write(folder / "indexed", messages) / "indexed.mcap",
        "zstd.mcap": write(folder / "zstd", messages, mode=CompressionMode.STORAGE) / "zstd.mcap",
        "a.db3": write(folder / "a", messages, "sqlite3") / "a.db3",
        "a.bag": write_ros1(folder / "a.bag", messages),
        "lz4.bag": write_ros1(folder / "lz4.bag", messages, lz4),
    }
    return {name: path.read_bytes() for name, path in paths.items()}


def test_storage_files(contents: dict[str, bytes], tmp_path: Path) -> None:
    def check(example: tuple[str, list[Edit]]) -> None:
        name, edits = example
        path = tmp_path / name
        path.write_bytes(edited_bytes(contents[name], edits))
        read(path)

    fuzz(st.tuples(st.sampled_from(sorted(contents)), byte_edits()), check)


def test_metadata(tmp_path: Path) -> None:
    folder = write(tmp_path / "bag", drive(COUNT), "sqlite3")
    metadata = folder / "metadata.yaml"
    original = metadata.read_bytes()

    def check(edits: list[Edit]) -> None:
        metadata.write_bytes(edited_bytes(original, edits))
        read(folder)

    fuzz(byte_edits(), check)


def test_messages(tmp_path: Path) -> None:
    """The storage is whole, and the CDR of single messages is altered."""
    messages = drive(COUNT)
    encoded = [JAZZY.serialize_cdr(msg, TYPES[topic]) for topic, _, msg in messages]
    places = st.integers(0, COUNT - 1)

    def check(changes: dict[int, list[Edit]]) -> None:
        path = tmp_path / "bag.mcap"
        mcap_file(path, messages, raw={
            i: edited_bytes(bytes(encoded[i]), edits) for i, edits in changes.items()
        })  # fmt: skip
        read(path)

    fuzz(st.dictionaries(places, byte_edits(), min_size=1, max_size=3), check)
