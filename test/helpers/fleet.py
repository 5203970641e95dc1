# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Stages and recordings for tests of the fleet; stage processes import this module."""

import os
import signal
import tempfile
import threading
import time
from dataclasses import dataclass
from pathlib import Path

from adk_ros.errors import DataError
from adk_ros.fleet.recordings import find_recordings
from adk_ros.fleet.stage_process import StageProcess


@dataclass(frozen=True)
class TextStage:
    """
    Reads a recording that is a text: a command and a number.

    `log`: folder in which each start leaves a file.
    """

    log: str
    nap_s: float = 0.0
    inputs_hash: str = "inputs"
    name: str = "text"
    shared_paths: tuple[str, ...] = ()

    def run(self, path, recording):
        command, _, number = path.read_text().partition(" ")
        (Path(self.log) / f"{path.name}-{time.time_ns()}-{os.getpid()}").touch()
        time.sleep(self.nap_s)
        if command == "damaged":
            raise DataError(f"{path.name} is damaged")
        if command == "raise":
            raise ZeroDivisionError("a fault of the stage")
        if command == "hang":
            time.sleep(60.0)
        if command == "die":
            os.kill(os.getpid(), signal.SIGKILL)
        if command == "grow":
            memory = [b"x" * 2**20 for _ in range(400)]
            time.sleep(2.0)
            memory.clear()
        if command == "wrong":
            return [{"no such column": 1.0}]
        return [
            {"finding": "number", "value": float(number), "details": {"path": path.name}},
            {"finding": "twice", "value": 2.0 * float(number)},
        ]

    def starts(self):
        """Return how often each recording was started."""
        counts: dict[str, int] = {}
        for path in Path(self.log).iterdir():
            name = path.name.split("-")[0]
            counts[name] = counts.get(name, 0) + 1
        return counts


def length_of_bytes(size):
    """Hold so many bytes, and return their number."""
    return len(b"x" * size)


def text_fleet(folder, contents):
    """Write recordings, name -> text, and return them."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in contents.items():
        path = folder / f"{name}.mcap"
        # A file that is written again counts as changed.
        if not path.is_file() or path.read_text() != text:
            path.write_text(text)
    return find_recordings([str(folder)])


def text_stage(folder, **fields):
    """Return a stage whose log is a new folder."""
    folder.mkdir(parents=True, exist_ok=True)
    return TextStage(str(folder), **fields)


def compared(rows):
    """Return rows without what differs between runs: durations, memory, time of writing."""
    varying = {"seconds", "memory_mib", "written_s", "uri"}
    kept = [{k: v for k, v in row.items() if k not in varying} for row in rows]
    return sorted(kept, key=lambda row: (row["recording"], row["finding"] or ""))


def started_child():
    """Start a stage process that works for a minute; return its number."""
    child = StageProcess()
    threading.Thread(target=child.run, args=(time.sleep, [60.0]), daemon=True).start()
    while child.pid is None:
        time.sleep(0.01)
    time.sleep(0.5)
    return child.pid


def copy_and_wait(seconds):
    """Leave a file in the temporary folder, as a copy of a recording; return its path."""
    path = Path(tempfile.mkdtemp()) / "copy"
    path.write_bytes(b"x")
    time.sleep(seconds)
    return str(path)
