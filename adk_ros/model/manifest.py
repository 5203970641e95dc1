# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The manifest of a model folder: what it says, and whether this version can run the model."""

from __future__ import annotations

import json
from dataclasses import asdict, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from adk_ros.errors import UsageError
from adk_ros.files.regular_file import read_regular_file
from adk_ros.model.adaptation.online_methods import OnlineSettings
from adk_ros.model.signature import check_signature
from adk_ros.signals.channels import INPUT_NAMES, INPUT_UNITS, STATE_NAMES, STATE_UNITS, TICK_NS

if TYPE_CHECKING:
    from adk_ros.model.koopman import KoopmanModel

FORMAT = "adk_ros.model"
VERSION = 3
MANIFEST = "manifest.json"
REFERENCE_POINT = "centre_of_gravity"
CHANNELS = {
    "state": dict(zip(STATE_NAMES, STATE_UNITS, strict=True)),
    "input": dict(zip(INPUT_NAMES, INPUT_UNITS, strict=True)),
}
_MAX_BYTES = 16 << 20
"""Bytes of a manifest: that of a training on ten recordings has 20 kB."""


def describe(model: KoopmanModel, facts: dict[str, Any], hashes: dict[str, str]) -> dict[str, Any]:
    """
    Return the manifest of a model.

    :param facts: what the trainer records. :param hashes: SHA-256 of the other files, by name.
    """
    return {
        "format": FORMAT,
        "version": VERSION,
        "dt_s": TICK_NS * 1e-9,
        "reference_point": REFERENCE_POINT,
        "channels": CHANNELS,
        "history": model.history,
        "lifted_size": model.n_z,
        "residual": model.residual,
        "affine": model.affine,
        "relift": model.relift,
        "uses_imu": model.uses_imu,
        "online": asdict(model.online),
        "sha256": hashes,
        "training": facts,
    }


def read_manifest(folder: Path, public_keys: Path | None = None) -> dict[str, Any]:
    """
    Return the manifest after checking that this version can run the model.

    :param public_keys: file with the keys of which one must have signed it; None: nobody must.
    :raises UsageError: as `load`, as far as the manifest alone shows.
    """
    path = folder / MANIFEST
    if not folder.is_dir():
        raise UsageError(f"model {folder} is not a folder: give the folder that 'adk train' wrote")
    try:
        content = read_regular_file(path, _MAX_BYTES)
        if public_keys is not None:
            check_signature(path, content, public_keys)
        manifest = json.loads(content)
    except FileNotFoundError:
        raise UsageError(f"{folder} contains no {MANIFEST}: it is not a model folder") from None
    except (OSError, ValueError, RecursionError) as error:
        raise UsageError(f"{path} is not readable as JSON ({error}): train again") from None
    if not isinstance(manifest, dict) or manifest.get("format") != FORMAT:
        raise UsageError(f"{path} does not describe an {FORMAT}")
    wanted = {
        "version": VERSION,
        "dt_s": TICK_NS * 1e-9,
        "reference_point": REFERENCE_POINT,
        "channels": CHANNELS,
    }
    for key, value in wanted.items():
        if manifest.get(key) != value:
            raise UsageError(
                f"{path}: {key} is {json.dumps(manifest.get(key))}, this version requires "
                f"{json.dumps(value)}: train the model again with this version"
            )
    kinds = {
        "history": int,
        "lifted_size": int,
        "residual": bool,
        "affine": bool,
        "relift": bool,
        "uses_imu": bool,
        "online": dict,
        "sha256": dict,
        "training": dict,
    }
    for key, kind in kinds.items():
        if type(manifest.get(key)) is not kind:
            raise UsageError(f"{path}: '{key}' is missing or not of type {kind.__name__}")
    if not (0 <= manifest["history"] <= 40 and 4 <= manifest["lifted_size"] <= 200):
        raise UsageError(f"{path}: history or lifted_size is out of range")
    if not manifest["relift"] and (manifest["residual"] or manifest["affine"]):
        raise UsageError(f"{path}: a model without 'relift' must not be residual or affine")
    _check_online(path, manifest["online"])
    return manifest


def _check_online(path: Path, online: dict[str, Any]) -> None:
    kinds = {item.name: type(item.default) for item in fields(OnlineSettings)}
    if set(online) != set(kinds):
        raise UsageError(f"{path}: 'online' must contain exactly {', '.join(sorted(kinds))}")
    for key, kind in kinds.items():
        # An integer is accepted for a float: 100 for 100.0.
        if type(online[key]) is not kind and not (kind is float and type(online[key]) is int):
            raise UsageError(f"{path}: '{key}' of 'online' is not of type {kind.__name__}")
