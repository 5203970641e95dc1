# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Stages of known length, and recordings for them."""

from __future__ import annotations

import hashlib
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

_BLOCK = bytes(1 << 16)


@dataclass(frozen=True)
class BusyStage:
    """Computes for `cpu_s` seconds of its processor, then waits for `nap_s` seconds."""

    cpu_s: float = 0.0
    nap_s: float = 0.0
    name: str = "busy"
    inputs_hash: str = "bench"
    shared_paths: tuple[str, ...] = ()

    @property
    def text(self) -> str:
        """The length of the work in words."""
        return f"{self.cpu_s:g} s of computing and {self.nap_s:g} s of waiting"

    def run(self, path: Path, recording: str) -> list[dict[str, Any]]:
        """Return a row with the number in the recording."""
        end_s = time.process_time() + self.cpu_s
        while time.process_time() < end_s:
            hashlib.sha256(_BLOCK).digest()
        if self.nap_s:
            time.sleep(self.nap_s)
        return [{"finding": "number", "value": float(path.read_text())}]


def write_recordings(folder: Path, count: int) -> list[Path]:
    """Write `count` small files with the endings of recordings; they hold their numbers."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / f"r{i:06d}.mcap" for i in range(count)]
    for i, path in enumerate(paths):
        path.write_text(str(i))
    return paths
