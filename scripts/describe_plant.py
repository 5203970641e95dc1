# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Run every packaged scenario and print tables of its properties and of the vehicles' body modes.

    .venv/bin/python scripts/describe_plant.py

doc/plant.md contains the output.
"""

from __future__ import annotations

import time

import numpy as np

from adk_ros.plant.environment.road import ROAD_GRADE, ROAD_HEIGHT, locate
from adk_ros.plant.scenario.oracle import oracle_rollout
from adk_ros.plant.scenario.scenario_file import load_scenario, scenarios
from adk_ros.plant.scenario.sensor_simulation import SimulatedDrive
from adk_ros.plant.scenario.simulate import simulate
from adk_ros.plant.vehicle import fourteen_dof
from adk_ros.plant.vehicle.sprung_mass import resolve, vertical_modes
from adk_ros.plant.vehicle.vehicle_parameters import load_vehicle, vehicles


def offset(drive: SimulatedDrive) -> float:
    """Return the largest distance from the centre line of the route in m."""
    table, spacing = drive.route.table, drive.route.spacing
    places = zip(drive.arc_length, drive.pose, strict=True)
    return max(abs(locate(table, spacing, s, x, y)[1]) for s, (x, y, _) in places)


def scenario_line(name: str) -> str:
    """Return the table row of a scenario."""
    scenario = load_scenario(name)
    drive = simulate(scenario, duration_s=min(scenario.duration_s, 300.0))
    table = drive.route.table
    v_x = 3.6 * drive.x[:, 0]
    grade = np.degrees(table[:, ROAD_GRADE])
    roll = "-"
    if drive.plant == "fourteen_dof":
        roll = f"{np.degrees(np.abs(drive.states[:, fourteen_dof.ROLL]).max()):.1f}"
    away = f"{offset(drive):.2f}" if scenario.steering is None else "open loop"
    return (
        f"| {name} | {drive.plant.split('_')[0]} | {scenario.duration_s:.0f} "
        f"| {drive.route.length / 1000.0:.1f} | {np.ptp(table[:, ROAD_HEIGHT]):.0f} "
        f"| {grade.min():.1f} to {grade.max():.1f} | {v_x.min():.0f} to {v_x.max():.0f} "
        f"| {np.square(drive.a[:, 1]).mean() ** 0.5:.1f}, {np.abs(drive.a[:, 1]).max():.1f} "
        f"| {np.degrees(np.abs(drive.x[:, 2]).max()):.0f} | {roll} | {away} |"
    )


def vehicle_line(name: str) -> str:
    """Return the table row of a vehicle."""
    vehicle = load_vehicle(name)
    body = resolve(vehicle)
    modes = vertical_modes(vehicle, body)
    body_modes = sorted(modes[modes.imag >= 0.0], key=abs)[:3]
    hertz = ", ".join(f"{abs(mode) / (2.0 * np.pi):.1f}" for mode in body_modes)
    return (
        f"| {name} | {vehicle.mass:.0f} | {body.sprung_mass:.0f} | {hertz} "
        f"| {np.abs(modes).max():.0f} |"
    )


def oracle_line(name: str) -> str:
    """Return the table row with the oracle's errors over 2 s, without and with sensor noise."""
    drive = simulate(load_scenario(name), duration_s=100.0)
    rows = np.arange(40, len(drive.x) - 81, 40)
    noise = np.random.default_rng(0).normal(0.0, [0.02, 0.02, 0.002], (len(rows), 3))
    truth = np.stack([drive.x[row + 1 : row + 81] for row in rows])
    exact = np.abs(oracle_rollout(drive, rows, drive.x[rows], 80) - truth).max()
    noisy = oracle_rollout(drive, rows, drive.x[rows] + noise, 80) - truth
    scale = [3.6, 3.6, np.degrees(1.0)]
    cells = [
        ", ".join(f"{value:.3f}" for value in np.sqrt(np.square(noisy[:, j]).mean(axis=0)) * scale)
        for j in (0, 19, 79)
    ]
    return f"| {name} | {exact:.0e} | {' | '.join(cells)} |"


def cost() -> str:
    """Return the run time of 1400 s of xyz_edges with sensors, the shorter of two runs."""
    scenario = load_scenario("xyz_edges")
    simulate(scenario, duration_s=0.2)
    best = np.inf
    for _ in range(2):
        begin = time.process_time()
        simulate(scenario)
        best = min(best, time.process_time() - begin)
    return f"1400 s of xyz_edges, sensors included: {best:.1f} s of one core"


if __name__ == "__main__":
    print("\n".join(vehicle_line(name) for name in vehicles()), "\n")
    print("\n".join(scenario_line(name) for name in scenarios()), "\n")
    names = ("handling", "xyz_edges", "mountain", "slalom", "winter")
    print("\n".join(oracle_line(name) for name in names), "\n")
    print(cost())
