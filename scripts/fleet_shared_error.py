# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print what the surrogate's error on other roads feigns as an effect of all cars.

    python scripts/fleet_shared_error.py [--seed 401] [--fleets 4] [--jobs 2]

In each fleet nothing acts: its cars differ from the simulation by build tolerances, and drive on
other roads than it. Every parameter that may act always is fitted alone, in all cars, in so many
fleets of each packaged full-size car, of many short recordings and of fewer long ones. Printed is
the root mean square of the sizes, in materiality thresholds: `shared_error.SHARED_ERROR`; then the
same with a further drive of the simulation on each route of the fleet: `REMAINING_ERROR`.
"""

from __future__ import annotations

import argparse
import sys
from collections import defaultdict
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from itertools import product

import numpy as np

from adk_ros.errors import AdkError
from adk_ros.fleet.demo.fleet_drives import FleetDrives
from adk_ros.fleet.demo.fleet_plan import FleetPlan, FleetSize, plan_fleet
from adk_ros.fleet.demo.memory_analysis import MemoryFleet
from adk_ros.fleet.inference.fleet_evidence import FleetEvidence
from adk_ros.fleet.inference.fleet_model import Candidate, FleetModel
from adk_ros.fleet.inference.fleet_selection import Selection
from adk_ros.fleet.inference.levels import SHARED, Level

_VEHICLES = ("imdv", "light_truck")
_SIZES = (
    FleetSize(6, 30, (60.0, 60.0), 300.0, 3, 0, 0),
    FleetSize(6, 18, (150.0, 150.0), 300.0, 3, 0, 0),
)


def sizes_of_nothing(plan: FleetPlan) -> tuple[dict[str, float], dict[str, float]]:
    """
    Return the size of each parameter in all cars of a fleet in which nothing acts.

    Without and with further drives of the simulation.
    """
    fleet = MemoryFleet(FleetDrives(plan.without_effects())).evidence()
    return _sizes(fleet.without_error()), _sizes(fleet)


def _sizes(fleet: FleetEvidence) -> dict[str, float]:
    selection = Selection(fleet)
    level = Level(SHARED)
    nothing = FleetModel((), {})
    return {
        fleet.columns.effects[effect]: selection.assess(
            nothing, Candidate(effect, level, level.design(fleet))
        ).size
        for effect in selection.observable
    }


def main() -> None:
    """Print a line per parameter, largest first."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=401, help="of the first fleet")
    parser.add_argument("--fleets", type=int, default=4, help="of each car and size")
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_args()
    plans = [
        replace(plan_fleet(given.seed + i, size), vehicle=vehicle)
        for i, (vehicle, size) in enumerate(product(_VEHICLES, _SIZES * given.fleets))
    ]
    with ProcessPoolExecutor(given.jobs) as pool:
        alone, with_further = zip(*pool.map(sizes_of_nothing, plans), strict=True)
    print(f"{len(plans)} fleets in which nothing acts, sizes in materiality thresholds:")
    _print_sizes(alone)
    print("with a further drive of the simulation on each route:")
    _print_sizes(with_further)


def _print_sizes(fleets: Sequence[Mapping[str, float]]) -> None:
    found: dict[str, list[float]] = defaultdict(list)
    for sizes in fleets:
        for key, size in sizes.items():
            found[key].append(size)
    squares = {key: float(np.sqrt(np.mean(np.square(sizes)))) for key, sizes in found.items()}
    for key, square in sorted(squares.items(), key=lambda pair: -pair[1]):
        low, mean, high = (f(found[key]) for f in (min, np.mean, max))
        print(f"{key:40s} rms {square:.2f}  mean {mean:+.2f}  {low:+.2f} to {high:+.2f}")


if __name__ == "__main__":
    try:
        main()
    except AdkError as error:
        sys.exit(str(error))
