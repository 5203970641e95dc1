# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Acceptance criteria, result tables, and interruption and resumption of a run."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from adk_ros.bench.mismatch import mismatch_bench
from adk_ros.bench.mismatch.acceptance import FAIL, NONE, PASS, Criterion, evaluate_criteria
from adk_ros.bench.mismatch.breakdown import breakdown
from adk_ros.bench.mismatch.case_jobs import CaseJob, jobs_of
from adk_ros.bench.mismatch.case_matrix import case_plans
from adk_ros.bench.mismatch.case_score import CaseResult
from adk_ros.bench.mismatch.mismatch_bench import MismatchBench
from adk_ros.bench.mismatch.reliability import ScoredClaim
from adk_ros.bench.mismatch.result_tables import write_tables
from adk_ros.bench.mismatch.subprocesses import ProcessResult, SubprocessEnded, Subprocesses
from adk_ros.bench.mismatch.unlisted_labels import DISTANCE, TIME, UNLISTED_IN
from adk_ros.bench.vehicles.multibody import MULTI_BODY
from adk_ros.errors import UsageError
from adk_ros.mismatch.library.features import FEATURES
from adk_ros.mismatch.surrogate.feature_terms import EQUATION_PARAMETERS
from adk_ros.plant.injection.injectors import UNLISTED
from adk_ros.plant.scenario.random_routes import AlwaysSpins


def good(kind: str = "single", **changes: Any) -> CaseResult:
    """Return a case without any error."""
    plain = CaseResult(
        "a",
        kind,
        1.0,
        1.0,
        "aero_drag",
        "aero_drag",
        {"aero_drag.cda": 0.01},
        {"aero_drag.cda": True},
        {},
        {"v_x": 0.95},
        30.0,
        29.0,
        400.0,
        raised=0.0,
        claims=[ScoredClaim("aero_drag", 0.97, True)],
    )
    return replace(plain, **changes)


def criteria(*scores: CaseResult) -> dict[str, Criterion]:
    return {criterion.name: criterion for criterion in evaluate_criteria(scores)}


def test_breakdown() -> None:
    """What the averages of the criteria hide is one sentence each."""
    tie = ScoredClaim("torque_offset|rolling_resistance", 0.95, True)
    false = ScoredClaim("headwind", 0.98, False)
    lines = breakdown(
        [
            good(),
            good(reported=tie.effect, label="rolling_resistance", claims=[tie]),
            good("none", reported="headwind", label="none", right=0.0, claims=[false], errors={}),
            good(plant=MULTI_BODY, covered={"a": False}, errors={"a": 0.3}, raised=0.015),
            good(strength=0.3, right=0.5, plant="spring_car", claims=[]),
            good("unknown", correctable=False),
            good("unknown", right=0.0, case="gusts", reported="none"),
        ]
    )
    assert lines == [
        "Nothing reported where something is injected: 1 of 5 (gusts); at strength 0.1 0 of 0.",
        "Claims with a confidence of at least 0.9: 6, wrong 1 (headwind in a); ties 1, right 1, "
        "with the injected effect first 0.",
        "90 % intervals, multi-body model: 0 of 1 hold, median error 30.00 %.",
        "90 % intervals, other simulators: 6 of 6 hold, median error 1.00 %.",
        "Parameter errors: 90th percentile 15.5 %, largest 30 %.",
        "Corrections: 1 in 7 cases; with an error that rises at the first stated horizon 1, by at "
        "most 1.5 %.",
        "Single effects at strength 0.3: 0.5 of 1 right, in simulators of another family 0.5 of "
        "1.",
        "Single effects at strength 0.1: 0.0 of 0 right, in simulators of another family 0.0 of "
        "0.",
        "Right single effects at strength 1: 2, 1 named alone and 1 in ties.",
        "Unlisted effects without those of sensors: 0 of 1 right.",
    ]


def test_a_criterion_without_cases_is_none() -> None:
    for criterion in evaluate_criteria([]):
        assert criterion.verdict == NONE
        assert str(criterion).startswith(f"NONE {criterion.name} no case ran (")
    found = criteria(good())
    assert found["false-alarms"].verdict == NONE
    assert found["singles-strength-0.3"].verdict == NONE
    assert found["where-iou"].verdict == NONE
    assert found["interval-coverage"].verdict == NONE


@pytest.mark.parametrize(
    ("name", "passing", "failing"),
    [
        ("singles-strength-1", good(), good(right=0.0)),
        ("singles-strength-0.3", good(strength=0.3), good(strength=0.3, right=0.5)),
        ("singles-strength-0.1", good(strength=0.1), good(strength=0.1, right=0.5)),
        ("pairs-set-f1", good("pair", f1=0.95, right=0.0), good("pair", f1=0.94)),
        ("triples-set-f1", good("triple", f1=0.88), good("triple", f1=0.87)),
        ("unlisted-unknown", good("unknown", described=True), good("unknown", right=0.0)),
        ("error-raised", good(raised=0.02), good(raised=0.021)),
        ("confident-claims-right", good(), good(claims=[ScoredClaim("payload", 0.9, False)])),
        (
            "other-family-simulators",
            good(plant="fourteen_dof"),
            good(plant="fourteen_dof", right=0.0),
        ),
        ("parameter-error", good(), good(errors={"a.b": 0.016})),
        (
            "interval-coverage",
            good(covered={str(i): i > 3 for i in range(40)}),
            good(covered={str(i): True for i in range(40)}),
        ),
        ("where-iou", good(iou={"a": 0.9}), good(iou={"a": 0.89})),
        ("held-out-error-removed", good(), good(removed={"v_x": 0.94})),
        ("seconds-a-case", good(), good(seconds=46.0)),
        ("memory-a-case", good(), good(memory_mib=1025.0)),
    ],
)
def test_each_criterion_passes_and_fails(
    name: str, passing: CaseResult, failing: CaseResult
) -> None:
    assert criteria(passing)[name].verdict == PASS
    assert criteria(failing)[name].verdict == FAIL


def test_a_criterion_is_one_line_with_its_figure() -> None:
    both = criteria(good(), good(right=0.5))
    assert str(both["singles-strength-1"]) == (
        "FAIL singles-strength-1 0.750 of 2 cases (at least 0.97)"
    )
    assert both["false-alarms"].figure == "no case ran"


@pytest.mark.parametrize(
    ("name", "count", "case"),
    [
        ("false-alarms", 100, {"kind": "none"}),
        ("multi-body-singles", 20, {"kind": "single", "plant": "multi_body"}),
    ],
)
def test_few_cases_can_fail_a_criterion_but_not_pass_it(
    name: str, count: int, case: dict[str, Any]
) -> None:
    assert criteria(*[good(**case)] * count)[name].verdict == PASS
    few = criteria(*[good(**case)] * (count - 1))[name]
    assert few.verdict == NONE
    assert f"at least {count} are needed" in few.figure
    assert criteria(good(**case), *[good(**case, right=0.0)] * 3)[name].verdict == FAIL


def test_effects_below_their_detectable_size_are_left_out() -> None:
    weak: dict[str, Any] = {"strength": 0.1}
    criterion = criteria(good(**weak), good(**weak, right=0.0, detectable=False))[
        "singles-strength-0.1"
    ]
    assert criterion.verdict == PASS
    assert "1 below their detectable size" in criterion.figure
    assert (
        criteria(good(**weak, right=0.0, detectable=True))["singles-strength-0.1"].verdict == FAIL
    )


def test_the_multi_body_model_has_a_criterion_of_its_own() -> None:
    found = criteria(good(plant="multi_body", right=0.0))
    assert found["singles-strength-1"].verdict == NONE
    assert found["other-family-simulators"].verdict == NONE
    assert found["multi-body-singles"].verdict == FAIL


def test_weak_and_clean_cases_do_not_count_for_other_families() -> None:
    other = {"plant": "fourteen_dof"}
    found = criteria(good("none", **other), good(strength=0.3, right=0.0, **other))
    assert found["other-family-simulators"].verdict == NONE


def test_sensor_faults_are_not_correctable() -> None:
    found = criteria(good(removed={"v_x": 0.0}, correctable=False))
    assert found["held-out-error-removed"].verdict == NONE


def test_tables_list_all_cases(tmp_path: Path) -> None:
    scores = [good(case="first"), good(case="second", reported="a|b")]
    (tmp_path / "bars.txt").write_text("of 0.1.0\n")
    write_tables(scores, evaluate_criteria(scores), tmp_path)
    assert not (tmp_path / "bars.txt").exists()
    content = json.loads((tmp_path / "cases.json").read_text())
    assert [case["case"] for case in content["cases"]] == ["first", "second"]
    assert content["cases"][1]["said"] == "a|b"
    table = (tmp_path / "cases.md").read_text().splitlines()
    assert len(table) == 4
    assert "a\\|b" in table[3]
    lines = (tmp_path / "criteria.txt").read_text().splitlines()
    assert len(lines) == len(content["criteria"])
    assert content["cases"][0]["claims"][0]["confidence"] == 0.97
    assert content["reliability"]["bins"][-1]["claims"] == 2
    assert (tmp_path / "reliability.png").stat().st_size > 10_000
    assert "| 0.9 to 1 | 2 | 0.97 | 1.00 |" in (tmp_path / "reliability.md").read_text()
    assert lines[0].startswith("PASS singles-strength-1 1.000 of 2 cases")


def test_generated_cases_carry_strength_and_plant() -> None:
    every = list(case_plans())
    assert len({plan.name for plan in every}) == len(every)
    assert {plan.strength for plan in every} == {1.0, 0.3, 0.1}
    weak = next(plan for plan in every if plan.name == "aero_drag_0.3")
    label = weak.labelled({"effects": []})
    assert (label["strength"], label["plant"]) == (0.3, weak.plant)
    for equations, features in UNLISTED_IN.values():
        assert set(equations) <= set(EQUATION_PARAMETERS)
        assert set(features) <= {*FEATURES, TIME, DISTANCE}
    odd = next(plan for plan in every if plan.injected.unlisted)
    (effect,) = odd.labelled({"effects": [{"name": "unknown", "params": {}}]})["effects"]
    assert effect["equations"]
    assert set(UNLISTED) <= set(UNLISTED_IN)


class Fake:
    """Replace the tool: right answers, except for the cases to stop at."""

    def __init__(self, stop_at: str = "") -> None:
        self.stop_at = stop_at
        self.ran: list[str] = []

    def __call__(self, case: Path, out: Path, *_: object) -> CaseResult:
        self.ran.append(case.name)
        if case.name == self.stop_at:
            raise KeyboardInterrupt
        out.mkdir()
        (out / "mismatch.json").write_text("{}")
        return good(case=case.name)


def jobs(tmp_path: Path) -> list[CaseJob]:
    for name in ("a", "b", "c"):
        case = tmp_path / "cases" / name
        case.mkdir(parents=True, exist_ok=True)
        (case / "label.json").write_text('{"effects": []}')
    return jobs_of(tmp_path / "cases")


def test_an_interrupted_run_keeps_complete_reports_and_resumes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, todo = tmp_path / "out", jobs(tmp_path)
    monkeypatch.setattr(mismatch_bench, "run_case", Fake("b"))
    with pytest.raises(KeyboardInterrupt):
        MismatchBench(out).run(todo)
    assert {p.name for p in out.iterdir()} <= {"a", "c"}
    assert (out / "a" / "score.json").is_file()
    again = Fake()
    monkeypatch.setattr(mismatch_bench, "run_case", again)
    scores = MismatchBench(out, 2, resume=True).run(todo)
    assert [s.case for s in scores] == ["a", "b", "c"]
    assert "a" not in again.ran
    assert {p.name for p in out.iterdir()} == {"a", "b", "c"}
    assert scores[0].claims == good().claims


def test_a_changed_case_is_run_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out, todo = tmp_path / "out", jobs(tmp_path)
    monkeypatch.setattr(mismatch_bench, "run_case", Fake())
    MismatchBench(out).run(todo)
    (tmp_path / "cases" / "b" / "label.json").write_text('{"effects": [ ]}')
    again = Fake()
    monkeypatch.setattr(mismatch_bench, "run_case", again)
    MismatchBench(out, resume=True).run(jobs_of(tmp_path / "cases"))
    assert again.ran == ["b"]


def test_baselines_are_added_to_finished_cases(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class FakeBaselines:
        asked = 0

        def compare_baselines(self, *arguments: Any) -> list[dict[str, Any]]:
            self.asked += 1
            return [{"method": "other"}]

        def close(self) -> None:
            pass

    out, todo = tmp_path / "out", jobs(tmp_path)
    monkeypatch.setattr(mismatch_bench, "run_case", Fake())
    monkeypatch.setattr(mismatch_bench, "read_sensor_log", lambda *_, **__: None)
    MismatchBench(out).run(todo)
    for name in ("a", "b", "c"):
        (out / name / "mismatch.json").write_text("{}")
    again, others = Fake(), FakeBaselines()
    monkeypatch.setattr(mismatch_bench, "run_case", again)
    for _ in range(2):
        bench = MismatchBench(out, resume=True, baselines=others)  # type: ignore[arg-type]
        scores = bench.run(todo)
    assert again.ran == []
    assert others.asked == 3
    assert [s.baselines for s in scores] == [[{"method": "other"}]] * 3


def test_an_interrupted_first_case_leaves_no_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mismatch_bench, "run_case", Fake("a"))
    with pytest.raises(KeyboardInterrupt):
        MismatchBench(tmp_path / "out").run(jobs(tmp_path)[:1])
    assert not (tmp_path / "out").exists()


def test_a_case_that_cannot_be_generated_is_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def spin(folder: Path) -> Path:
        raise AlwaysSpins("b: the car spins")

    first, second, third = jobs(tmp_path)
    monkeypatch.setattr(mismatch_bench, "run_case", Fake())
    bench = MismatchBench(tmp_path / "out")
    shares = []
    scores = bench.run(
        [first, second._replace(write=spin), third], lambda done, total, _: shares.append(done)
    )
    assert [s.case for s in scores] == ["a", "c"]
    assert bench.left_out == ["b: the car spins"]
    assert shares[-1] == 3


def test_a_foreign_folder_is_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "out" / "b").mkdir(parents=True)
    with pytest.raises(UsageError, match="not a report of this command"):
        MismatchBench(tmp_path / "out").run(jobs(tmp_path))


def test_weak_effects_are_compared_with_their_detectable_size(tmp_path: Path) -> None:
    class Tool(Subprocesses):
        """Answer both commands: nothing named, and a table of sizes."""

        def adk(
            self, arguments: Sequence[str], factors: Mapping[str, float] | None = None
        ) -> ProcessResult:
            out = Path(arguments[arguments.index("--out") + 1])
            if arguments[0] == "mismatch":
                out.mkdir()
                (out / "mismatch.json").write_text('{"verdict": "none", "effects": []}')
            else:
                assert arguments[arguments.index("--minutes") + 1] == "2.000"
                out.write_text("effect,parameter,minutes,size\naero_drag,cda,2,0.2\n")
            return ProcessResult(0, "", 1.0, 1.0, 100.0)

    effect = {
        "name": "aero_drag", "params": {"cda": 0.1}, "kind": "always",
        "time_intervals_s": [[0.0, 120.0]],
    }  # fmt: skip
    for strength, expected in ((0.1, False), (0.3, None)):
        case = tmp_path / f"case_{strength}"
        case.mkdir()
        content = {"effects": [effect], "strength": strength}
        (case / "label.json").write_text(json.dumps(content))
        result = mismatch_bench.run_case(case, case / "report", Tool())
        assert result.detectable is expected


def test_no_process_starts_after_the_end() -> None:
    children = Subprocesses()
    said = children.adk(["--version"])
    assert said.status == 0
    assert said.cpu_s > 0.0
    children.end()
    with pytest.raises(SubprocessEnded):
        children.adk(["--version"])
