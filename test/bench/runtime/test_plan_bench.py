# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Horizons under plans, measured: exact plans help, plans that nobody carries out do no harm."""

import json
from dataclasses import replace

import numpy as np
import pytest
from helpers.model import make_model, slalom

from adk_ros.bench.runtime.plan_bench import (
    CRITERION_NAMES,
    EXACT,
    HELD,
    KINDS,
    OTHER,
    SHORT,
    measure_plans,
)
from adk_ros.cli.main import main
from adk_ros.errors import DataError
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.channels import Record

JUDGED = ("coverage", "interval-width", "interval-score")


def record(n: int) -> Record:
    samples = list(slalom(n))
    x = np.array([s.x for s in samples])
    return Record(
        stamp_ns=np.array([s.stamp_ns for s in samples]), x=x, u=np.array([s.u for s in samples]),
        a=np.array([s.a for s in samples]), flags=np.array([s.flags for s in samples]), x_ref=x,
        episode=np.zeros(n, dtype=np.int64),
    )  # fmt: skip


def noisy_record(n: int, sigma: float) -> Record:
    """Return a record whose samples have noise that its reference has not."""
    exact = record(n)
    return replace(exact, x=exact.x + np.random.default_rng(0).normal(0.0, sigma, (n, 3)))


def test_measures_by_kind_of_plan() -> None:
    result = measure_plans(make_model(), [record(900)])
    assert result["starts"] > 300
    assert result[HELD]["followed"] == 0.0
    assert result[EXACT]["followed"] == result[SHORT]["followed"] == 1.0
    assert result[OTHER]["followed"] < 0.5

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
    # A plan of half a second is a whole one up to 0.25 s, and ends before 1 and 2 s.
    short, exact = table(SHORT, "ratio"), table(EXACT, "ratio")
    np.testing.assert_array_equal(short[:2], exact[:2])
    assert (short[3:] != exact[3:]).all()


def test_intervals_are_compared_with_the_measurement() -> None:
    """Not with the reference, of which the RMSE is: there, the two differ by 1 in all channels."""
    noisy = noisy_record(900, 0.05)
    result = measure_plans(make_model(), [noisy])
    elsewhere = measure_plans(make_model(), [replace(noisy, x_ref=noisy.x_ref + 1.0)])
    for kind in KINDS:
        assert result[kind]["coverage"] == elsewhere[kind]["coverage"]
        assert result[kind]["ratio"] != elsewhere[kind]["ratio"]
    assert result["criteria"] == elsewhere["criteria"]
    inside = np.array(result[EXACT]["coverage"])[0]
    assert ((inside > 0.8) & (inside < 0.97)).all()


def test_criteria_by_kind_of_plan() -> None:
    noisy = noisy_record(900, 0.05)
    result = measure_plans(make_model(), [noisy, noisy])
    alone = measure_plans(make_model(), [noisy])
    criteria = {item["name"]: item for item in result["criteria"]}
    assert list(criteria) == [
        f"{what}-{CRITERION_NAMES[kind]}" for kind in KINDS for what in JUDGED
    ]
    for kind in KINDS:
        coverage, width, score = (criteria[f"{what}-{CRITERION_NAMES[kind]}"] for what in JUDGED)
        inside = np.array(result[kind]["coverage"])
        good = bool(((inside >= 0.85) & (inside <= 0.95)).all())
        assert coverage["verdict"] == ("PASS" if good else "FAIL")
        assert f"{100.0 * inside.min():.1f} to {100.0 * inside.max():.1f} %" in coverage["figure"]
        for item in (width, score):
            ratio = float(item["figure"].split()[0])
            assert item["verdict"] == ("PASS" if ratio < 1.0 else "FAIL")
    # The same drive twice is the drive once, with twice the starts.
    assert result["starts"] == 2 * alone["starts"]
    assert result["criteria"] == alone["criteria"]
    for name, value in alone[HELD].items():
        np.testing.assert_allclose(result[HELD][name], value)


def test_a_short_drive_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(DataError, match="too short"):
        measure_plans(make_model(), [record(300)])
    assert main(["bench", "plan", "--duration", "5"]) == 2
    assert "choose 30 to 3600 s" in capsys.readouterr().err


@pytest.mark.slow(seconds=60)
def test_on_a_simulated_drive(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "plan", "--duration", "60", "--seed", "1", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["seeds"] == [1]
    assert len(result["criteria"]) == len(JUDGED) * len(KINDS)
    held, planned = (np.array(result[kind]["ratio"]) for kind in (HELD, EXACT))
    # From a second on, knowing the commands halves the errors of v_x and yaw rate at least.
    assert (planned[3:, [0, 2]] < 0.5 * held[3:, [0, 2]]).all()
    other = np.array(result[OTHER]["ratio"])
    # The temporary model is a poor one: what a plan costs by chance is a larger share.
    assert (other < 1.3 * held).all()
