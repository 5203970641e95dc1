# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Ties that the recording of a case provably has."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from helpers.mismatch import case

from adk_ros.bench.mismatch.case_files import write_case
from adk_ros.bench.mismatch.case_generator import InjectedMismatch, make_case
from adk_ros.bench.mismatch.case_score import score_case
from adk_ros.bench.mismatch.proven_ties import proven_ties, reported_ties
from adk_ros.mismatch.deployment.surrogate_writer import simulation_yaml
from adk_ros.mismatch.simulator import surrogate_of

TIED = {
    "verdict": "explained",
    "effects": [
        {
            "name": "wheel_radius",
            "alternatives": ["drive_torque_gain", "payload"],
            "parameters": {},
            "where": {"kind": "always", "time_intervals_s": [[0.0, 90.0]]},
        }
    ],
}


def label(*names: str, kind: str = "always") -> dict[str, Any]:
    return {
        "effects": [
            {"name": x, "params": {}, "kind": kind, "time_intervals_s": [[0.0, 90.0]]}
            for x in names
        ]
    }


def test_a_tie_is_reported_if_it_contains_the_effect() -> None:
    assert reported_ties(label("drive_torque_gain"), TIED) == ["wheel_radius", "payload"]
    assert reported_ties(label("wheel_radius"), TIED) == ["drive_torque_gain", "payload"]
    assert reported_ties(label("aero_drag"), TIED) == []
    assert reported_ties(label(), TIED) == []
    assert reported_ties(label("payload", kind="time"), TIED) == []
    assert reported_ties(label("payload", "aero_drag"), TIED) == []


def test_a_proven_tie_costs_nothing() -> None:
    given = label("payload")
    assert score_case("case", given, TIED).right == pytest.approx(1.0 / 3.0)
    assert score_case("case", given, TIED, ["wheel_radius"]).right == pytest.approx(0.5)
    proven = score_case("case", given, TIED, ["wheel_radius", "drive_torque_gain"])
    assert proven.right == 1.0
    assert proven.proven == ["wheel_radius", "drive_torque_gain"]


@pytest.mark.slow(seconds=15)
def test_torque_gain_and_wheel_radius_are_tied_and_steering_is_not(tmp_path: Path) -> None:
    gain = case("drive_torque_gain", scale=0.97)
    exact = make_case(
        "exact",
        InjectedMismatch({"drive_torque_gain": {"scale": 0.97}}),
        5,
        seconds=(60.0, 90.0, 30.0),
        noise=0.0,
    )
    write_case(gain, tmp_path / "noisy")
    write_case(exact, tmp_path / "exact")
    surrogate, _ = surrogate_of(gain.simulation, gain.recording, gain.nominal, lambda *_: None)
    report = tmp_path / "report"
    report.mkdir()
    (report / "simulation.yaml").write_text(simulation_yaml(surrogate))
    found = proven_ties(
        gain.label,
        ["wheel_radius", "steering_ratio"],
        tmp_path / "noisy",
        tmp_path / "exact",
        report,
    )
    assert found == ["wheel_radius"]
