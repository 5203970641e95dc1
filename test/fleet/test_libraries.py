# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A missing library of the fleet engine is named with the commands that install it."""

from __future__ import annotations

import sys

import pytest

from adk_ros.bench.fleet.throughput import bench_throughput
from adk_ros.bench.fleet.work import BusyStage
from adk_ros.errors import UsageError
from adk_ros.fleet.libraries import fleet_library


def test_a_missing_library_is_named_with_both_commands(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(
        UsageError,
        match=r"adk fleet needs distributed.*: pip install 'adk_ros\[fleet\]', in a checkout "
        r"'make fleet'",
    ):
        fleet_library("distributed")


def test_the_benchmark_names_what_installs_joblib(monkeypatch) -> None:
    """The libraries of the fleet engine, which `make fleet` installs, do not contain it."""
    monkeypatch.setitem(sys.modules, "joblib", None)
    with pytest.raises(
        UsageError,
        match=r"adk bench fleet --part throughput needs joblib.*: pip install "
        r"'adk_ros\[bench\]', in a checkout 'make bench'",
    ):
        bench_throughput(20, BusyStage(), 1, lambda *_: None)
