# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Model folders: save, check and load a trained model.

    manifest.json   description, settings, and SHA-256 of the other files
    encoder.pt      TorchScript program (torch's own loader, which runs no Python pickle)
    arrays.npz      scaling, [A0 B0 c0], gains, horizon covariances (numpy, pickle refused)

A folder of another version, time grid or channel set, or with other hashes than its manifest
says, is refused.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import shutil
import tempfile
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from adk_ros.errors import UsageError
from adk_ros.model.adaptation.online_methods import OnlineSettings
from adk_ros.model.estimation.observer_gains import ObserverGains
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.lifting.encoder import Lifting, input_size
from adk_ros.model.lifting.scaling import Scaling
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.channels import INPUT_NAMES, INPUT_UNITS, STATE_NAMES, STATE_UNITS, TICK_NS

FORMAT = "adk_ros.model"
VERSION = 3
REFERENCE_POINT = "centre_of_gravity"
CHANNELS = {
    "state": dict(zip(STATE_NAMES, STATE_UNITS, strict=True)),
    "input": dict(zip(INPUT_NAMES, INPUT_UNITS, strict=True)),
}
# Names in model folders, which stay: `held_covariance` is `KoopmanModel.held_input_covariance`,
# `usual_change` is `KoopmanModel.mean_square_change`.
_ARRAYS = (
    "x_mean",
    "x_scale",
    "u_mean",
    "u_scale",
    "step_scale",
    "theta0",
    "horizon_covariance",
    "held_covariance",
    "usual_change",
    *ObserverGains.names(),
)
MANIFEST, ENCODER, ARRAYS = "manifest.json", "encoder.pt", "arrays.npz"


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
    arrays = _pack(model)
    manifest = {
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
        "sha256": {ENCODER: _hash(program), ARRAYS: _hash(arrays)},
        "training": facts,
    }
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


def load(folder: Path) -> Artefact:
    """
    Load and check a model folder.

    :raises UsageError: it is missing, truncated, altered, of another version, or made for other
        channels, another time grid or another reference point; the message says which.
    """
    manifest = read_manifest(folder)
    program = _checked_bytes(folder, ENCODER, manifest)
    packed = _checked_bytes(folder, ARRAYS, manifest)
    try:
        with np.load(io.BytesIO(packed), allow_pickle=False) as stored:
            arrays = {name: np.asarray(stored[name], dtype=np.float64) for name in _ARRAYS}
    except Exception as error:
        # The zip and npy readers raise a dozen types, MemoryError and TokenError included.
        raise UsageError(f"{folder / ARRAYS} is not readable ({error}): train again") from None
    history, n_z = manifest["history"], manifest["lifted_size"]
    _check_arrays(folder, arrays, n_z, manifest["affine"])
    model = KoopmanModel(
        lifting=Lifting(program, input_size(history), n_z - 3),
        scaling=Scaling(**{name: arrays[name] for name in _ARRAYS[:5]}),
        theta0=arrays["theta0"],
        history=history,
        residual=manifest["residual"],
        affine=manifest["affine"],
        relift=manifest["relift"],
        observer_gains=ObserverGains(**{n: arrays[n] for n in ObserverGains.names()}),
        horizon_covariance=arrays["horizon_covariance"],
        held_input_covariance=arrays["held_covariance"],
        mean_square_change=arrays["usual_change"],
        uses_imu=manifest["uses_imu"],
        online=OnlineSettings(**manifest["online"]),
    )
    return Artefact(model=model, manifest=manifest, path=folder)


def read_manifest(folder: Path) -> dict[str, Any]:
    """
    Return the manifest after checking that this version can run the model.

    :raises UsageError: as `load`, as far as the manifest alone shows.
    """
    path = folder / MANIFEST
    if not folder.is_dir():
        raise UsageError(f"model {folder} is not a folder: give the folder that 'adk train' wrote")
    try:
        manifest = json.loads(path.read_bytes())
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


def _pack(model: KoopmanModel) -> bytes:
    scaling = model.scaling
    arrays: dict[str, FloatArray] = {name: getattr(scaling, name) for name in _ARRAYS[:5]}
    arrays |= {
        "theta0": model.theta0,
        "horizon_covariance": model.horizon_covariance,
        "held_covariance": model.held_input_covariance,
        "usual_change": model.mean_square_change,
    }
    arrays |= {name: getattr(model.observer_gains, name) for name in ObserverGains.names()}
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **arrays)
    return buffer.getvalue()


def _hash(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _checked_bytes(folder: Path, name: str, manifest: dict[str, Any]) -> bytes:
    path = folder / name
    try:
        content = path.read_bytes()
    except OSError as error:
        raise UsageError(f"{path} cannot be read ({error.strerror}): train again") from None
    if _hash(content) != manifest["sha256"].get(name):
        raise UsageError(
            f"{path} does not match its hash in {MANIFEST}: it is truncated, altered or of "
            "another training; copy the whole folder again"
        )
    return content


def _check_arrays(folder: Path, arrays: dict[str, FloatArray], n_z: int, affine: bool) -> None:
    shapes = {
        "x_mean": (3,),
        "x_scale": (3,),
        "u_mean": (2,),
        "u_scale": (2,),
        "step_scale": (3,),
        "theta0": (n_z, n_z + 2 + int(affine)),
    } | {name: (3,) for name in ObserverGains.names()}
    for name, shape in shapes.items():
        if arrays[name].shape != shape:
            raise UsageError(
                f"{folder / ARRAYS}: {name} has shape {arrays[name].shape}, the manifest requires "
                f"{shape}"
            )
    covariance = arrays["horizon_covariance"]
    if covariance.ndim != 3 or covariance.shape[1:] != (3, 3):
        raise UsageError(f"{folder / ARRAYS}: horizon_covariance has shape {covariance.shape}")
    for name, shape in (
        ("held_covariance", covariance.shape),
        ("usual_change", covariance.shape[:2]),
    ):
        if arrays[name].size and arrays[name].shape != shape:
            raise UsageError(f"{folder / ARRAYS}: {name} has shape {arrays[name].shape}")
    for name, array in arrays.items():
        if not np.isfinite(array).all():
            raise UsageError(f"{folder / ARRAYS}: {name} contains values that are not finite")
        if name.endswith("_scale") and not (array > 0.0).all():
            raise UsageError(f"{folder / ARRAYS}: {name} contains a scale that is not positive")
