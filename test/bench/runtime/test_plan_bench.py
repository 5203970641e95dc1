# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Horizons under plans, measured: exact plans help, plans that nobody carries out do no harm."""

import json

import numpy as np
import pytest
from helpers.model import make_model, slalom

from adk_ros.bench.runtime.plan_bench import EXACT, HELD, KINDS, OTHER, measure_plans
from adk_ros.cli.main import main
from adk_ros.errors import DataError
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.channels import Record


def record(n: int) -> Record:
    samples = list(slalom(n))
    x = np.array([s.x for s in samples])
    return Record(
        stamp_ns=np.array([s.stamp_ns for s in samples]), x=x, u=np.array([s.u for s in samples]),
        a=np.array([s.a for s in samples]), flags=np.array([s.flags for s in samples]), x_ref=x,
        episode=np.zeros(n, dtype=np.int64),
    )  # fmt: skip


def test_measures_by_kind_of_plan() -> None:
    result = measure_plans(make_model(), record(900))
    assert result["starts"] > 300
    followed = [result[kind]["followed"] for kind in KINDS]
    assert followed[0] == 0.0
    assert followed[1] == 1.0
    assert followed[KINDS.index(OTHER)] < 0.5

    def table(kind: str, name: str) -> FloatArray:
        return np.array(result[kind][name])

    for kind in KINDS:
        assert table(kind, "ratio").shape == (5, 3)
        inside = table(kind, "coverage")
        assert ((inside >= 0.0) & (inside <= 1.0)).all()
        assert (table(kind, "interval_score") >= table(kind, "width")).all()
        assert (np.diff(table(kind, "path_rmse"), axis=0) > 0.0).all()
        inside = table(kind, "path_coverage")
        assert ((inside >= 0.0) & (inside <= 1.0)).all()
    # The next sample knows no plan.
    np.testing.assert_array_equal(table(HELD, "ratio")[0], table(EXACT, "ratio")[0])


def test_a_short_drive_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(DataError, match="too short"):
        measure_plans(make_model(), record(300))
    assert main(["bench", "plan", "--duration", "5"]) == 2
    assert "choose 30 to 3600 s" in capsys.readouterr().err


@pytest.mark.slow(seconds=60)
def test_on_a_simulated_drive(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "plan", "--duration", "60", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    held, planned = (np.array(result[kind]["ratio"]) for kind in (HELD, EXACT))
    # From a second on, knowing the commands halves the errors of v_x and yaw rate at least.
    assert (planned[3:, [0, 2]] < 0.5 * held[3:, [0, 2]]).all()
    other = np.array(result[OTHER]["ratio"])
    # The temporary model is a poor one: what a plan costs by chance is a larger share.
    assert (other < 1.3 * held).all()
