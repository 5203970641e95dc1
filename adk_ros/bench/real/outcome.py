# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is said of a case of which the truth is known, and the scores of a group of such cases."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import TypeVar

import numpy as np


@dataclass(frozen=True, kw_only=True)
class Outcome(ABC):
    """
    What was said of one case.

    `is_named`: what was changed is named, or is among the candidates of what is; `is_alone`: it
    has no other candidate. `estimate`, `low`, `high`: its size with the 90 % interval, None unless
    named; `error`: relative to the change. `is_inside`: the true size is inside the interval.
    `false_claims`: changes of something else.
    """

    vehicle: str
    recording: str
    is_named: bool
    is_alone: bool
    estimate: float | None = None
    low: float | None = None
    high: float | None = None
    error: float | None = None
    is_inside: bool = False
    false_claims: tuple[str, ...] = ()

    @property
    @abstractmethod
    def is_left_open(self) -> bool:
        """Whether the result says that the data do not decide."""

    def as_dict(self) -> dict[str, object]:
        """Return the outcome for JSON."""
        return asdict(self)


AnyOutcome = TypeVar("AnyOutcome", bound=Outcome)


@dataclass(frozen=True)
class Score:
    """
    Scores of a group of outcomes.

    `named`: share that is named; `alone`: share without other candidates. `median_error` of the
    sizes of the named ones, `inside`: share of these whose 90 % interval has the true size; None
    without any. `false_claims`: changes of something else. `left_open`: share of which the result
    says that the data do not decide.
    """

    group: str
    cases: int
    named: float
    alone: float
    median_error: float | None
    inside: float | None
    false_claims: int
    left_open: float


def score(group: str, outcomes: Sequence[Outcome]) -> Score:
    """Return the scores of outcomes."""
    named = [x for x in outcomes if x.is_named]
    errors = [x.error for x in named if x.error is not None]
    count = max(len(outcomes), 1)
    return Score(
        group,
        len(outcomes),
        len(named) / count,
        sum(x.is_alone for x in named) / count,
        float(np.median(errors)) if errors else None,
        sum(x.is_inside for x in named) / len(named) if named else None,
        sum(len(x.false_claims) for x in outcomes),
        sum(x.is_left_open for x in outcomes) / count,
    )


def scores_by(outcomes: Iterable[AnyOutcome], key: Callable[[AnyOutcome], str]) -> list[Score]:
    """Return the scores by a key, such as the fault or the vehicle."""
    groups: dict[str, list[AnyOutcome]] = {}
    for outcome in outcomes:
        groups.setdefault(key(outcome), []).append(outcome)
    return [score(group, members) for group, members in groups.items()]
