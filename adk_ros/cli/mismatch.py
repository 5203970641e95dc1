# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk mismatch: what a recording of the real car has that its simulation leaves out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from adk_ros.cli import console
from adk_ros.cli.options import (
    CommandOption,
    ImuOption,
    JsonOption,
    OdometryOption,
    ParamsOption,
    drive_options,
)


def mismatch(
    simulation: Annotated[Path, typer.Option(help="bag of the simulator")],
    recording: Annotated[Path, typer.Option(help="bag of the real car")],
    out: Annotated[Path, typer.Option(help="folder for the report")],
    vehicle: Annotated[
        Path | None, typer.Option(help="the simulation's nominal vehicle, YAML")
    ] = None,
    imu: ImuOption = None,
    odometry: OdometryOption = None,
    command: CommandOption = None,
    params: ParamsOption = None,
    as_json: JsonOption = False,
) -> None:
    """
    Name the physics that a simulation lacks, and add it.

    Example: adk mismatch --simulation sim --recording real --vehicle vehicle.yaml --out report
    """
    from adk_ros.mismatch.answer import as_dict, write_report
    from adk_ros.mismatch.investigate import investigate
    from adk_ros.mismatch.nominal import load_nominal
    from adk_ros.mismatch.reading import read_evidence
    from adk_ros.mismatch.report.folder import check_folder
    from adk_ros.mismatch.report.sentence import sentence

    check_folder(out)
    nominal = None if vehicle is None else load_nominal(vehicle)
    sensors = drive_options(imu, odometry, command, False, params).sensors
    with console.progress(f"reading {simulation.name}") as bar:
        simulated = read_evidence(simulation, imu, odometry, command, sensors, bar)
    with console.progress(f"reading {recording.name}") as bar:
        recorded = read_evidence(recording, imu, odometry, command, sensors, bar)
    with console.progress("comparing") as bar:
        findings = investigate(simulated, recorded, nominal, bar)
    write_report(findings, out)
    if as_json:
        console.answer(as_dict(findings))
        return
    for text in findings.notes:
        console.note(text)
    console.output.print(sentence(findings), markup=False)
    console.note(f"report.html, mismatch.json, simulation.yaml and corrected.yaml in {out}")
