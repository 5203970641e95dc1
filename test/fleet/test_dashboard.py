# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The engine's page: its address in the progress text answers while the run goes on."""

from __future__ import annotations

import re
from functools import partial
from urllib.request import ProxyHandler, build_opener

import pytest
from helpers.fleet import text_fleet, text_stage

from adk_ros.fleet.cluster import open_cluster
from adk_ros.fleet.run import Limits, run_stage


@pytest.mark.slow(seconds=10)
def test_the_printed_address_of_the_dashboard_answers(tmp_path) -> None:
    recordings = text_fleet(tmp_path / "drives", {"a": "ok 1"})
    answers = []
    # The page is on this machine, whatever proxy the environment names.
    opener = build_opener(ProxyHandler({}))

    def ask(done: float, total: float, text: str) -> None:
        (address,) = re.findall(r", dashboard (\S+)$", text)
        with opener.open(address, timeout=60) as answer:
            answers.append((answer.status, b"Dask" in answer.read()))

    run_stage(
        text_stage(tmp_path / "log"), recordings, tmp_path / "out", partial(open_cluster, 1),
        Limits(timeout_s=60.0), ask,
    )  # fmt: skip
    # Hashing and the stage, before and after the recording.
    assert answers == [(200, True)] * 4
