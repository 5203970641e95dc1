# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk check: signs, units, axes, timing and calibration of a recording."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from adk_ros.cli import console
from adk_ros.cli.options import (
    BagArgument,
    CommandOption,
    ForceOption,
    ImuOption,
    JsonOption,
    NoImuOption,
    OdometryOption,
    ParamsOption,
    read_options,
)
from adk_ros.errors import UsageError

if TYPE_CHECKING:
    from adk_ros.api.check import RecordingCheck, RecordingComparison
    from adk_ros.bags.recording import RecordingOptions

_STYLE = {"ok": "green", "finding": "yellow", "not decidable": "dim"}


def check(
    bag: BagArgument,
    vehicle: Annotated[
        Path | None,
        typer.Option(
            help="vehicle file (YAML or packaged name): wheelbase for the steering ratio, mass "
            "and wheel radius for the torque"
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="parameter file to write with the proposed values, for --params"),
    ] = None,
    road: Annotated[
        Path | None,
        typer.Option(
            help="file to write grade and bank along the drive to, with their 90 % intervals: "
            ".csv, .png or .svg"
        ),
    ] = None,
    reference: Annotated[
        Path | None,
        typer.Option(
            help="earlier recording of the same vehicle: say which sensor or steering parameter "
            "has changed since, and by how much"
        ),
    ] = None,
    imu: ImuOption = None,
    odometry: OdometryOption = None,
    command: CommandOption = None,
    no_imu: NoImuOption = False,
    params: ParamsOption = None,
    evidence: Annotated[
        bool, typer.Option("--evidence", help="show the evidence of every check")
    ] = False,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """
    Check signs, units, axes and timing of a recording.

    Each check says ok, a finding with its 90 % interval and evidence, or not decidable and why.
    What train, replay, mismatch and the node can correct is proposed as a parameter file. Streams
    that the bag lacks reduce the scope. Grade and bank of the road are estimated from IMU and
    odometry alone and written by --road. Takes a few seconds per minute of recording.
    With --reference, both recordings may have errors; only what differs is a finding.

    Example: adk check bags/handling --vehicle imdv --out params.yaml
    """
    from adk_ros.api.check import check_recording
    from adk_ros.api.output import check_output
    from adk_ros.api.road import check_road_path

    if road is not None:
        check_road_path(road)
    options = read_options(imu, odometry, command, no_imu, params)
    if reference is not None:
        if out is not None or road is not None:
            raise UsageError("--reference proposes no parameters: leave out --out and --road")
        _compare(bag, reference, vehicle, options, evidence, as_json)
        return
    for path in (out, road):
        if path is not None:
            # Before the work, whose findings would be lost.
            check_output(path, force, None, bag, *([vehicle] if vehicle is not None else []))
    with console.stages() as progress:
        checked = check_recording(bag, vehicle, options=options, progress=progress)
    console.note_all(checked.content.streams.notes)
    console.warn_all(checked.content.warnings)
    written = out is not None and checked.write_parameters(out, force)
    has_road = road is not None and checked.write_road(road, force)
    if as_json:
        console.print_json(checked.as_dict())
    else:
        _print(checked, evidence, checked.scope)
    if written:
        console.note(f"wrote {out}: {', '.join(checked.result.parameters)}")
    elif out is not None:
        console.note(f"{out} not written: no parameter to propose")
    if has_road:
        console.note(f"wrote {road}: grade and bank along the drive")
    elif road is not None:
        console.note(f"{road} not written: grade and bank are not decidable")


def _compare(
    bag: Path,
    reference: Path,
    vehicle: Path | None,
    options: RecordingOptions,
    evidence: bool,
    as_json: bool,
) -> None:
    from adk_ros.api.check import compare_recordings

    with console.stages() as progress:
        compared = compare_recordings(bag, reference, vehicle, options=options, progress=progress)
    for content in (compared.reference_content, compared.content):
        console.note_all(content.streams.notes)
        console.warn_all(content.warnings)
    if as_json:
        console.print_json(compared.as_dict())
        return
    _print(compared, evidence)


def _print(
    checked: RecordingCheck | RecordingComparison,
    evidence: bool,
    scope: Sequence[dict[str, str]] = (),
) -> None:
    from rich import box
    from rich.table import Table
    from rich.text import Text

    from adk_ros.calibration.check import CheckResult

    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1), pad_edge=False)
    table.add_column("check", no_wrap=True)
    table.add_column("verdict", no_wrap=True)
    table.add_column("result")
    for finding in checked.result.findings:
        verdict = finding.verdict.value
        lines = [finding.text]
        if finding.parameters:
            values = ", ".join(f"{name}: {value}" for name, value in finding.parameters.items())
            lines.append(f"proposed {values}")
        elif finding.remedy:
            lines.append(finding.remedy)
        if evidence or verdict == "finding":
            lines += _evidence(finding.evidence, finding.seconds, finding.standard_errors)
        table.add_row(
            Text(finding.name), Text(verdict, style=_STYLE[verdict]), Text("\n".join(lines))
        )
    console.print_table(table)
    if any(row["possible"] != "yes" for row in scope):
        console.print_scope(list(scope))
    heading = "next" if isinstance(checked.result, CheckResult) else "result"
    console.output.print(f"{heading}: {checked.result.advice}", markup=False)
    console.flush()


def _evidence(text: str, seconds: float | None, standard_errors: float | None) -> list[str]:
    if not text:
        return []
    if seconds is not None:
        text += f"; {seconds:.0f} s"
    if standard_errors is not None:
        text += f"; {standard_errors:.1f} standard errors from the nominal value"
    return [f"evidence: {text}"]
