# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print which weak effects that all cars have are found by many short recordings together.

    python scripts/fleet_pooling.py [--seed 5] [--strength 0.1] [--recordings 30] [--cars 6]
        [--seconds 60] [--jobs 2] [--nothing 20] [--one-recording] [--effects aero_drag ...]

One fleet for each effect of a single parameter: all of its cars have the effect, at a share of the
size at which the benchmark injects it. With --nothing so many fleets in which nothing acts:
whatever is claimed is false. With --one-recording each fleet is compared with one recording of one
car that is as long as all recordings of the fleet together, analysed as by `adk mismatch`. The
drives are simulated in memory.
"""

from __future__ import annotations

import argparse
import math
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
from adk_ros.fleet.inference.fleet_result import Claim, FleetResult
from adk_ros.fleet.inference.levels import SHARED, Level
from adk_ros.mismatch.analysis import identify_mismatch
from adk_ros.mismatch.inference.result import UNKNOWN, IdentifiedEffect
from adk_ros.mismatch.library.effect import ALWAYS
from adk_ros.plant.injection.injectors import FULL, SPRUNG_CAR_ONLY, scale_strength

_SIMULATION_S, _ROUTES = 300.0, 3
_LONG_SIMULATION_S = 660.0
"""
Duration of the simulation for one recording, s: that of all for a fleet, 300 s and 120 s on each
of three routes (`fleet_drives`).
"""
_ALL_CARS = Level(SHARED)


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

    @property
    def label(self) -> str:
        """Number and duration of the recordings."""
        count = self.size.recordings
        return f"{count} recording{'s' * (count != 1)} of {self.size.durations_s[1]:g} s"

    @property
    def drives(self) -> FleetDrives:
        """The drives, each of which has the effect."""
        plan = plan_fleet(self.seed, self.size).without_effects()
        if self.effect:
            parameters = scale_strength(self.effect, self.strength)
            plan = replace(plan, terms=(InjectedTerm(self.effect, parameters, _ALL_CARS),))
        return FleetDrives(plan)

    def compared(self) -> TruthComparison:
        """
        Simulate and analyse the fleet, and compare the result with what was injected.

        :raises DataError: no recording allows an analysis.
        """
        drives = self.drives
        return _with_truth(MemoryFleet(drives).analysed().result, drives)


class LongRecording(Fleet):
    """
    One recording of one car, as long as all recordings of a fleet together.

    The car and the roads are those of the fleet with this seed; one of its routes is driven lap
    after lap. The drive of the simulation is as long as all those for the fleet together. The
    analysis is that of `adk mismatch`, with its last quarter held out: a user has no other one for
    one recording. The inference of a fleet claims nothing of one recording, which does not
    determine the scatter between recordings (tau in `variance_components`).

    A size of less than the materiality threshold, the build tolerance of a car, is not claimed; of
    a fleet, that limit is lower by the square root of the number of cars (`Candidates.tolerance`).
    """

    @classmethod
    def of(cls, fleet: Fleet) -> LongRecording:
        """Return the recording that has the same effect and duration as a fleet."""
        seconds = fleet.size.recordings * fleet.size.durations_s[1]
        size = replace(
            fleet.size,
            cars=1,
            recordings=1,
            durations_s=(seconds, seconds),
            simulation_s=_LONG_SIMULATION_S,
        )
        return cls(fleet.effect, fleet.seed, size, fleet.strength)

    def compared(self) -> TruthComparison:
        """
        Simulate and analyse the recording, and compare the result with what was injected.

        :raises DataError: the recording does not allow an analysis.
        """
        drives = self.drives
        (planned,) = drives.plan.drives
        found = identify_mismatch(drives.simulation(), drives.drive(planned), drives.nominal)
        result = FleetResult((), (), claims_of(found.effects), (), (), (), (), (), 0)
        compared = _with_truth(result, drives)
        return with_unmodelled(compared) if found.verdict == UNKNOWN else compared


def _with_truth(result: FleetResult, drives: FleetDrives) -> TruthComparison:
    return compare_with_truth(result, truth(drives) | {"place": None})


def claims_of(effects: Sequence[IdentifiedEffect]) -> tuple[Claim, ...]:
    """
    Return the effects that `adk mismatch` identifies, as claims of a fleet of one car.

    Size and interval are differences from neutral, of the first parameter of an effect. With one
    car, what acts always is an effect of this car and of all cars at once: it counts as a claim of
    all cars. What acts at a place, or from a time on, keeps that kind and has no ties: it is
    another claim than that of an effect that acts always.
    """
    return tuple(_claim(effect) for effect in effects)


def _claim(found: IdentifiedEffect) -> Claim:
    acts_always = found.kind == ALWAYS
    name, interval = next(iter(found.parameters.items()))
    neutral = next(p.neutral for p in found.effect.parameters if p.name == name)
    ties = found.alternatives if acts_always else ()
    return Claim(
        effect=found.effect.name,
        parameter=name,
        unit=interval.unit,
        kind=SHARED if acts_always else found.kind,
        level=_ALL_CARS.text if acts_always else found.kind,
        car="",
        tag="",
        value="",
        onset_day=None,
        onset_low_day=None,
        onset_high_day=None,
        size=interval.value - neutral,
        low=interval.low - neutral,
        high=interval.high - neutral,
        evidence=found.gain,
        p_value=math.nan,
        between_recordings=math.nan,
        between_cars=math.nan,
        ties=tuple(f"{other} ({_ALL_CARS.text})" for other in ties),
    )


def with_unmodelled(compared: TruthComparison) -> TruthComparison:
    """
    Return a comparison with the further claim that something of unknown cause is missing.

    It is false if every injected effect is named: then nothing else is missing.
    """
    is_false = compared.named == compared.injected
    line = f"{'FALSE  ' * is_false}something of unknown cause"
    return replace(compared, lines=(*compared.lines, line), false=compared.false + is_false)


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
        "--one-recording", action="store_true", help="compare with one as long as all of a fleet"
    )
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
    groups = [fleets]
    if given.one_recording:
        groups.append([LongRecording.of(fleet) for fleet in fleets])
    every = [each for together in zip(*groups, strict=True) for each in together]
    found = []
    with ProcessPoolExecutor(given.jobs) as pool:
        for each, one in zip(every, pool.map(_compared, every), strict=True):
            text = f" {each.thresholds:.2f} thresholds" if each.effect else ""
            lines = "; ".join(one.lines) or "nothing"
            print(f"seed {each.seed}{text}, {each.label}: {lines}", flush=True)
            found.append(one)
    thresholds = [fleet.thresholds for fleet in fleets]
    columns = [totals(found[i :: len(groups)], thresholds) for i in range(len(groups))]
    print(f"| | {' | '.join(group[0].label for group in groups)} |")
    print("| --- " * (1 + len(groups)) + "|")
    for row in columns[0]:
        print(f"| {row} | {' | '.join(column[row] for column in columns)} |")


if __name__ == "__main__":
    try:
        main()
    except AdkError as error:
        sys.exit(str(error))
