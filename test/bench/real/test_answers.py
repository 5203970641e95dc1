# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What `adk bench real --part answers` says of recordings of much, of little and of no use."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers.calibration import driven, existing, write_streams

from adk_ros.api.info import read_bag
from adk_ros.bags.recording import RecordingOptions
from adk_ros.bench.real import answers as answers_module
from adk_ros.bench.real.answers import CHECK, INFO, MISMATCH, Answer, answers
from adk_ros.bench.real.real_bench import ANSWERS, RealBench, bench_real
from adk_ros.bench.real.scores import criteria
from adk_ros.calibration.streams import Streams
from adk_ros.cli.main import main
from adk_ros.errors import DataError


def by_command(path: Path, vehicle_file: Path | None = None) -> dict[str, Answer]:
    return {x.command: x for x in answers("car", path, vehicle_file)}


def written(folder: Path, streams: Streams) -> Path:
    path = folder / "car" / "drive"
    write_streams(streams, path)
    return path


def parked(streams: Streams) -> Streams:
    """Return a recording of a car that does not move."""
    odometry = existing(streams, "odometry")
    zeros = np.zeros(odometry.at_s.size)
    return replace(
        streams,
        imu=None,
        odometry=odometry.having(**{name: zeros for name in odometry.columns}),
    )


def test_a_recording_without_a_command_is_answered(tmp_path: Path) -> None:
    path = written(tmp_path, replace(driven("handling", 1, 80.0), command=None))
    found = by_command(path)
    assert list(found) == [INFO, CHECK]
    assert not any(x.is_refused for x in found.values())
    assert (found[CHECK].moving_s or 0.0) > 20.0
    assert " ok, " in found[CHECK].text


@pytest.mark.parametrize(
    "make", [parked, lambda s: replace(driven("handling", 1, 11.0), imu=None)]
)
def test_what_is_too_short_or_parked_may_be_refused(tmp_path: Path, make: Any) -> None:
    path = written(tmp_path, make(driven("handling", 1, 80.0)))
    found = by_command(path)
    assert all(x.may_be_refused for x in found.values())
    assert not found[CHECK].is_refused


def test_a_file_that_is_no_recording_is_refused_in_a_line(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    path.write_bytes(b"nothing")
    for answer in by_command(path).values():
        assert answer.is_refused
        assert not answer.may_be_refused
        assert answer.text
        assert "\n" not in answer.text


def test_what_the_check_refuses_is_not_excused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = written(tmp_path, replace(driven("handling", 1, 80.0), imu=None))

    def refuse(*_: Any, **__: Any) -> Any:
        raise DataError("it cannot be checked")

    monkeypatch.setattr(answers_module, "check_recording", refuse)
    found = by_command(path)
    assert found[CHECK].is_refused
    assert not found[CHECK].may_be_refused
    assert not found[INFO].is_refused
    (criterion,) = [
        x for x in criteria(RealBench([], {}, [], answers=list(found.values()))) if x.cases
    ]
    assert (criterion.figure, criterion.verdict) == (1.0, "FAIL")


def test_info_says_what_training_refuses(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = written(tmp_path, replace(driven("handling", 1, 80.0), imu=None))
    refused = read_bag(path)._replace(refusal="nothing to learn")
    monkeypatch.setattr(answers_module, "read_bag", lambda path: refused)
    said = by_command(path)[INFO].text
    assert said == "not usable for training or replay: nothing to learn"


def test_it_is_compared_with_the_vehicle_file_as_checked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fault(streams: Streams) -> Streams:
        command = existing(streams, "command")
        return replace(streams, command=command.having(steering=command["steering"] + 0.02))

    path = written(tmp_path, fault(driven("handling", 1, 80.0)))
    file = tmp_path / "car" / "vehicle.yaml"
    file.write_text("mass: 2070.0\nwheelbase: 2.9\n")
    seen: list[RecordingOptions] = []

    def explain(simulation: Path, recording: Path, **given: Any) -> Any:
        assert (simulation, recording) == (file, path)
        assert given["without_imu"]
        seen.append(given["options"])
        return SimpleNamespace(verdict="none", summary="No significant mismatch.")

    monkeypatch.setattr(answers_module, "explain", explain)
    found = by_command(path, file)
    assert found[MISMATCH].text == "none: No significant mismatch."
    assert seen[0].sensors.steering_offset == pytest.approx(0.02, abs=0.002)

    def refuse(*_: Any, **__: Any) -> Any:
        raise DataError("it cannot be compared")

    monkeypatch.setattr(answers_module, "explain", refuse)
    refused = by_command(path, file)[MISMATCH]
    assert refused.is_refused
    assert refused.text == "it cannot be compared"
    assert not refused.may_be_refused
    (criterion,) = [x for x in criteria(RealBench([], {}, [], answers=[refused])) if x.cases]
    assert (criterion.figure, criterion.verdict) == (1.0, "FAIL")


def test_the_benchmark_prints_them(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    written(tmp_path, replace(driven("handling", 1, 80.0), imu=None))
    result = bench_real(tmp_path, {}, selected=(ANSWERS,))
    assert [x.command for x in result.answers] == [INFO, CHECK]
    out = tmp_path / "answers.jsonl"
    command = ["bench", "real", "--recordings", str(tmp_path), "--part", ANSWERS]
    assert main([*command, "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "car, drive, check: " in said
    assert "PASS  refusals of recordings that are long enough: 0, 0" in said
    assert len([json.loads(line) for line in out.read_text().splitlines()]) == 2
