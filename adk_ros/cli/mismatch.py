# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk mismatch: what a recording of the real car has that its simulation leaves out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

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
from adk_ros.errors import UsageError

if TYPE_CHECKING:
    from adk_ros.mismatch.recording.sensor_log import SensorLog
    from adk_ros.mismatch.surrogate.identification import SurrogateModel


def mismatch(
    simulation: Annotated[
        Path,
        typer.Option(
            help="bag of the simulator; or its vehicle, YAML as for adk simulate; or the "
            "simulation.yaml of an earlier report"
        ),
    ],
    recording: Annotated[Path, typer.Option(help="bag of the real car")],
    out: Annotated[Path, typer.Option(help="folder for the report")],
    vehicle: Annotated[
        Path | None,
        typer.Option(
            help="the simulation's nominal vehicle, YAML or a name as for adk simulate; without "
            "it its mass is what the bag shows, with wheels of 0.325 m"
        ),
    ] = None,
    without_imu: Annotated[
        bool,
        typer.Option("--without-imu", help="judge a recording that has no IMU by odometry alone"),
    ] = False,
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
    from adk_ros.files.output_folder import check_output_folder
    from adk_ros.mismatch.analysis import identify_mismatch
    from adk_ros.mismatch.deployment.simulator_input import (
        is_simulator_file,
        load_simulator,
        simulate_matched_drive,
    )
    from adk_ros.mismatch.recording.from_bag import read_sensor_log
    from adk_ros.mismatch.recording.nominal_vehicle import load_nominal_vehicle, nominal_vehicle_of
    from adk_ros.mismatch.report.result_files import as_dict, write_report
    from adk_ros.mismatch.report.summary import sentence
    from adk_ros.plant.vehicle.vehicle_parameters import Vehicle
    from adk_ros.shutdown import TERMINATED, Terminated, graceful_shutdown

    check_output_folder(out)
    if simulation.resolve() == recording.resolve():
        raise UsageError(f"{recording}: simulation and recording are the same bag")
    of_file = load_simulator(simulation) if is_simulator_file(simulation) else None
    if of_file is not None and vehicle is not None:
        raise UsageError(
            f"{simulation} says the vehicle already: give --vehicle with a simulator's bag alone"
        )
    nominal = None if vehicle is None else load_nominal_vehicle(vehicle)
    options = drive_options(imu, odometry, command, False, params)
    with console.progress(f"reading {recording.name}") as bar:
        # Beside a simulator's own IMU a missing one is rather a topic that was forgotten.
        needed = of_file is None and not without_imu
        recorded = read_sensor_log(recording, options, bar, needed)
    for text in recorded.warnings:
        console.warn(text)
    simulated: SensorLog | SurrogateModel
    if isinstance(of_file, Vehicle):
        nominal = nominal_vehicle_of(of_file)
        simulated = simulate_matched_drive(of_file, recorded, simulation.name)
    elif of_file is not None:
        simulated = of_file
    else:
        with console.progress(f"reading {simulation.name}") as bar:
            simulated = read_sensor_log(simulation, options, bar)
        for text in simulated.warnings:
            console.warn(text)
    with console.progress("comparing") as bar:
        findings = identify_mismatch(simulated, recorded, nominal, bar)
    try:
        # What is half written goes with whoever is stopped.
        with graceful_shutdown():
            write_report(findings, out)
    except Terminated:
        console.note("adk: terminated")
        raise typer.Exit(TERMINATED) from None
    if as_json:
        console.print_json(as_dict(findings))
        return
    for text in (*findings.notes, *(lack.text for lack in findings.missing_channels)):
        console.note(text)
    console.output.print(sentence(findings), markup=False)
    console.note(f"report.html, mismatch.json, simulation.yaml and corrected.yaml in {out}")
