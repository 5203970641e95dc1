# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print what the fleet inference finds in a small synthetic fleet, next to what was injected.

    python scripts/fleet_recovery.py [--seed 3] [--recordings 48] [--cars 8] [--seconds 150]
        [--vehicle light_truck] [--nothing]

The drives are simulated in memory and analysed in this process. With --nothing no effect is
injected: whatever is claimed is false.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

from adk_ros.fleet.demo.fleet_drives import FleetDrives
from adk_ros.fleet.demo.fleet_folder import truth
from adk_ros.fleet.demo.fleet_plan import FleetSize, plan_fleet
from adk_ros.fleet.demo.memory_analysis import MemoryFleet
from adk_ros.fleet.demo.truth_comparison import compare_with_truth


def main() -> None:
    """Print injected and claimed effects."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--recordings", type=int, default=48)
    parser.add_argument("--cars", type=int, default=8)
    parser.add_argument("--seconds", type=float, default=150.0)
    parser.add_argument("--vehicle", default="imdv", help="packaged vehicle of the cars")
    parser.add_argument("--nothing", action="store_true", help="inject no effect")
    given = parser.parse_args()
    durations = (given.seconds, given.seconds)
    size = FleetSize(given.cars, given.recordings, durations, 300.0, 3, 3, 0)
    plan = replace(plan_fleet(given.seed, size), vehicle=given.vehicle)
    if given.nothing:
        plan = plan.without_effects()
    drives = FleetDrives(plan)
    found = MemoryFleet(drives).analysed()
    if given.nothing:
        result = found.result
        claims = [f"{claim.effect} ({claim.level})" for claim in result.claims]
        claims += [f"{place.effect} (at a place)" for place in result.places]
        print(f"{len(claims)} false claims{': ' if claims else ''}{', '.join(claims)}")
        return
    comparison = compare_with_truth(found.result, truth(drives))
    for claim in found.result.claims:
        if claim.ties:
            print(f"{claim.effect} ({claim.level}) or {', '.join(claim.ties)}")
    print("differences from neutral, claims with 90 % intervals:")
    for line in (*comparison.lines, comparison.summary):
        print(line)


if __name__ == "__main__":
    main()
