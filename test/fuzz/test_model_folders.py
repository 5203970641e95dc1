# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Damaged and altered model folders: refused in one line, or they predict finite values."""

import io
import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.fuzzing import Edit, assert_one_line, byte_edits, edited_bytes, edited_content, fuzz
from helpers.node import Rig, write_model
from hypothesis import strategies as st

from adk_ros.errors import AdkError
from adk_ros.model import artefact
from adk_ros.model.manifest import MANIFEST
from adk_ros.model.stored_model import ARRAYS, ENCODER, content_hash, inspect_model

pytestmark = pytest.mark.slow(seconds=20)
SHAPES: list[Any] = [slice(0, 0), slice(1, None), None, slice(None, None, -1)]
TYPES = ["float16", "int64", "complex128", "bool", "S8", "U8", "datetime64[s]"]


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_model(tmp_path_factory.mktemp("fuzz") / "model")


def check(folder: Path, files: dict[str, bytes], rehash: bool) -> None:
    """Write the files to a model folder; require that it is refused or predicts finite values."""
    if rehash:
        manifest = json.loads(files[MANIFEST])
        manifest["sha256"] = {name: content_hash(files[name]) for name in (ENCODER, ARRAYS)}
        files = files | {MANIFEST: json.dumps(manifest).encode()}
    for name, content in files.items():
        (folder / name).write_bytes(content)
    before = {path.name for path in folder.parent.iterdir()}
    try:
        inspect_model(folder)
    except AdkError as error:
        assert_one_line(str(error))
    try:
        loaded = artefact.load(folder).model
    except AdkError as error:
        assert_one_line(str(error))
        return
    finally:
        assert {path.name for path in folder.parent.iterdir()} == before
    rig = Rig(loaded)
    rig.drive(1.0)
    assert rig.all_finite()
    assert not rig.errors, rig.errors


def contents(model: Path) -> dict[str, bytes]:
    return {name: (model / name).read_bytes() for name in (MANIFEST, ENCODER, ARRAYS)}


@pytest.mark.parametrize("name", [ENCODER, ARRAYS])
def test_files(model: Path, tmp_path: Path, name: str) -> None:
    files = contents(model)
    fuzz(
        st.tuples(byte_edits(), st.booleans()),
        lambda example: check(
            tmp_path, files | {name: edited_bytes(files[name], example[0])}, rehash=example[1]
        ),
    )


def test_manifest(model: Path, tmp_path: Path) -> None:
    files = contents(model)
    content = json.loads(files[MANIFEST])
    as_bytes = st.one_of(
        edited_content(content).map(lambda x: json.dumps(x).encode("utf-8", "surrogatepass")),
        byte_edits().map(lambda edits: edited_bytes(files[MANIFEST], edits)),
    )
    fuzz(as_bytes, lambda example: check(tmp_path, files | {MANIFEST: example}, rehash=False))


def test_arrays(model: Path, tmp_path: Path) -> None:
    """The archive is whole, and what the arrays hold is not what a training writes."""
    files = contents(model)
    with np.load(io.BytesIO(files[ARRAYS])) as stored:
        arrays = {name: stored[name] for name in stored.files}
    special = st.sampled_from([np.nan, np.inf, -np.inf, 0.0, -1.0, 1e-300, 1e300, 1e9])
    edits = st.one_of(
        st.tuples(st.just("value"), special, st.integers(0, 1000)),
        st.tuples(st.just("scale"), special, st.just(0)),
        st.tuples(st.just("shape"), st.sampled_from(SHAPES), st.just(0)),
        st.tuples(st.just("type"), st.sampled_from(TYPES), st.just(0)),
        st.tuples(st.just("replace"), st.sampled_from(sorted(arrays)), st.just(0)),
        st.tuples(st.just("remove"), st.just(0), st.just(0)),
    )

    def packed(changes: list[tuple[str, tuple[str, Any, int]]]) -> bytes:
        out: dict[str, Any] = dict(arrays)
        for name, (kind, value, place) in changes:
            if out[name] is not None:
                out[name] = edited_array(arrays, out[name], kind, value, place)
        buffer = io.BytesIO()
        kept = {name: array for name, array in out.items() if array is not None}
        np.savez(buffer, allow_pickle=False, **kept)
        return buffer.getvalue()

    fuzz(
        st.lists(st.tuples(st.sampled_from(sorted(arrays)), edits), min_size=1, max_size=3),
        lambda changes: check(tmp_path, files | {ARRAYS: packed(changes)}, rehash=True),
    )


def edited_array(
    arrays: dict[str, Any], array: Any, kind: str, value: Any, place: int
) -> Any | None:
    """Return an array after one edit; None if it is removed."""
    if kind == "value" and array.size and array.dtype.kind in "fiu":
        array = np.array(array, dtype=np.float64)
        array.flat[place % array.size] = value
    elif kind == "scale" and array.dtype.kind in "fiu":
        with np.errstate(all="ignore"):
            array = array * value
    elif kind == "shape":
        array = array[value]
    elif kind == "type":
        array = np.zeros(array.shape, value)
    elif kind == "replace":
        array = arrays[value]
    return None if kind == "remove" else array


def test_program(model: Path, tmp_path: Path) -> None:
    """The archive is whole, and one of its entries is altered: code, pickles, weights."""
    files = contents(model)
    with zipfile.ZipFile(io.BytesIO(files[ENCODER])) as archive:
        entries = {info.filename: archive.read(info) for info in archive.infolist()}

    def packed(example: tuple[str, list[Edit]]) -> bytes:
        name, edits = example
        changed = entries | {name: edited_bytes(entries[name], edits)}
        buffer = io.BytesIO()
        with zipfile.ZipFile(buffer, "w") as archive:
            for entry, content in changed.items():
                archive.writestr(entry, content)
        return buffer.getvalue()

    fuzz(
        st.tuples(st.sampled_from(sorted(entries)), byte_edits()),
        lambda example: check(tmp_path, files | {ENCODER: packed(example)}, rehash=True),
    )
