# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk info: the contents of a bag or a model folder."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from adk_ros.cli import console
from adk_ros.cli.options import JsonOption
from adk_ros.errors import UsageError


def info(
    path: Annotated[Path, typer.Argument(help="bag or model folder")],
    public_keys: Annotated[
        Path | None,
        typer.Option(help="file with SSH keys (Ed25519), of which one must have signed a model"),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """
    Show what a bag or a model contains, and whether it is usable.

    Example: adk info bags/handling
    """
    from adk_ros.api.model import is_model_folder

    # Only models need PyTorch, which takes seconds to import.
    if is_model_folder(path):
        _show_model(path, public_keys, as_json)
    elif public_keys is not None:
        raise UsageError(f"{path} is no model folder: only models are signed")
    else:
        _show_bag(path, as_json)


def _show_model(path: Path, public_keys: Path | None, as_json: bool) -> None:
    from adk_ros.model.stored_model import FALLBACK_WEIGHTS, inspect_model, read_arrays
    from adk_ros.model.training_range import TrainingRange
    from adk_ros.model.uncertainty.fallback import Fallback

    manifest = inspect_model(path, public_keys)
    facts = manifest["training"]
    if as_json:
        console.print_json({"kind": "model", "path": str(path)} | manifest)
        return
    signed = ", signed by a known key" if public_keys is not None else ""
    console.output.print(f"model {path}: complete, hashes match{signed}", markup=False)
    rows = {
        "kind": facts.get("kind", "unknown"),
        "trained on": ", ".join(
            f"{data['name']} ({data['seconds']:.0f} s)" for data in facts.get("data", [])
        ),
        "time step": f"{manifest['dt_s'] * 1e3:g} ms",
        "reference": str(manifest["reference_point"]).replace("_", " "),
        "yaw rate": "gyro" if manifest["uses_imu"] else "odometry (trained without an IMU)",
        "encoder": f"{manifest['history']} past samples -> lifted state of "
        f"{manifest['lifted_size']}",
        "online": ", ".join(f"{key} {value}" for key, value in manifest["online"].items()),
    }
    known = TrainingRange.from_json(facts.get("range"))
    if known is not None:
        rows["range"] = f"central 99 % of the training data: {known.text}"
    held_out = facts.get("held_out")
    if held_out:
        rows["held out"] = (
            f"RMSE {held_out['geometric_mean_ratio']:.3f} of the best naive predictor's "
            f"(mean over channels and horizons, {held_out['starts']} rollouts)"
        )
    takeovers = Fallback(read_arrays(path, manifest)[FALLBACK_WEIGHTS]).takeovers()
    lines = [*rows.items(), *(("naive", takeover.text) for takeover in takeovers)]
    for name, text in lines:
        console.output.print(f"  {name:<11} {text}", markup=False)


def _show_bag(path: Path, as_json: bool) -> None:
    from adk_ros.api.info import bag_content, bag_verdict, read_bag, with_reading

    content = bag_content(path)
    with console.stages() as progress:
        about = with_reading(content, read_bag(path, progress))
    about["verdict"] = bag_verdict(about)
    if as_json:
        console.print_json(about)
        return
    console.output.print(
        f"bag {path}: {about['seconds']:.1f} s, {about['messages']} messages", markup=False
    )
    use_of = {name: use for use, name in about["used_as"].items() if name}
    widths = {
        key: max((len(topic[key]) for topic in about["topics"]), default=0)
        for key in ("name", "type")
    }
    for topic in about["topics"]:
        rate = f"{topic['rate_hz']:8.1f} Hz" if topic["rate_hz"] is not None else ""
        console.output.print(
            f"  {topic['name']:<{widths['name']}}  {topic['type']:<{widths['type']}} "
            f"{topic['count']:>8}{rate}  {use_of.get(topic['name'], '')}".rstrip(),
            markup=False,
        )
    console.warn_all(about["warnings"])
    if about["scope"]:
        console.print_scope(about["scope"])
    console.output.print(f"  {about['verdict']}", markup=False)
