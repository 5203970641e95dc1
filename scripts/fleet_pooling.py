# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print which weak effects that all cars have are found by many short recordings together.

    python scripts/fleet_pooling.py [--seed 5] [--strength 0.1] [--recordings 30] [--cars 6]
        [--seconds 60] [--jobs 2] [--nothing 20] [--effects aero_drag ...]

One fleet for each effect of a single parameter: all of its cars have the effect, at a share of the
size at which the benchmark injects it. With --nothing so many fleets in which nothing acts:
whatever is claimed is false. The drives are simulated in memory.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace

from adk_ros.errors import AdkError
from adk_ros.fleet.demo.fleet_drives import FleetDrives
from adk_ros.fleet.demo.fleet_folder import truth
from adk_ros.fleet.demo.fleet_plan import FleetSize, InjectedTerm, plan_fleet
from adk_ros.fleet.demo.memory_analysis import MemoryFleet
from adk_ros.fleet.demo.truth_comparison import TruthComparison, compare_with_truth
from adk_ros.fleet.inference.evidence import column_of, effect_columns
from adk_ros.fleet.inference.levels import SHARED, Level
from adk_ros.plant.injection.injectors import FULL, SPRUNG_CAR_ONLY, scale_strength

_SIMULATION_S, _ROUTES = 300.0, 3


@dataclass(frozen=True)
class Fleet:
    """A fleet to simulate; `effect`: what all of its cars have, nothing if it is empty."""

    effect: str
    seed: int
    size: FleetSize
    strength: float

    @property
    def thresholds(self) -> float:
        """Size of the effect, in materiality thresholds: less is a single car's tolerance."""
        if not self.effect:
            return 0.0
        ((name, value),) = scale_strength(self.effect, self.strength).items()
        column = column_of(f"{self.effect}.{name}")
        p = column.parameter
        return abs(p.theta(value) - p.theta_neutral) / column.materiality

    def compared(self) -> TruthComparison:
        """Simulate and analyse the fleet, and compare the result with what was injected."""
        plan = plan_fleet(self.seed, self.size).without_effects()
        if self.effect:
            parameters = scale_strength(self.effect, self.strength)
            term = InjectedTerm(self.effect, parameters, Level(SHARED))
            plan = replace(plan, terms=(term,))
        drives = FleetDrives(plan)
        return compare_with_truth(
            MemoryFleet(drives).analysed().result, truth(drives) | {"place": None}
        )


def totals(compared: Sequence[TruthComparison], thresholds: Sequence[float]) -> dict[str, str]:
    """
    Return the rows of a table: what is counted -> how many of how many, with the share.

    :param thresholds: size of the effect of each comparison, in materiality thresholds.
    """
    # The size of several effects is the threshold itself, but for rounding.
    material = [
        one for one, size in zip(compared, thresholds, strict=True) if round(size, 6) >= 1.0
    ]
    return {
        "effects named": _named(compared),
        "those of a threshold and more": _named(material),
        "with a false claim": _share(sum(one.false > 0 for one in compared), len(compared)),
        "sizes in their 90 % interval": _share(
            sum(one.inside for one in compared), sum(one.sized for one in compared)
        ),
    }


def _named(compared: Sequence[TruthComparison]) -> str:
    tied = sum(one.tied for one in compared)
    text = _share(sum(one.named for one in compared), sum(one.injected for one in compared))
    return f"{text}, {tied} in a tie" if tied else text


def _share(count: int, of: int) -> str:
    return f"{count} of {of} ({100.0 * count / of:.0f} %)" if of else "-"


def _compared(fleet: Fleet) -> TruthComparison:
    return fleet.compared()


def weak_effects() -> list[str]:
    """Return the effects of one parameter that the plant can inject and that may act always."""
    acting_always = {column.effect.name for column in effect_columns()}
    return [
        name
        for name, parameters in FULL.items()
        if len(parameters) == 1 and name not in SPRUNG_CAR_ONLY and name in acting_always
    ]


def main() -> None:
    """Print a line for each fleet, and the totals as a table."""
    effects = weak_effects()
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=5, help="of the first fleet, then counted up")
    parser.add_argument("--strength", type=float, default=0.1)
    parser.add_argument("--recordings", type=int, default=30)
    parser.add_argument("--cars", type=int, default=6)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--nothing", type=int, default=0, metavar="N", help="N fleets without any")
    parser.add_argument(
        "--effects",
        nargs="+",
        choices=effects,
        metavar="EFFECT",
        help="these only, with the seeds that they have among all",
    )
    given = parser.parse_args()
    size = FleetSize(
        given.cars,
        given.recordings,
        (given.seconds, given.seconds),
        _SIMULATION_S,
        _ROUTES,
        faulty=0,
        damaged=0,
    )
    fleets = [
        Fleet(effect, given.seed + i, size, given.strength)
        for i, effect in enumerate([""] * given.nothing or effects)
        if given.effects is None or effect in ("", *given.effects)
    ]
    with ProcessPoolExecutor(given.jobs) as pool:
        found = []
        for fleet, one in zip(fleets, pool.map(_compared, fleets), strict=True):
            text = f" {fleet.thresholds:.2f} thresholds" if fleet.effect else ""
            print(f"seed {fleet.seed}{text}: {'; '.join(one.lines) or 'nothing'}", flush=True)
            found.append(one)
    print("| | fleets |")
    print("| --- | --- |")
    for row, text in totals(found, [fleet.thresholds for fleet in fleets]).items():
        print(f"| {row} | {text} |")


if __name__ == "__main__":
    try:
        main()
    except AdkError as error:
        sys.exit(str(error))
