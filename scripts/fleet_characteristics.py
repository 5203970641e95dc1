# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print false alarms, power and coverage of the fleet's combination on numerical fleets.

    python scripts/fleet_characteristics.py [--fleets 100] [--seed 0]

Each row is a plan (see `adk_ros.fleet.inference.numerical_fleet`): what the fleet contains, the
share of fleets with a false alarm, of injected terms found at the right level, and of their 90 %
intervals that contain the size.
"""

from __future__ import annotations

import argparse

from adk_ros.fleet.inference.levels import CAR, CONDITION, SHARED, Level
from adk_ros.fleet.inference.numerical_fleet import FleetPlan, Injection
from adk_ros.fleet.inference.operating_characteristics import characteristics

_SHARED = Injection("aero_drag.cda", Level(SHARED), 3.3)
_CAR = Injection("rolling_resistance.crr", Level(CAR, car="car02"), 8.0)
_SOFTWARE = Injection("tyre_relaxation.length", Level(CONDITION, tag="software", value="2.1"), 5.0)
PLANS = {
    "nothing": FleetPlan(),
    "nothing, cars differ": FleetPlan(kappa=0.5),
    "nothing, recordings differ": FleetPlan(tau=1.0),
    "nothing, both differ, 12 cars": FleetPlan(cars=12, recordings=60, tau=0.5, kappa=0.5),
    "shared 3.3": FleetPlan(injections=(_SHARED,)),
    "well determined, 3.3": FleetPlan(deviation=0.3, injections=(_SHARED,)),
    "shared 3.3, recordings differ": FleetPlan(injections=(_SHARED,), tau=0.5),
    "shared, car, software": FleetPlan(
        cars=10, recordings=60, injections=(_SHARED, _CAR, _SOFTWARE)
    ),
}


def main() -> None:
    """Print one row per plan."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fleets", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="")
    arguments = parser.parse_args()
    seeds = range(arguments.seed, arguments.seed + arguments.fleets)
    print("| fleet | with a false alarm | terms found | 90 % intervals that hold |")
    print("| --- | --- | --- | --- |")
    for name, plan in PLANS.items():
        if arguments.only and arguments.only not in name:
            continue
        c = characteristics(plan, seeds)
        found = f"{c.found} of {c.injected}" if c.injected else "-"
        covered = f"{c.covered} of {c.found}" if c.found else "-"
        print(f"| {name} | {c.with_false_alarm} of {c.fleets} | {found} | {covered} |", flush=True)


if __name__ == "__main__":
    main()
