# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk fleet mismatch from bags to the page: what all cars lack, and what cannot be used."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from adk_ros.cli.main import main
from adk_ros.fleet.dataset import FleetDataset
from adk_ros.fleet.demo.fleet_folder import write_fleet
from adk_ros.fleet.demo.fleet_plan import FleetSize, InjectedTerm, plan_fleet
from adk_ros.fleet.inference.levels import SHARED, Level

pytestmark = pytest.mark.slow(seconds=120)

CDA = 0.3
"""Drag area that all cars have beyond the simulation, m²."""


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write the bags of a fleet: drag in all cars, a damaged recording and a copy."""
    plan = plan_fleet(31, FleetSize(5, 11, (60.0, 70.0), 150.0, 2, 1, 1))
    drag = InjectedTerm("aero_drag", {"cda": CDA}, Level(SHARED))
    folder = tmp_path_factory.mktemp("fleet") / "fleet"
    write_fleet(replace(plan, terms=(drag,)), folder, workers=2)
    first = next(d.name for d in plan.drives if not d.damage)
    shutil.copytree(folder / "drives" / first, folder / "drives" / "zz" / Path(first).name)
    return folder


def test_bags_become_a_page(fleet, tmp_path, capsys) -> None:
    out = tmp_path / "out"
    given = ["fleet", "mismatch", str(fleet / "drives"), "--simulation", str(fleet / "simulation")]
    given += ["--vehicle", str(fleet / "vehicle.yaml"), "--out", str(out), "--reports", "1"]
    assert main(given) == 0
    said = capsys.readouterr().out
    assert "more drag area (C_dA) (all cars)" in said
    assert "has the content of" in said
    truth = json.loads((fleet / "truth.json").read_text())
    for name in truth["damaged"]:
        assert f"not used: {name}" in said
    report = json.loads((out / "report" / "fleet.json").read_text())
    (claim,) = [c for c in report["claims"] if c["effect"] == "aero_drag"]
    # The drag of the cars differs from the simulation's by their tolerance as well.
    assert claim["size"] == pytest.approx(CDA, rel=0.15)
    assert claim["low"] < claim["size"] < claim["high"]
    page = (out / "report" / "fleet.html").read_text()
    for text in ("What the simulation lacks", "has the content of", "corrected_all.yaml"):
        assert text in page
    assert yaml.safe_load((out / "report" / "corrected_all.yaml").read_text())["terms"]
    assert len(list((out / "report" / "recordings").iterdir())) == 1
    # The same command computes nothing again.
    rows = FleetDataset(out).rows("evidence")
    assert main(given) == 0
    assert FleetDataset(out).rows("evidence") == rows
    capsys.readouterr()
    assert main(["fleet", "compare", str(out), str(out), "--out", str(tmp_path / "both")]) == 0
    assert Path(capsys.readouterr().out.strip()).is_file()


def test_a_further_drive_leaves_most_of_the_evidence_as_it_is(fleet, tmp_path) -> None:
    """Later passes linearise at the estimate, which a further drive moves a little."""
    drives, out = tmp_path / "drives", tmp_path / "out"
    shutil.copytree(fleet / "drives", drives, ignore=shutil.ignore_patterns("zz"))
    last = sorted(path.parent for path in drives.rglob("metadata.yaml"))[-1]
    later = tmp_path / "later"
    shutil.move(last, later)
    given = ["fleet", "mismatch", str(drives), "--simulation", str(fleet / "simulation")]
    given += ["--vehicle", str(fleet / "vehicle.yaml"), "--out", str(out), "--reports", "0"]
    assert main(given) == 0
    before = {(row["recording"], row["key"]) for row in FleetDataset(out).rows("evidence")}
    assert not list(out.glob("point-*.json"))
    shutil.move(later, last)
    assert main(given) == 0
    after = {(row["recording"], row["key"]) for row in FleetDataset(out).rows("evidence")}
    name = last.relative_to(drives).as_posix()
    added = [pair for pair in after - before if pair[0] != name]
    assert {pair[0] for pair in after - before} >= {name}
    assert len(added) < 0.5 * len(before)
