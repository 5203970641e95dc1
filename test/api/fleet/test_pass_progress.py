# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The number of the pass in the progress of an analysis."""

from __future__ import annotations

from adk_ros.api.fleet.pass_progress import PassProgress


def test_texts_begin_with_the_pass() -> None:
    said: list[tuple[float, float, str]] = []
    progress = PassProgress(lambda *given: said.append(given))
    progress(0, 1, "identifying")
    progress.begin_pass(1, 7)
    progress(2, 40, "hashing 2/40")
    progress.begin_pass(2, 6)
    progress.of_analysis(0.5, "selecting effects and levels")
    assert said == [
        (0, 1, "identifying"),
        (2, 40, "pass 1 of at most 7, hashing 2/40"),
        (0.5, 1.0, "pass 2 of at most 6, selecting effects and levels"),
    ]


def test_without_a_callback_nothing_is_said() -> None:
    PassProgress(None)(1, 2, "text")
