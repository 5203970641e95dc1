# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Baselines: common residuals, naming, and the worker process."""

from __future__ import annotations

import json
import sys
import textwrap
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.mismatch import case

from adk_ros.bench.mismatch.baseline_worker import METHODS
from adk_ros.bench.mismatch.baselines import (
    ADK_MISMATCH,
    MEANS,
    Baselines,
    matches,
    named,
    split_rows,
)
from adk_ros.bench.mismatch.case_score import CaseResult
from adk_ros.bench.mismatch.equation_errors import EquationErrors, equation_errors, slopes
from adk_ros.bench.mismatch.result_tables import baseline_results, baselines_markdown
from adk_ros.errors import UsageError
from adk_ros.mismatch.deployment.surrogate_file import load_surrogate
from adk_ros.mismatch.deployment.surrogate_writer import surrogate_yaml
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.features import FEATURES
from adk_ros.mismatch.surrogate.feature_terms import FeatureTerm
from adk_ros.signals.channels import STATE_NAMES

DRAG = {"effect": "aero_drag", "parameters": {"cda": 1.0}}

# Answers any job with nothing found, but for one method, which predicts one.
FAKE_WORKER = """
import sys
import numpy as np

for line in sys.stdin:
    source, target = line.rstrip("\\n").split("\\t")
    with np.load(source) as job:
        n, k = len(job["later"]), len(job["names"])
        size = float(str(job["method"]) == "GP")
    np.savez(target, predicted=np.full((n, 3), size), coefficients=np.zeros((k, 3)),
             expression=np.array(["", "", ""]))
    print("done", flush=True)
"""


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write the models of a report: the nominal vehicle, and the same with drag."""
    folder = tmp_path_factory.mktemp("report")
    vector = case().nominal.parameters()
    (folder / "simulation.yaml").write_text(surrogate_yaml(vector))
    (folder / "held_out.yaml").write_text(surrogate_yaml(vector, terms=[DRAG]))
    return folder


def test_methods_learn_from_the_part_that_the_tool_trains_on() -> None:
    time_s = np.arange(0.5, 199.5, 0.04)
    learned, tested = split_rows(time_s, 200.0)
    assert time_s[learned].max() < 150.0 < time_s[tested].min()
    # A row is a slope over 0.25 s to either side.
    assert time_s[tested].min() - time_s[learned].max() == pytest.approx(0.52, abs=0.05)


def test_slopes_of_a_line() -> None:
    at = 0.01 * np.arange(200, dtype=np.float64)
    np.testing.assert_allclose(slopes(3.0 * at + 1.0)[30:-30], 3.0, atol=1e-9)
    noisy = np.random.default_rng(0).normal(size=20000)
    assert slopes(noisy)[30:-30].std() == pytest.approx(np.sqrt(12.0 / 51) / 0.51, rel=0.05)


def test_a_term_changes_its_equation_by_its_value(report: Path) -> None:
    recording = case("aero_drag", cda=1.0).recording
    plain, better = (
        equation_errors(recording, load_surrogate(report / name).content)
        for name in ("simulation.yaml", "held_out.yaml")
    )
    speed = plain.features[:, plain.names.index("speed")]
    drag = -0.5 * 1.225 * speed**2 / case().nominal.mass
    taken = plain.residuals - better.residuals
    np.testing.assert_allclose(taken[:, 0], drag, rtol=0.05)
    # The wheel loads feel it, and by them the yaw rate, a little.
    assert np.abs(taken[:, 2]).max() < 0.06
    assert plain.residuals[:, 0].mean() < drag.mean() * 0.9
    assert np.isfinite(plain.features).all()
    assert (plain.noise > 0.0).all()


def test_a_corrected_feature_leaves_no_residual(report: Path) -> None:
    model = load_surrogate(report / "simulation.yaml").content
    text = surrogate_yaml(model.vector(), feature_terms=[
        FeatureTerm("yaw_rate", "constant", 0.5, 0.0)
    ])  # fmt: skip
    (report / "constant.yaml").write_text(text)
    more = load_surrogate(report / "constant.yaml").content
    recording = case().recording
    change = (
        equation_errors(recording, model).residuals - equation_errors(recording, more).residuals
    )
    # The yaw rate is drawn to its measurement, so that other equations feel little of it.
    assert np.median(change[:, 2]) == pytest.approx(0.5, abs=0.15)


def equations() -> EquationErrors:
    n = 400
    features = np.ones((n, len(FEATURES)))
    return EquationErrors(
        np.arange(float(n)), tuple(FEATURES), features, np.zeros((n, 3)), np.ones(3)
    )


def test_coefficients_map_to_effects() -> None:
    names = list(FEATURES)
    coefficients = np.zeros((len(names), 3))
    assert named(equations(), coefficients) == []
    coefficients[names.index("speed_squared"), 0] = 2.0
    coefficients[names.index("torque"), 0] = 0.1
    coefficients[names.index("sine_of_speed"), 2] = 1.0
    groups = named(equations(), coefficients)
    assert groups == [("aero_drag",), ("yaw_rate:sine_of_speed",)]
    assert not matches(groups, {"aero_drag"})
    assert matches(groups[:1], {"aero_drag"})
    assert not matches(groups[:1], {"aero_drag", "payload"})
    assert matches([("rolling_resistance", "torque_offset")], {"torque_offset"})


def test_all_feature_meanings_are_effects() -> None:
    for (equation, feature), effects in MEANS.items():
        assert equation in STATE_NAMES
        assert feature in FEATURES
        assert set(effects) <= set(EFFECTS)


def test_all_methods_get_the_same_data(report: Path, tmp_path: Path) -> None:
    worker = tmp_path / "worker.py"
    worker.write_text(textwrap.dedent(FAKE_WORKER))
    label: dict[str, Any] = {"effects": [{"name": "aero_drag"}]}
    answer = {"verdict": "explained", "effects": [{"name": "aero_drag"}]}
    baselines = Baselines(Path(sys.executable), worker)
    try:
        rows = baselines.compare_baselines(
            case("aero_drag", cda=1.0).recording, report, label, answer
        )
    finally:
        baselines.close()
    assert [row["method"] for row in rows] == [ADK_MISMATCH, *METHODS]
    ours = rows[0]
    assert ours["right"]
    assert ours["telling"] == "v_x"
    assert ours["removed"]["v_x"] > 0.5
    by_method = {row["method"]: row for row in rows}
    assert by_method["pysindy STLSQ"]["abstains"]
    assert not by_method["GP"]["abstains"]
    assert by_method["gplearn"]["removed"]["v_x"] == 0.0
    json.dumps(rows)
    scores = [
        CaseResult("a", "single", 1.0, 1.0, "aero_drag", "aero_drag", baselines=rows),
        CaseResult("b", "none", 1.0, 1.0, "none", "none", baselines=[
            {**row, "right": False, "telling": ""} for row in rows
        ]),
    ]  # fmt: skip
    _, table = baseline_results(scores)
    assert table[0][:3] == [ADK_MISMATCH, "100 % of 1", "0 % of 1"]
    assert table[3][1] == "names no effect"
    assert baselines_markdown(scores).count("\n") == 3 + len(rows) + 2 + 2 * len(rows)
    assert baselines_markdown([replace(scores[0], baselines=[])]) == ""


def test_a_missing_environment_is_reported(report: Path) -> None:
    """The real worker in a Python without the libraries."""
    baselines = Baselines(Path(sys.executable))
    with pytest.raises(UsageError, match="run `make peers`"):
        baselines.compare_baselines(case().recording, report, {"effects": []}, {"verdict": "none"})
