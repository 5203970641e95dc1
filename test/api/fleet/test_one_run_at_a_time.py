# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A verb of several stages holds its output folder from the first to the last of them."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from helpers.fleet_results import filled
from helpers.train import bag

from adk_ros.api.fleet.evidence_stage import EvidenceStage, evidence_text
from adk_ros.api.fleet.fleet_mismatch import fleet_mismatch
from adk_ros.api.fleet.fleet_run import FleetOptions
from adk_ros.api.fleet.fleet_training import train_fleet
from adk_ros.api.fleet.identified_simulation import SimulationInputs
from adk_ros.api.fleet.training_data import FleetTrainingOptions, shard_stage
from adk_ros.bags.recording import RecordingOptions
from adk_ros.errors import DataError
from adk_ros.fleet.inference.evidence import RECORDING
from adk_ros.fleet.recordings import FleetRecording

NO_CLUSTER = FleetOptions(cluster="tcp://nowhere:1")
SECOND = """
import sys
from adk_ros.cli.main import main
sys.exit(main(["fleet", "index", *sys.argv[1:]]))
"""


class Finished(Exception):
    """The part of the verb that is tested has ended."""


def check_a_second_is_refused(drives: Path, out: Path) -> None:
    """Start 'adk fleet index' in a separate process: it ends with exit code 2 and one line."""
    done = subprocess.run(
        [sys.executable, "-c", SECOND, str(drives), "--out", str(out)],
        capture_output=True, text=True, check=False, timeout=60,
    )  # fmt: skip
    assert done.returncode == 2, done.stderr
    (line,) = done.stderr.strip().splitlines()
    assert f"{out} is in use by process {os.getpid()} on" in line


def check_released(out: Path) -> None:
    script = "from adk_ros.fleet.run_lock import run_lock; from pathlib import Path; import sys\n"
    script += "with run_lock(Path(sys.argv[1])): pass"
    subprocess.run([sys.executable, "-c", script, str(out)], check=True, timeout=60)


@pytest.fixture
def drives(tmp_path: Path) -> Path:
    folder = tmp_path / "drives"
    folder.mkdir()
    (folder / "a.mcap").write_bytes(b"no bag")
    return folder


def test_a_simulation_is_identified_by_one_run(
    drives: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, simulation = tmp_path / "out", tmp_path / "simulation"
    simulation.mkdir()
    read = []

    def read_log(path: Path, *others: object, **given: object) -> None:
        read.append(path.name)
        check_a_second_is_refused(drives, out)

    def decoded(recording: FleetRecording, *others: object) -> None:
        read_log(Path(recording.name))
        raise DataError("no odometry")

    module = "adk_ros.api.fleet.identified_simulation"
    monkeypatch.setattr(f"{module}.read_log", read_log)
    monkeypatch.setattr(f"{module}._decoded", decoded)
    with pytest.raises(DataError, match="none of 1 recordings"):
        fleet_mismatch(simulation, [str(drives)], out)
    assert read == ["simulation", "a.mcap"]
    check_released(out)


def test_no_other_run_comes_between_two_stages(
    drives: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, simulation = tmp_path / "out", tmp_path / "simulation"
    simulation.mkdir()
    options = RecordingOptions()
    path = SimulationInputs(simulation, None, False, options, options).file(out)
    path.parent.mkdir()
    path.write_bytes(b"identified")
    stage = EvidenceStage(str(path))
    text = evidence_text({"kind": RECORDING, "recording": "a"})
    monkeypatch.setattr(
        EvidenceStage, "run", lambda *_: [{"finding": "evidence", "details": text}]
    )
    filled(drives, out, stage)
    monkeypatch.setattr(
        "adk_ros.fleet.inference.fleet_simulation.FleetSimulation.load", lambda path: None
    )
    passes = []

    def analyse(evidence_at: object, *others: object) -> None:
        assert callable(evidence_at)
        for _ in range(2):
            rows, _ = evidence_at(None, None)
            passes.append([row["recording"] for row in rows])
            check_a_second_is_refused(drives, out)
        raise Finished

    monkeypatch.setattr("adk_ros.fleet.inference.analysis.analyse_fleet", analyse)
    with pytest.raises(Finished):
        fleet_mismatch(simulation, [str(drives)], out, options=NO_CLUSTER)
    assert passes == [["a.mcap"], ["a.mcap"]]
    check_released(out)


@pytest.mark.slow(seconds=8)
def test_no_other_run_starts_during_a_training(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drives, out = tmp_path / "drives", tmp_path / "out"
    drives.mkdir()
    for number in range(3):
        shutil.copytree(bag("town", 60.0 + 5.0 * number), drives / f"car_{number}")
    filled(drives, out, shard_stage(out, FleetTrainingOptions()))
    trained = []

    def train(*given: object) -> SimpleNamespace:
        check_a_second_is_refused(drives, out)
        trained.append(True)
        raise Finished

    monkeypatch.setattr("adk_ros.train.training_run.train_on_split", train)
    with pytest.raises(Finished):
        train_fleet([str(drives)], out, tmp_path / "model", options=NO_CLUSTER)
    assert trained == [True]
    check_released(out)
