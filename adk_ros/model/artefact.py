# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Model folders: save, check and load a trained model.

    manifest.json   description, settings, and SHA-256 of the other files
    encoder.pt      TorchScript program (torch's own loader, which runs no Python pickle)
    arrays.npz      scaling, [A0 B0 c0], gains, horizon covariances, limits of motion, weights of
                    naive predictors (numpy, pickle refused)

A folder of another version, time grid or channel set, or with other hashes than its manifest
says, is refused.
"""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from adk_ros.errors import UsageError
from adk_ros.model.adaptation.online_methods import OnlineSettings
from adk_ros.model.estimation.observer_gains import ObserverGains
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.lifting.encoder import Lifting, input_size
from adk_ros.model.lifting.scaling import Scaling
from adk_ros.model.manifest import FORMAT, MANIFEST, describe, read_manifest
from adk_ros.model.signature import SIGNATURE_ENDING
from adk_ros.model.stored_model import (
    ARRAYS,
    ENCODER,
    FALLBACK_WEIGHTS,
    MOTION_LIMITS,
    SCALING_ARRAYS,
    content_hash,
    pack_arrays,
    read_arrays,
    read_program,
)
from adk_ros.model.uncertainty.fallback import Fallback


@dataclass(frozen=True)
class Artefact:
    """A loaded model, its manifest, and the folder it comes from."""

    model: KoopmanModel
    manifest: dict[str, Any]
    path: Path


def save(folder: Path, program: bytes, model: KoopmanModel, facts: dict[str, Any]) -> None:
    """
    Write a model folder. It appears complete or not at all.

    :param program: the TorchScript encoder. :param facts: what the trainer records (data, seeds,
        scores), JSON-serialisable, stored under "training".
    :raises UsageError: `folder` exists and is not a model folder, or cannot be written.
    """
    check_target(folder)
    arrays = pack_arrays(model)
    manifest = describe(
        model, facts, {ENCODER: content_hash(program), ARRAYS: content_hash(arrays)}
    )
    contents = {
        ENCODER: program,
        ARRAYS: arrays,
        MANIFEST: (json.dumps(manifest, indent=2) + "\n").encode(),
    }
    try:
        _write_whole(folder, contents)
    except OSError as error:
        raise UsageError(f"model {folder} cannot be written: {error.strerror}") from None


def _write_whole(folder: Path, contents: dict[str, bytes]) -> None:
    folder.parent.mkdir(parents=True, exist_ok=True)
    complete = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
    try:
        for name, content in contents.items():
            (complete / name).write_bytes(content)
        complete.chmod(0o755)
        if folder.exists():
            (folder / f"{MANIFEST}{SIGNATURE_ENDING}").unlink(missing_ok=True)
            # The manifest is last: until then, the old one's hashes refuse a mixture of files.
            for name in contents:
                os.replace(complete / name, folder / name)
        else:
            os.rename(complete, folder)
    finally:
        shutil.rmtree(complete, ignore_errors=True)


def check_target(folder: Path) -> None:
    """
    Check that `save` can write `folder` without replacing something that is not a model.

    :raises UsageError: `folder` exists and is not a model folder, or cannot be created.
    """
    try:
        place = folder
        while not place.exists():
            place = place.parent
        writable = place.is_dir() and os.access(place, os.W_OK)
    except OSError as error:
        raise UsageError(f"model {folder} cannot be written: {error.strerror}") from None
    if place == folder and not _is_model(folder):
        raise UsageError(f"{folder} exists and is not a model: choose another --out or remove it")
    if not writable:
        raise UsageError(f"model {folder} cannot be written: {place} is not a writable folder")


def _is_model(folder: Path) -> bool:
    try:
        manifest = json.loads((folder / MANIFEST).read_bytes())
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(manifest, dict) and manifest.get("format") == FORMAT


def load(folder: Path, public_keys: Path | None = None) -> Artefact:
    """
    Load and check a model folder.

    :param public_keys: file with the keys of which one must have signed it; None: nobody must.
    :raises UsageError: it is missing, truncated, altered, of another version, not signed, or made
        for other channels, another time grid or another reference point; the message says which.
    """
    manifest = read_manifest(folder, public_keys)
    program = read_program(folder, manifest)
    arrays = read_arrays(folder, manifest)
    history, n_z = manifest["history"], manifest["lifted_size"]
    model = KoopmanModel(
        lifting=Lifting(program, input_size(history), n_z - 3),
        scaling=Scaling(**{name: arrays[name] for name in SCALING_ARRAYS}),
        theta0=arrays["theta0"],
        history=history,
        residual=manifest["residual"],
        affine=manifest["affine"],
        relift=manifest["relift"],
        observer_gains=ObserverGains(**{n: arrays[n] for n in ObserverGains.names()}),
        horizon_covariance=arrays["horizon_covariance"],
        held_input_covariance=arrays["held_covariance"],
        motion_limits=arrays[MOTION_LIMITS],
        mean_square_change=arrays["usual_change"],
        uses_imu=manifest["uses_imu"],
        online=OnlineSettings(**manifest["online"]),
        fallback=Fallback(arrays[FALLBACK_WEIGHTS]),
    )
    return Artefact(model=model, manifest=manifest, path=folder)
