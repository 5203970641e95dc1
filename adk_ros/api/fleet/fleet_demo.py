# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The demonstration of `adk fleet`: a synthetic fleet, and its result against the truth."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from adk_ros.fleet.inference.fleet_result import Claim, FleetResult


def write_demo_fleet(
    out: Path,
    seed: int,
    quick: bool,
    progress: Callable[[float, float, str], None] | None = None,
    workers: int = 1,
) -> None:
    """
    Simulate a fleet with known faults into the new folder `out`, in `workers` processes.

    :raises UsageError: the folder exists.
    """
    from adk_ros.fleet.demo.fleet_folder import write_fleet
    from adk_ros.fleet.demo.fleet_plan import FULL_SIZE, QUICK_SIZE, plan_fleet

    def report(done: int, total: int) -> None:
        if progress is not None:
            progress(done, total, f"{done} of {total} drives")

    write_fleet(plan_fleet(seed, QUICK_SIZE if quick else FULL_SIZE), out, report, workers)


def compared_with_truth(result: FleetResult, truth: Path) -> Iterator[str]:
    """
    Yield a line for each injected effect, found or not, and for each claim that was not.

    The last line counts the effects that are named at the right level, and the false claims.
    """
    known = json.loads(truth.read_text(encoding="utf-8"))
    remaining = list(result.claims)
    named = 0
    for injected in known["effects"]:
        level = injected["level"]
        name = f"{injected['effect']} ({_level_text(level)})"
        size = ", ".join(f"{key} {value:.4g}" for key, value in injected["parameters"].items())
        matching = [c for c in remaining if _matches(c, injected["effect"], level)]
        for claim in matching:
            remaining.remove(claim)
        found = ", ".join(
            f"{c.parameter} {c.size:.4g} ({c.low:.4g} to {c.high:.4g})" for c in matching
        )
        named += bool(matching)
        yield f"{'found ' if matching else 'MISSED'} {name}: {size}; {found or 'not claimed'}"
    place = known["place"]
    places = [p for p in result.places if p.effect == place["effect"]]
    named += bool(places)
    yield f"{'found ' if places else 'MISSED'} {place['effect']} (at a place)"
    for claim in remaining:
        yield f"FALSE  {claim.effect} ({claim.level}): {claim.size:.4g}"
    others = [p for p in result.places if p.effect != place["effect"]]
    for other in others:
        yield f"FALSE  {other.effect} (at a place): {other.size:.4g}"
    total, false = len(known["effects"]) + 1, len(remaining) + len(others)
    yield (
        f"{named} of {total} injected effects are named at the right level; "
        f"{false or 'no'} false claim{'s' * (false != 1)}"
    )


def _matches(claim: Claim, effect: str, level: dict[str, Any]) -> bool:
    """Whether a claim is about this effect at this level; of trends the shape may differ."""
    if claim.effect != effect or claim.car != level["car"]:
        return False
    trends = {"step", "ramp"}
    if level["kind"] in trends:
        return claim.kind in trends
    return (claim.kind, claim.tag, claim.value) == (level["kind"], level["tag"], level["value"])


def _level_text(level: dict[str, Any]) -> str:
    parts = [level["kind"], level["car"], level["tag"], level["value"]]
    return " ".join(part for part in parts if part)
