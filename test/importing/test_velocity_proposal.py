# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The proposed source of v_x where no column has it."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from helpers.wheels import bus, driven, table

from adk_ros.api.importing import import_recording, propose_map


@pytest.mark.parametrize("share", [1.0, 0.5])
def test_the_proposal_takes_the_wheels_that_slip_least(tmp_path: Path, share: float) -> None:
    frame = table() if share == 1.0 else bus(driven("town", 90.0, share))
    frame.to_csv(tmp_path / "a.csv", index=False)
    proposal = propose_map(tmp_path / "a.csv")
    loaded = yaml.safe_load(proposal.text)
    expected = {"from": "wheel_speeds", "wheels": "rear", "wheel_radius": "identify"}
    assert loaded["computed"]["v_x"] == expected
    assert "the front wheels turn" in proposal.text
    assert "not found: v_x" not in proposal.text
    assert proposal.as_dict()["computed"]["v_x"]["wheels"] == "rear"
    (tmp_path / "map.yaml").write_text(proposal.text)
    result = import_recording(tmp_path / "a.csv", tmp_path / "map.yaml", tmp_path / "bag")
    assert result.channels.loc["v_x", "table"] == "computed"


def test_the_proposal_without_a_reference_marks_the_radius(tmp_path: Path) -> None:
    table().drop(columns="gps_speed").to_csv(tmp_path / "a.csv", index=False)
    proposal = propose_map(tmp_path / "a.csv")
    assert "v_x" in proposal.uncertain
    assert "# check: wheel radius guessed" in proposal.text


def test_the_proposal_falls_back_to_gps(tmp_path: Path) -> None:
    kept = ["t", "a_x", "a_y", "yaw_rate", "delta", "gps_speed"]
    table()[kept].to_csv(tmp_path / "a.csv", index=False)
    loaded = yaml.safe_load(propose_map(tmp_path / "a.csv").text)
    assert loaded["computed"] == {"v_x": {"from": "gps"}}
