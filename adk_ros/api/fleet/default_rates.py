# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
How long the work on a recording takes, before a store has a result of it.

Measured with the commands of doc/fleet.md on an AMD EPYC: an order of magnitude, on other machines
and at other sample rates. The first results replace it.
"""

from __future__ import annotations

DEFAULT_CORE_S = {
    "index": 0.7,
    "replay": 1.7,
    "explain": 13.0,
    "evidence": 0.4,
    "shards": 0.5,
}
"""s of a core for a minute of recording, by stage; of `evidence`, in each pass."""

DEFAULT_STEP_S = 0.05
"""s of a training step of 'adk fleet train' with its default settings."""


def default_basis(stage: str) -> str:
    """Return where the default rate of a stage comes from."""
    return (
        f"a default of {DEFAULT_CORE_S[stage]:g} s of a core for a minute of recording"
        f"{' and pass' if stage == 'evidence' else ''}, as an AMD EPYC takes"
    )
