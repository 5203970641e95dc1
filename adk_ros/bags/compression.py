# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Decompression that returns all data before the first damaged byte."""

from __future__ import annotations

import bz2
import sys
from pathlib import Path
from typing import Any

import lz4.frame

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
_CHUNK = 1 << 12
"""
Bytes decompressed at once: at most this many intact bytes directly before a damage are lost.
"""


def inflate(compression: str, data: bytes) -> bytes:
    """Decompress `data` ("zstd", "lz4", "bz2", or "" and "none") up to the first damage."""
    if compression in {"", "none"}:
        return data
    decoder: Any
    if compression == "zstd":
        decoder = zstd.ZstdDecompressor()
    elif compression == "lz4":
        decoder = lz4.frame.LZ4FrameDecompressor()
    elif compression == "bz2":
        decoder = bz2.BZ2Decompressor()
    else:
        return b""
    out = bytearray()
    for start in range(0, len(data), _CHUNK):
        try:
            out += decoder.decompress(data[start : start + _CHUNK])
        except (zstd.ZstdError, RuntimeError, OSError, EOFError, ValueError):
            break
        if decoder.eof:
            break
    return bytes(out)


def inflate_file(source: Path, target: Path) -> None:
    """Decompress a zstd file up to the first damage."""
    decoder = zstd.ZstdDecompressor()
    with source.open("rb") as compressed, target.open("wb") as out:
        while chunk := compressed.read(_CHUNK):
            try:
                out.write(decoder.decompress(chunk))
                while decoder.eof and decoder.unused_data:
                    remaining, decoder = decoder.unused_data, zstd.ZstdDecompressor()
                    out.write(decoder.decompress(remaining))
            except zstd.ZstdError:
                return
            if decoder.eof:
                decoder = zstd.ZstdDecompressor()
