# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk info: what a bag or a model holds."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from adk_ros.cli import console
from adk_ros.cli.options import JsonOption


def info(
    path: Annotated[Path, typer.Argument(help="a bag or a model folder")],
    as_json: JsonOption = False,
) -> None:
    """
    Say what a bag or a model holds, and whether it can be used.

    Example: adk info bags/handling
    """
    from adk_ros.model import artefact

    if (path / artefact.MANIFEST).is_file():
        _model(path, as_json)
    else:
        _bag(path, as_json)


def _model(path: Path, as_json: bool) -> None:
    from adk_ros.model import artefact

    loaded = artefact.load(path)
    manifest = loaded.manifest
    if as_json:
        console.print_json({"kind": "model", "path": str(path)} | manifest)
        return
    facts = manifest["training"]
    console.output.print(f"model {path}: whole, hashes fit", markup=False)
    rows = {
        "trained as": facts.get("kind", "unknown"),
        "from": ", ".join(f"{d['name']} ({d['seconds']:.0f} s)" for d in facts.get("data", [])),
        "grid": f"{manifest['dt_s'] * 1e3:g} ms, reference point {manifest['reference_point']}",
        "yaw rate": "gyro" if manifest["uses_imu"] else "odometry (trained without an IMU)",
        "encoder": f"{manifest['history']} past samples -> lifted state of "
        f"{manifest['lifted_size']}"
        + ("" if loaded.model.lifting.twin else " (no compiled twin: roll-outs are slow)"),
        "online": ", ".join(f"{k} {v}" for k, v in manifest["online"].items()),
    }
    held = facts.get("held_out")
    if held:
        rows["held out"] = (
            f"RMSE {held['geometric_mean_ratio']:.3f} of the best naive predictor's "
            f"(mean over channels and horizons, {held['starts']} starts)"
        )
    for name, text in rows.items():
        console.output.print(f"  {name:<11} {text}", markup=False)


def _bag(path: Path, as_json: bool) -> None:
    from adk_ros.bags import Bag, find_topics
    from adk_ros.errors import AdkError

    with Bag(path) as bag:
        found: dict[str, Any] = {}
        try:
            topics = find_topics(bag)
            found = {"imu": topics.imu, "odometry": topics.odometry, "command": topics.command}
            verdict = "can be trained on and replayed"
            if topics.imu is None:
                verdict += " (no IMU: yaw rate from odometry)"
        except AdkError as error:
            verdict = f"cannot be trained on or replayed: {error}"
        about: dict[str, Any] = {
            "kind": "bag",
            "path": str(path),
            "seconds": round(bag.duration_s, 3),
            "messages": bag.message_count,
            "topics": [
                {
                    "name": t.name,
                    "type": t.msgtype,
                    "count": t.count,
                    "rate_hz": round(t.count / bag.duration_s, 2) if bag.duration_s > 0 else None,
                }
                for t in bag.topics
            ],
            "used_as": found,
            "verdict": verdict,
            "warnings": bag.warnings,
        }
    if as_json:
        console.print_json(about)
        return
    console.output.print(
        f"bag {path}: {about['seconds']:.1f} s, {about['messages']} messages", markup=False
    )
    roles = {name: role for role, name in found.items() if name}
    wide = [max((len(t[key]) for t in about["topics"]), default=0) for key in ("name", "type")]
    for t in about["topics"]:
        rate = f"{t['rate_hz']:8.1f} Hz" if t["rate_hz"] is not None else ""
        console.output.print(
            f"  {t['name']:<{wide[0]}}  {t['type']:<{wide[1]}} {t['count']:>8}{rate}  "
            f"{roles.get(t['name'], '')}".rstrip(),
            markup=False,
        )
    for text in about["warnings"]:
        console.warn(text)
    console.output.print(f"  {verdict}", markup=False)
