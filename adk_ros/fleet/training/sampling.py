# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Which data of a fleet train, validate and test a model.

Vehicles are held out whole: a model that has seen a car does not show how well it knows others.
The training data are drawn in windows of blocks, of which one is in memory at a time, without
repetition until all blocks of a condition were drawn.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from adk_ros.errors import UsageError

VALIDATION_SHARE, TEST_SHARE = 0.1, 0.2
"""Shares of the vehicles, as of the blocks in `train.dataset`; at least one vehicle each."""


@dataclass(frozen=True)
class FleetBlock:
    """
    Rows `start` to `stop` of a shard.

    `recording`, `vehicle`: names; `condition`: driving condition and tags; `seconds`: learnable
    duration.
    """

    recording: str
    vehicle: str
    shard: str
    start: int
    stop: int
    condition: str
    seconds: float
    estimated: tuple[str, ...] = ()


@dataclass(frozen=True)
class VehicleSplit:
    """Names of the vehicles that train, validate and test."""

    train: tuple[str, ...]
    validation: tuple[str, ...]
    test: tuple[str, ...]


def split_vehicles(
    vehicles: Iterable[str],
    seed: int = 0,
    validation: Sequence[str] = (),
    test: Sequence[str] = (),
) -> VehicleSplit:
    """
    Assign vehicles to parts, the given ones or a tenth for validation and a fifth for the test.

    The order is that of a hash of the name, so that a further vehicle changes little.

    :raises UsageError: a given vehicle has no data or is in both parts, or none is left to train.
    """
    names = sorted(set(vehicles), key=lambda name: _hash(f"{seed} {name}"))
    if len(names) < 3:
        raise UsageError(
            f"{len(names)} vehicle{'s have' if len(names) != 1 else ' has'} usable recordings "
            f"({', '.join(names) or 'none'}): one trains, one validates, one tests; name the "
            "vehicles in fleet.csv, or use 'adk train'"
        )
    for name in (*validation, *test):
        if name not in names:
            raise UsageError(
                f"vehicle {name!r} has no usable recording; there are {', '.join(sorted(names))}"
            )
    if both := sorted(set(validation) & set(test)):
        raise UsageError(f"vehicle {both[0]!r} cannot both validate and test")
    free = [name for name in names if name not in {*validation, *test}]
    tested = tuple(test) or _taken(free, TEST_SHARE * len(names))
    validated = tuple(validation) or _taken(free, VALIDATION_SHARE * len(names))
    if not free:
        raise UsageError("no vehicle is left to train: name fewer to validate and test")
    return VehicleSplit(tuple(sorted(free)), validated, tested)


def _taken(free: list[str], number: float) -> tuple[str, ...]:
    count = max(1, round(number))
    taken = tuple(sorted(free[:count]))
    del free[:count]
    return taken


class BlockWindows:
    """
    Windows of training blocks, about `seconds` each: up to half a block more for each condition.

    `count` windows hold about as much as all blocks together, at least `least`. Balanced: windows
    have equal shares of all conditions, of a rare one all there is; else the shares of the data.
    Where a share is less than a block, a condition is in a window in turn. A window is the same
    whenever it is asked for.
    """

    def __init__(
        self,
        blocks: Sequence[FleetBlock],
        seconds: float,
        seed: int = 0,
        balanced: bool = True,
        least: int = 2,
    ) -> None:
        total = sum(block.seconds for block in blocks)
        self.count = max(least, int(np.ceil(total / seconds)))
        self._seconds = min(seconds, total / self.count)
        self._groups: dict[str, list[FleetBlock]] = {}
        random = np.random.default_rng(seed)
        for i in random.permutation(len(blocks)):
            condition = blocks[i].condition if balanced else ""
            self._groups.setdefault(condition, []).append(blocks[i])
        text = repr((blocks, seconds, seed, balanced, least))
        self.key = hashlib.sha256(text.encode()).hexdigest()
        self.quotas = _quotas(
            {name: sum(b.seconds for b in group) for name, group in self._groups.items()},
            self._seconds,
        )

    def blocks(self) -> list[FleetBlock]:
        """Return all blocks."""
        return [block for group in self._groups.values() for block in group]

    def shares(self) -> dict[str, tuple[float, float]]:
        """Return condition -> its share of the data, and of a window."""
        available = {n: sum(b.seconds for b in group) for n, group in self._groups.items()}
        total, drawn = sum(available.values()), sum(self.quotas.values())
        return {n: (available[n] / total, self.quotas[n] / drawn) for n in sorted(available)}

    def window(self, number: int) -> list[FleetBlock]:
        """Return the blocks of a window, in the order in which files are read best."""
        chosen: list[FleetBlock] = []
        nearest: list[tuple[float, FleetBlock]] = []
        for i, (condition, group) in enumerate(self._groups.items()):
            # Each condition goes through its blocks in a circle, a quota further in each window:
            # a block is drawn in the window that its middle falls into. The conditions begin at
            # other parts of a block, so that rare ones do not all come in the same windows.
            durations = np.array([block.seconds for block in group])
            ends, quota = np.cumsum(durations), self.quotas[condition]
            begin = durations.mean() * i / len(self._groups)
            first = (begin + number * quota) % ends[-1]
            # A middle on the boundary of two windows is of the later one, whatever is rounded.
            ahead = (ends - 0.5 * durations - first + 1e-9 * ends[-1]) % ends[-1]
            chosen += [group[j] for j in np.flatnonzero(ahead < quota)]
            nearest.append((float(ahead.min()), group[int(ahead.argmin())]))
        # Less than half a block long, a window may hold no middle.
        chosen = chosen or [min(nearest, key=lambda pair: pair[0])[1]]
        return sorted(chosen, key=lambda block: (block.shard, block.start))


def _quotas(available: Mapping[str, float], total: float) -> dict[str, float]:
    """Return equal shares of `total` for all, of which none is above what is available, s."""
    quotas: dict[str, float] = {}
    left = total
    for rank, name in enumerate(sorted(available, key=lambda name: (available[name], name))):
        quotas[name] = min(available[name], left / (len(available) - rank))
        left -= quotas[name]
    return quotas


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
