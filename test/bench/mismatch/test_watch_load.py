# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The CPU load of the whole watch on a drive in real time."""

from __future__ import annotations

import pytest

from adk_ros.bench.mismatch.watch_load import check_live, load_line, watch_load
from adk_ros.cli.main import main
from adk_ros.errors import UsageError


@pytest.mark.slow(seconds=60)
def test_the_load_is_that_of_a_watch_that_receives_everything() -> None:
    # Otherwise it raises.
    assert 0.0 < watch_load(5.0, learn_s=20.0) < 100.0


@pytest.mark.parametrize("seconds", [-1.0, 1e6])
def test_a_wrong_duration_is_refused(seconds: float, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(UsageError, match="--live"):
        check_live(seconds)
    assert main(["bench", "watch", "--live", str(seconds)]) == 2
    assert "--live" in capsys.readouterr().err


@pytest.mark.parametrize(("percent", "verdict"), [(9.9, "PASS"), (10.1, "FAIL")])
def test_the_line_says_whether_the_target_is_met(percent: float, verdict: str) -> None:
    assert load_line(percent).startswith(f"{verdict} ")
