# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk bench real: what has changed between two recordings of a vehicle."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from helpers.calibration import driven, write_streams
from helpers.mismatch import case
from helpers.mismatch_report import identified, result_of

from adk_ros.bench.real import changed_conditions
from adk_ros.bench.real.changed_conditions import ConditionOutcome, ConditionPair, load_pairs
from adk_ros.bench.real.real_bench import CONDITIONS, RealBench, bench_real
from adk_ros.bench.real.scores import criteria
from adk_ros.cli.main import main
from adk_ros.errors import UsageError
from adk_ros.mismatch.inference.result import MismatchResult

PAIRS = """
pairs:
  - {reference: single, recording: double, change: a weight, effects: [payload, cg_shift]}
  - {reference: single, recording: again, change: none}
"""
PAIR = ConditionPair(
    reference="single", recording="double", change="a weight", effects=["payload", "cg_shift"]
)


def vehicle_folder(root: Path, conditions: str = PAIRS) -> Path:
    folder = root / "car"
    for name in ("single", "double", "again"):
        (folder / name).mkdir(parents=True)
    (folder / "conditions.yaml").write_text(conditions)
    return folder


def said(result: MismatchResult, pair: ConditionPair = PAIR) -> ConditionOutcome:
    return changed_conditions.outcome_of("car", pair, result, lambda found: found.verdict)


def test_any_of_the_effects_is_right_and_others_are_false_claims() -> None:
    shifted = identified("cg_shift", 0.04, 0.03, 0.05)
    drag = identified("aero_drag", 0.5, 0.4, 0.6)
    named = said(result_of("", (shifted, drag)))
    assert named.is_named
    assert named.is_alone
    assert named.false_claims == ("aero_drag",)
    assert named.recording == "double, against single"
    tied = said(result_of("", (replace(drag, alternatives=["payload"]),)))
    assert tied.is_named
    assert not tied.is_alone
    assert tied.false_claims == ()
    # The surrogate lacks the calibrations of the reference as well.
    arm = identified("imu_lever_arm", -0.1, -0.12, -0.08)
    assert said(result_of("", (arm,))).false_claims == ()
    nothing = PAIR.model_copy(update={"effects": []})
    assert said(result_of("", (shifted,)), nothing).false_claims == ("cg_shift",)


@pytest.mark.slow
def test_another_steering_ratio_between_two_recordings_is_named() -> None:
    changed = case("steering_ratio", scale=0.85)
    found = changed_conditions.compare(changed.simulation, changed.recording, changed.nominal)
    pair = PAIR.model_copy(update={"effects": ["steering_ratio"]})
    outcome = said(found, pair)
    assert outcome.is_named
    assert outcome.false_claims == ()


def test_criteria_of_changed_conditions() -> None:
    named = said(result_of("", (identified("payload", 3.0, 2.0, 4.0),)))
    missed = said(result_of(""))
    unchanged = said(result_of(""), PAIR.model_copy(update={"effects": []}))

    def verdicts(*conditions: ConditionOutcome) -> list[str]:
        found = criteria(RealBench([], {}, [], conditions=list(conditions)))
        names = "changed conditions named", "other physics named between two recordings"
        return [x.verdict for x in found if x.name in names]

    assert verdicts(named, unchanged) == ["PASS", "PASS"]
    assert verdicts(named, missed) == ["FAIL", "PASS"]
    assert verdicts(unchanged) == ["NONE", "PASS"]
    claimed = replace(unchanged, false_claims=("formula",))
    assert verdicts(named, claimed) == ["PASS", "FAIL"]


def test_the_pairs_of_a_folder_are_read(tmp_path: Path) -> None:
    folder = vehicle_folder(tmp_path)
    first, second = load_pairs(folder)
    assert first == PAIR
    assert second.effects == []
    assert load_pairs(tmp_path) == []


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ("again,", "there is no recording gone in this folder"),
        ("cg_shift", "no effect is called 'gone'"),
    ],
)
def test_what_is_wrong_with_the_pairs_is_said(tmp_path: Path, changed: str, message: str) -> None:
    wrong = PAIRS.replace(changed, "gone," if changed.endswith(",") else "gone")
    folder = vehicle_folder(tmp_path, wrong)
    with pytest.raises(UsageError, match=message):
        load_pairs(folder)


def test_pairs_that_cannot_be_compared_are_listed(tmp_path: Path) -> None:
    folder = tmp_path / "car"
    for name in ("single", "double", "again"):
        write_streams(replace(driven("handling", 1, 12.0), imu=None), folder / name)
    (folder / "conditions.yaml").write_text(PAIRS)
    result = bench_real(tmp_path, {}, None, (CONDITIONS,))
    assert result.refused == ["car: no vehicle.yaml in its folder: no pair is compared"]
    (folder / "vehicle.yaml").write_text("name: car\nmass: 2070.0\nwheelbase: 2.67\n")
    result = bench_real(tmp_path, {}, None, (CONDITIONS,))
    assert len(result.refused) == 2
    assert all(x.startswith("car, changed condition: ") for x in result.refused)
    assert not result.conditions


def test_the_command_prints_each_pair(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "car"
    for name in ("single", "double", "again"):
        write_streams(driven("handling", 1, 40.0), folder / name)
    (folder / "conditions.yaml").write_text(PAIRS)
    (folder / "vehicle.yaml").write_text("name: car\nmass: 2070.0\nwheelbase: 2.67\n")
    payload = identified("payload", 100.0, 90.0, 110.0)
    monkeypatch.setattr(changed_conditions, "compare", lambda *given: result_of("", (payload,)))
    assert main(["bench", "real", "--recordings", str(tmp_path), "--part", "conditions"]) == 0
    printed = capsys.readouterr().out
    assert "car, double, against single: a weight (named): " in printed
    assert "car, again, against single: none (nothing changed): " in printed
    assert "PASS  changed conditions named: 1, at least 0.9" in printed
    assert "FAIL  other physics named between two recordings: 1, 0" in printed
