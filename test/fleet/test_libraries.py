# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A missing library of the fleet engine is named with the commands that install it."""

from __future__ import annotations

import sys

import pytest

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
