# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Decompression that stops at damage, and keeps what came before it."""

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
_PIECE = 1 << 12


def inflate(compression: str, data: bytes) -> bytes:
    """Decompress ("zstd", "lz4", "bz2", or "" and "none") as much of `data` as is sound."""
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
    for start in range(0, len(data), _PIECE):
        try:
            out += decoder.decompress(data[start : start + _PIECE])
        except (zstd.ZstdError, RuntimeError, OSError, EOFError, ValueError):
            break
        if decoder.eof:
            break
    return bytes(out)


def inflate_file(source: Path, target: Path) -> None:
    """Decompress a zstd file as far as it is sound."""
    decoder = zstd.ZstdDecompressor()
    with source.open("rb") as packed, target.open("wb") as out:
        while piece := packed.read(_PIECE):
            try:
                out.write(decoder.decompress(piece))
                while decoder.eof and decoder.unused_data:
                    rest, decoder = decoder.unused_data, zstd.ZstdDecompressor()
                    out.write(decoder.decompress(rest))
            except zstd.ZstdError:
                return
            if decoder.eof:
                decoder = zstd.ZstdDecompressor()
