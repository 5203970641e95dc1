# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The files of a model folder beside its manifest: read, bounded and checked, running nothing."""

from __future__ import annotations

import hashlib
import io
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from adk_ros.errors import UsageError
from adk_ros.files.regular_file import read_regular_file
from adk_ros.model.estimation.observer_gains import ObserverGains
from adk_ros.model.lifting.program_archive import MAX_PROGRAM_BYTES
from adk_ros.model.lifting.program_grammar import check_program
from adk_ros.model.manifest import MANIFEST, read_manifest
from adk_ros.model.uncertainty.fallback import COMMANDS, Fallback
from adk_ros.model.uncertainty.motion_limits import N_LIMITS
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.score import NAIVE_PREDICTORS

if TYPE_CHECKING:
    from adk_ros.model.koopman import KoopmanModel

ENCODER, ARRAYS = "encoder.pt", "arrays.npz"
SCALING_ARRAYS = ("x_mean", "x_scale", "u_mean", "u_scale", "step_scale")
# Names in model folders, which stay: `held_covariance` is `KoopmanModel.held_input_covariance`,
# `usual_change` is `KoopmanModel.mean_square_change`.
_ARRAYS = (
    *SCALING_ARRAYS,
    "theta0",
    "horizon_covariance",
    "held_covariance",
    "usual_change",
    *ObserverGains.names(),
)
MOTION_LIMITS = "motion_limits"
"""Array that models of the first releases lack: they predict without limits."""
FALLBACK_WEIGHTS = "fallback_weights"
"""Array that models of the first releases lack: in these no naive predictor takes over."""
_WITHOUT = {MOTION_LIMITS: np.zeros(0), FALLBACK_WEIGHTS: Fallback.none().weights}
"""Arrays that may be missing, and what then takes their place."""
_ROUNDING = 1e-9
"""Sums of weights may exceed 1 by this: far above rounding, far below what is printed."""
_MAX_ARRAYS_BYTES = 64 << 20
"""Bytes of arrays.npz, packed and unpacked: that of the default model has 60 kB."""

_MAX_MAGNITUDE = 1e12
"""Largest number in arrays.npz, and one over the smallest scale: squares stay finite. By choice:
torques in mN m and covariances in SI units are below 1e9."""


def inspect_model(folder: Path, public_keys: Path | None = None) -> dict[str, Any]:
    """
    Return the manifest of a model folder after checking all its files, without running anything.

    :param public_keys: file with the keys of which one must have signed it; None: nobody must.
    :raises UsageError: it is missing, truncated, altered, of another version, or its encoder does
        what no encoder needs.
    """
    manifest = read_manifest(folder, public_keys)
    check_program(read_program(folder, manifest))
    read_arrays(folder, manifest)
    return manifest


def read_program(folder: Path, manifest: dict[str, Any]) -> bytes:
    """
    Return the content of encoder.pt.

    :raises UsageError: it cannot be read or is altered.
    """
    return checked_bytes(folder, ENCODER, manifest, MAX_PROGRAM_BYTES)


def read_arrays(folder: Path, manifest: dict[str, Any]) -> dict[str, FloatArray]:
    """
    Return the arrays of a model folder by name.

    :raises UsageError: they are not readable, altered, or do not fit the manifest.
    """
    packed = checked_bytes(folder, ARRAYS, manifest, _MAX_ARRAYS_BYTES)
    try:
        with zipfile.ZipFile(io.BytesIO(packed)) as archive:
            unpacked = sum(entry.file_size for entry in archive.infolist())
        if unpacked > _MAX_ARRAYS_BYTES:
            raise ValueError(f"it unpacks to {unpacked >> 20} MiB")
        with np.load(io.BytesIO(packed), allow_pickle=False) as stored:
            arrays = {name: _real(name, stored[name]) for name in _ARRAYS}
            arrays |= {
                name: _real(name, stored[name]) if name in stored else array
                for name, array in _WITHOUT.items()
            }
    except Exception as error:
        # The zip and npy readers raise a dozen types, MemoryError and TokenError included.
        raise UsageError(f"{folder / ARRAYS} is not readable ({error}): train again") from None
    _check_arrays(folder, arrays, manifest["lifted_size"], manifest["affine"])
    return arrays


def _real(name: str, array: np.ndarray[Any, Any]) -> FloatArray:
    if array.dtype.kind not in "fiu":
        raise ValueError(f"{name} holds {array.dtype} instead of numbers")
    return array.astype(np.float64)


def pack_arrays(model: KoopmanModel) -> bytes:
    """Return the content of arrays.npz."""
    scaling = model.scaling
    arrays: dict[str, FloatArray] = {name: getattr(scaling, name) for name in SCALING_ARRAYS}
    arrays |= {
        "theta0": model.theta0,
        "horizon_covariance": model.horizon_covariance,
        "held_covariance": model.held_input_covariance,
        "usual_change": model.mean_square_change,
        MOTION_LIMITS: model.motion_limits,
        FALLBACK_WEIGHTS: model.fallback.weights,
    }
    arrays |= {name: getattr(model.observer_gains, name) for name in ObserverGains.names()}
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **arrays)
    return buffer.getvalue()


def content_hash(content: bytes) -> str:
    """Return the SHA-256 that the manifest states of a file."""
    return hashlib.sha256(content).hexdigest()


def checked_bytes(folder: Path, name: str, manifest: dict[str, Any], limit: int) -> bytes:
    """
    Return the content of a file of a model folder.

    :raises UsageError: it is larger than `limit` bytes, or not what the manifest says.
    """
    path = folder / name
    try:
        content = read_regular_file(path, limit)
    except OSError as error:
        raise UsageError(f"{path} cannot be read ({error.strerror}): train again") from None
    if content_hash(content) != manifest["sha256"].get(name):
        raise UsageError(
            f"{path} does not match its hash in {MANIFEST}: it is truncated, altered or of "
            "another training; copy the whole folder again"
        )
    return content


def _check_arrays(folder: Path, arrays: dict[str, FloatArray], n_z: int, affine: bool) -> None:
    shapes: dict[str, tuple[int, ...]] = {
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
        if arrays[name].shape not in {shape, (0, *shape[1:])}:
            raise UsageError(f"{folder / ARRAYS}: {name} has shape {arrays[name].shape}")
    limits = arrays[MOTION_LIMITS]
    if limits.shape not in {(0,), (N_LIMITS,)} or not (limits > 0.0).all():
        raise UsageError(
            f"{folder / ARRAYS}: {MOTION_LIMITS} is not {N_LIMITS} positive numbers: train again"
        )
    _check_fallback(folder, arrays)
    for name, array in arrays.items():
        if not np.isfinite(array).all():
            raise UsageError(f"{folder / ARRAYS}: {name} contains values that are not finite")
        if name.endswith("_scale") and not (array > 0.0).all():
            raise UsageError(f"{folder / ARRAYS}: {name} contains a scale that is not positive")
        if (np.abs(array) > _MAX_MAGNITUDE).any():
            raise UsageError(f"{folder / ARRAYS}: {name} contains {np.abs(array).max():.3g}")
        if name.endswith("_scale") and not (array > 1.0 / _MAX_MAGNITUDE).all():
            raise UsageError(f"{folder / ARRAYS}: {name} contains {array.min():.3g}")


def _check_fallback(folder: Path, arrays: dict[str, FloatArray]) -> None:
    weights = arrays[FALLBACK_WEIGHTS]
    steps = len(arrays["horizon_covariance"])
    shapes = {(len(COMMANDS), len(NAIVE_PREDICTORS), n, 3) for n in (0, steps)}
    # Comparisons with NaN are false.
    if (
        weights.shape not in shapes
        or not (weights >= 0.0).all()
        or not (weights.sum(axis=1) <= 1.0 + _ROUNDING).all()
    ):
        raise UsageError(
            f"{folder / ARRAYS}: {FALLBACK_WEIGHTS} is not {len(COMMANDS)} x "
            f"{len(NAIVE_PREDICTORS)} x {steps} x 3 weights from 0 to 1: train again"
        )
