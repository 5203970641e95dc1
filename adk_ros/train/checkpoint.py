# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Checkpoints of a training: parameters and Adam's moments as plain arrays.

Random numbers of a step depend on (seed, step) alone, so a resumed training gives the same result
as an uninterrupted one.
"""

from __future__ import annotations

import hashlib
import json
import os
import zipfile
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from adk_ros.files.code_digest import code_digest
from adk_ros.signals.channels import Record

Arrays = dict[str, np.ndarray[Any, Any]]


def fingerprint(settings: Any, records: list[Record]) -> str:
    """Return a hash of settings, data and code: equal for trainings with the same result."""
    digest = hashlib.sha256(json.dumps(asdict(settings), sort_keys=True).encode())
    digest.update(code_digest().encode())
    for record in records:
        channels = (record.x, record.u, record.a, record.x_ref, record.flags, record.episode)
        for array in channels:
            digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def save(
    path: Path, key: str, step: int, network: nn.Module, optimiser: torch.optim.Adam, extra: Arrays
) -> None:
    """Write a checkpoint atomically."""
    arrays: Arrays = {"key": np.array(key), "step": np.array(step)}
    for name, value in network.state_dict().items():
        arrays[f"net.{name}"] = value.detach().cpu().numpy()
    for index, state in optimiser.state_dict()["state"].items():
        for name, value in state.items():
            arrays[f"adam.{index}.{name}"] = np.asarray(torch.as_tensor(value).cpu())
    arrays |= {f"extra.{name}": value for name, value in extra.items()}
    path.parent.mkdir(parents=True, exist_ok=True)
    # Two trainings may write the same checkpoint.
    part = path.with_suffix(f".{os.getpid()}.part")
    with part.open("wb") as file:
        np.savez(file, allow_pickle=False, **arrays)
    os.replace(part, path)


def load(
    path: Path, key: str, network: nn.Module, optimiser: torch.optim.Adam
) -> tuple[int, Arrays] | None:
    """
    Restore `network` and `optimiser`; return the step to resume from and the extra arrays.

    Return None, with nothing changed, if `path` is not a checkpoint of this training and code.
    """
    try:
        with np.load(path, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
    except (OSError, EOFError, ValueError, zipfile.BadZipFile):
        return None
    if str(arrays.get("key")) != key:
        return None
    device = next(network.parameters()).device
    network.load_state_dict(
        {n[4:]: torch.as_tensor(v).to(device) for n, v in arrays.items() if n.startswith("net.")}
    )
    state: dict[int, dict[str, Any]] = {}
    for name, value in arrays.items():
        if name.startswith("adam."):
            _, index, field = name.split(".")
            state.setdefault(int(index), {})[field] = torch.as_tensor(value)
    template = optimiser.state_dict()
    optimiser.load_state_dict({"state": state, "param_groups": template["param_groups"]})
    extra = {n[6:]: v for n, v in arrays.items() if n.startswith("extra.")}
    return int(arrays["step"]), extra
