# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Claims that alternate: linearised at the one, the fleet shows the other.

Each linearisation is exact at its claims only, so that two explanations may each look better from
the other's. Both have been linearised then, and the one that leaves less of the loss there stays.
What is claimed only where the fleet is not linearised at it is no claim.
"""

from __future__ import annotations

from adk_ros.fleet.inference.fleet_candidates import Identity
from adk_ros.mismatch.library.criteria import PENALTY_PER_PARAMETER

Claims = frozenset[Identity]


class AlternatingClaims:
    """
    The claims at which a fleet was linearised, and what each left of the loss.

    `refused`: what was claimed in the worse one of two that alternate, and not in the other.
    """

    def __init__(self) -> None:
        self.refused: Claims = frozenset()
        self._losses: dict[Claims, float] = {}

    def settle(self, at: Claims, loss: float, found: Claims) -> bool:
        """
        Note what claims left of the loss, and return whether those found now are to be refused.

        `at`: claims at which the fleet is linearised, and the `loss` that they leave there;
        `found`: what is claimed there. Each claim costs the penalty of a parameter. Of two sets of
        which one has all claims of the other, the larger one is worse.
        """
        self._losses[at] = loss + PENALTY_PER_PARAMETER * len(at)
        if found == at or found not in self._losses:
            return False
        is_found_worse = self._losses[found] > self._losses[at]
        if found < at or at < found:
            is_found_worse = at < found
        worse, better = (found, at) if is_found_worse else (at, found)
        self.refused |= worse - better
        return worse == found
