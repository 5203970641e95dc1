# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk bench real on simulated recordings: injection, scores, table, refusals."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.calibration import driven, write_streams

from adk_ros.bench.real.fault_cases import (
    CONFIRMATION,
    DEVELOPMENT,
    pairings,
    part,
    recordings_by_vehicle,
)
from adk_ros.bench.real.injected_faults import INJECTIONS
from adk_ros.bench.real.outcome import score, scores_by
from adk_ros.bench.real.real_bench import (
    FAULTS,
    OTHER_COURSE,
    SLOPES,
    FaultOutcome,
    RealBench,
    bench_real,
)
from adk_ros.bench.real.scores import criteria
from adk_ros.calibration.faults import FAULTS as KNOWN_FAULTS
from adk_ros.calibration.streams import Streams
from adk_ros.cli.main import main
from adk_ros.errors import UsageError
from adk_ros.numerics.constants import GRAVITY


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with one vehicle of one recording of odometry and command."""
    folder = tmp_path_factory.mktemp("recordings")
    write_streams(replace(driven("handling", 1, 80.0), imu=None), folder / "car" / "drive")
    return folder


def changed(label: str, size: float) -> tuple[Streams, Streams]:
    streams = driven()
    return streams, INJECTIONS[label](streams, size)


def test_every_fault_has_an_injection_and_sizes_of_both_kinds() -> None:
    labels = {fault.label for fault in KNOWN_FAULTS} - {"steering_delay"}
    assert labels == set(INJECTIONS) == set(DEVELOPMENT) == set(CONFIRMATION)
    for label in labels:
        assert not {*DEVELOPMENT[label]} & {*CONFIRMATION[label]}
        material = next(x.material for x in KNOWN_FAULTS if x.label == label)
        nominal = next(x.nominal for x in KNOWN_FAULTS if x.label == label)
        sizes = (*DEVELOPMENT[label], *CONFIRMATION[label])
        if "lever_arm" not in label:
            assert all(abs(size - nominal) > material for size in sizes)


def test_a_tilt_turns_gravity_and_the_yaw_rate() -> None:
    old, new = (x.imu for x in changed("imu_tilt.roll", 0.1))
    assert old is not None
    assert new is not None
    assert np.mean(new["a_y"] - old["a_y"]) == pytest.approx(GRAVITY * np.sin(0.1), rel=0.05)
    assert np.ptp(new["a_x"] - old["a_x"]) == 0.0
    slope = np.polyfit(old["w_z"], new["w_y"], 1)[0]
    assert slope == pytest.approx(np.sin(0.1), rel=0.02)


def test_a_clock_offset_and_a_delay_move_stamps_only() -> None:
    old, new = (x.command for x in changed("clock_offset", 0.2))
    assert old is not None
    assert new is not None
    assert np.allclose(old.at_s - new.at_s, 0.2)
    assert new.columns == old.columns


def test_a_low_pass_has_its_time_constant() -> None:
    streams = driven()
    assert streams.odometry is not None
    n = streams.odometry.at_s.size
    at = 0.02 * np.arange(n, dtype=np.float64)
    sine = replace(streams.odometry.having(yaw_rate=np.sin(at)), at_s=at)
    filtered = INJECTIONS["odometry_filter"](streams.with_stream("odometry", sine), 0.5).odometry
    assert filtered is not None
    expected = np.sin(at - np.arctan(0.5)) / np.sqrt(1.25)
    assert np.abs(filtered["yaw_rate"] - expected)[500:].max() < 1e-4


def test_halves_and_pairs_of_each_vehicle(recordings: Path) -> None:
    found = recordings_by_vehicle(recordings)
    assert list(found) == ["car"]
    refused: list[str] = []
    (halves,) = pairings(found, refused)
    assert halves.kind == "halves"
    assert not refused
    first, second = halves.reference.streams.odometry, halves.tested.streams.odometry
    assert first is not None
    assert second is not None
    assert first.at_s[-1] < second.at_s[0]
    assert part(halves.tested, 0.0, 1.0).streams.odometry is not None


def test_a_fault_is_injected_and_scored(recordings: Path) -> None:
    steps: list[tuple[int, int]] = []
    sizes = {"odometry_scale": (1.05,), "imu_delay": (0.1,)}
    result = bench_real(
        recordings, sizes, lambda done, total: steps.append((done, total)), (FAULTS,)
    )
    untouched, injected = result.outcomes
    assert untouched.fault == ""
    assert untouched.false_claims == ()
    assert injected.fault == "odometry_scale"
    assert injected.is_named
    assert injected.error is not None
    assert injected.error < 0.1
    assert result.left_out == {"car, drive": ["imu_delay"]}
    assert steps == [(1, 1)]


def outcome(**changes: object) -> FaultOutcome:
    default = FaultOutcome(
        vehicle="car",
        recording="drive",
        kind="halves",
        fault="gyro_scale",
        size=1.1,
        is_named=True,
        is_alone=True,
        estimate=1.11,
        low=1.0,
        high=1.2,
        error=0.1,
        is_inside=True,
        said="",
    )
    return replace(default, **changes)  # type: ignore[arg-type]


def test_scores_and_criteria() -> None:
    missed = outcome(is_named=False, error=None, is_inside=False, said="not decidable")
    clean = outcome(fault="", is_named=False, error=None)
    elsewhere = replace(missed, kind=OTHER_COURSE)
    nine = [outcome(error=0.02 * k) for k in range(9)]
    total = score("all", [*nine, missed])
    assert (total.named, total.median_error, total.left_open) == pytest.approx((0.9, 0.08, 0.1))
    result = RealBench([*nine, missed, elsewhere, clean], {}, [])
    assert [x.verdict for x in criteria(result)] == ["PASS"] * 3 + ["NONE"] * 10
    assert [x.group for x in scores_by(result.outcomes, lambda x: x.kind)] == [
        "halves",
        OTHER_COURSE,
    ]
    claimed = RealBench([replace(clean, false_claims=("imu_delay",))], {}, [])
    assert not any(x.is_met for x in criteria(claimed))


def test_the_table_and_the_files(
    recordings: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    sizes = {"odometry_scale": (1.05,)}
    monkeypatch.setattr("adk_ros.bench.real.fault_cases.CONFIRMATION", sizes)
    out = tmp_path / "out.jsonl"
    arguments = ["bench", "real", "--recordings", str(recordings), "--part", "faults"]
    assert main([*arguments, "--out", str(out)]) == 0
    text = capsys.readouterr().out
    assert "odometry_scale" in text
    assert "PASS  faults named: 1, at least 0.9" in text
    assert "car, drive: nothing changed" in text
    assert len(out.read_text().splitlines()) == 2
    assert main([*arguments, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["criteria"][0]["is_met"] is True


def test_folders_of_the_same_name_are_different_vehicles(tmp_path: Path) -> None:
    for folder in ("a/run/one", "b/run/two", "three"):
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder / "metadata.yaml").touch()
    assert list(recordings_by_vehicle(tmp_path)) == ["a/run", "b/run", tmp_path.name]


def test_a_recording_that_cannot_be_read_is_listed(tmp_path: Path) -> None:
    (tmp_path / "car" / "one").mkdir(parents=True)
    (tmp_path / "car" / "one" / "metadata.yaml").write_text("nothing")
    (line,) = bench_real(tmp_path, {}, None, (SLOPES,)).refused
    assert line.startswith("car, one, withheld attitude: ")


def test_folders_without_recordings_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no such folder"):
        recordings_by_vehicle(tmp_path / "absent")
    with pytest.raises(UsageError, match="has no rosbag2 folder"):
        recordings_by_vehicle(tmp_path)
