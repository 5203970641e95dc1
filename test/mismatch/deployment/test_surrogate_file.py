# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The surrogate's YAML file: what it keeps, and files of the last release."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from helpers.mismatch import car, steady

from adk_ros.errors import UsageError
from adk_ros.mismatch import inputs
from adk_ros.mismatch.deployment.simulator_input import load_simulator
from adk_ros.mismatch.deployment.surrogate_file import is_surrogate_file, load_surrogate
from adk_ros.mismatch.deployment.surrogate_writer import simulation_yaml, surrogate_yaml
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.whitening import prediction_error_filters
from adk_ros.mismatch.library.criteria import SURROGATE_ERROR_CLIP
from adk_ros.mismatch.library.surrogate_parameters import INDEX, SIZE
from adk_ros.mismatch.surrogate.error_autocovariance import (
    MAX_LAG,
    ErrorAutocovariance,
    autocovariance,
)
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.mismatch.surrogate.residuals import prepare_residual_problem
from adk_ros.numerics.arrays import FloatArray

SCHEMA_1 = Path(__file__).parent / "data" / "surrogate_schema_1.yaml"
NOISE = np.array([0.02, 0.02, 1e-3, 0.01, 0.01, 1e-3])
NO_PASSED_NOISE = np.zeros((6, MAX_LAG + 1))


def coloured(scale: float, bins: int = 4000) -> FloatArray:
    """First-order coloured residuals (6, bins) with a standard deviation of `scale` noises."""
    rng = np.random.default_rng(2)
    out = np.empty((6, bins))
    state = np.zeros(6)
    for k in range(bins):
        state = 0.9 * state + np.sqrt(1.0 - 0.81) * rng.standard_normal(6)
        out[:, k] = scale * NOISE * state
    return out


def surrogate(scale: float = 0.5) -> SurrogateModel:
    residuals = coloured(scale)
    weak = np.zeros((2, SIZE))
    weak[0, INDEX["shape_f"]], weak[0, INDEX["curvature_f"]] = 0.08, -0.3
    weak[1, INDEX["load_lag"]] = 0.04
    error = np.sqrt(np.mean(residuals**2, axis=1))
    return SurrogateModel(car(drag_area=0.61234567), error, residuals, weak)


def reloaded(model: SurrogateModel, folder: Path) -> SurrogateModel:
    file = folder / "simulation.yaml"
    file.write_text(simulation_yaml(model))
    loaded = load_simulator(file)
    assert isinstance(loaded, SurrogateModel)
    return loaded


def test_reloaded_surrogate_has_the_same_likelihood(tmp_path: Path) -> None:
    """As confident as from its own bag: filters, nuisance parameters, surrogate error."""
    problem = prepare_residual_problem(steady(20.0), NOISE)
    before = Likelihood.of(problem, surrogate())
    after = Likelihood.of(problem, reloaded(surrogate(), tmp_path))
    np.testing.assert_allclose(after.filters, before.filters, rtol=1e-5, atol=1e-8)
    np.testing.assert_allclose(after.surrogate_error_share, before.surrogate_error_share, 1e-6)
    np.testing.assert_allclose(after.weak_directions, before.weak_directions, rtol=1e-7)
    np.testing.assert_allclose(after.parameters, before.parameters, rtol=1e-7)
    assert after.n_nuisances == before.n_nuisances
    assert after.surrogate_error_dof() > 100.0


def test_reloaded_surrogate_keeps_its_error(tmp_path: Path) -> None:
    loaded = reloaded(surrogate(), tmp_path)
    np.testing.assert_allclose(loaded.error, surrogate().error, rtol=1e-7)
    again = reloaded(loaded, tmp_path)
    assert again.autocovariance is not None
    assert loaded.autocovariance is not None
    np.testing.assert_array_equal(again.autocovariance.values, loaded.autocovariance.values)


@pytest.mark.parametrize("scale", [2.0, 8.0, 40.0])
def test_clipped_error_is_close_between_the_tabulated_limits(tmp_path: Path, scale: float) -> None:
    model = surrogate(scale)
    filters, shares, _ = prediction_error_filters(model, NOISE, NO_PASSED_NOISE)
    same_filters, same_shares, _ = prediction_error_filters(
        reloaded(model, tmp_path), NOISE, NO_PASSED_NOISE
    )
    np.testing.assert_allclose(same_shares, shares, rtol=0.03)
    np.testing.assert_allclose(same_filters[:, 0], filters[:, 0], rtol=0.03)


def test_noise_of_the_simulation_is_no_error_of_the_surrogate() -> None:
    """An error that lasts for several bins is; white residuals are the simulation's sensors."""
    rng = np.random.default_rng(5)
    smooth = np.cumsum(rng.standard_normal((6, 4000)), axis=1)
    smooth = np.array([np.convolve(row, np.ones(25) / 25.0, mode="same") for row in smooth])
    smooth *= NOISE[:, None] / smooth.std(axis=1, keepdims=True)
    white = NOISE[:, None] * rng.standard_normal((6, 4000))
    both = {}
    for name, residuals in (("smooth", smooth), ("white", white)):
        model = replace(surrogate(), residuals=residuals, systematic=None, autocovariance=None)
        both[name] = prediction_error_filters(model, NOISE, NO_PASSED_NOISE)[1:]
    shares, without_noise = both["smooth"]
    np.testing.assert_allclose(without_noise, shares, rtol=0.05)
    shares, without_noise = both["white"]
    assert (shares > 0.4).all()
    assert (without_noise < 0.1).all()


def test_autocovariance_is_exact_at_the_limits() -> None:
    residuals = coloured(1.0)
    table = ErrorAutocovariance.of(residuals)
    centred = residuals[3] - residuals[3].mean()
    for limit in table.limits[3]:
        expected = autocovariance(np.clip(centred, -limit, limit))
        np.testing.assert_allclose(table.clipped_at(3, float(limit)), expected, rtol=1e-9)
    far = table.clipped_at(3, 100.0 * SURROGATE_ERROR_CLIP)
    np.testing.assert_allclose(far, autocovariance(centred), rtol=1e-12)
    assert far.shape == (MAX_LAG + 1,)


def test_files_of_schema_1_load() -> None:
    assert is_surrogate_file(SCHEMA_1)
    content = yaml.safe_load(SCHEMA_1.read_text())
    model = load_surrogate(SCHEMA_1).content
    assert model.kind == "surrogate"
    assert model.parameters == content["parameters"]
    assert [term.effect for term in model.terms] == ["aero_drag"]
    assert model.identification is None
    assert not model.surrogate().error.any()


def test_old_keys_of_schema_1_are_read(tmp_path: Path) -> None:
    term = {"equation": "v_x", "feature": "constant", "coefficient": 0.5}
    line = [[10.0 * i, 10.0 * i, 0.0, 0.0] for i in range(5)]
    road = {"line": line, "curves": {"grade": [0.0, 0.01, 0.02, 0.03]}}
    content = {
        "kind": "stand_in",
        "schema": 1,
        "parameters": {"mass": 1500.0},
        "correction": [term],
        "own": {"road": road, "correction": [term | {"feature": "speed", "coefficient": 0.1}]},
    }
    file = tmp_path / "old.yaml"
    file.write_text(yaml.safe_dump(content))
    model = load_surrogate(file).content
    assert [t.feature for t in model.feature_terms] == ["constant"]
    assert [t.feature for t in model.extras.feature_terms] == ["speed"]
    assert model.road() is not None
    file.write_text(yaml.safe_dump(content | {"schema": 2}))
    with pytest.raises(UsageError, match="has schema 1"):
        load_surrogate(file)


def test_new_files_have_the_new_keys() -> None:
    content = yaml.safe_load(simulation_yaml(surrogate()))
    assert (content["kind"], content["schema"]) == ("surrogate", 2)
    assert set(content["identification"]) == {"error", "autocovariance", "weak_directions"}
    assert "identification" not in yaml.safe_load(surrogate_yaml(car()))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"error": {"v_x": 0.1}}, "need imu_a_x"),
        ({"weak_directions": [{"luck": 1.0}]}, "'luck' is unknown"),
        ({"limits": [2.0, 1.0, 3.0, 4.0, 5.0, 6.0, 7.0]}, "ascending"),
        ({"limits": [1.0]}, "row of values"),
    ],
)
def test_a_wrong_identification_is_refused(tmp_path: Path, change: dict, message: str) -> None:
    content = yaml.safe_load(simulation_yaml(surrogate()))
    if "limits" in change:
        content["identification"]["autocovariance"]["v_x"] |= change
    else:
        content["identification"] |= change
    file = tmp_path / "wrong.yaml"
    file.write_text(yaml.safe_dump(content))
    with pytest.raises(UsageError, match=message):
        load_surrogate(file)


def test_an_unknown_surrogate_error_is_noted(tmp_path: Path) -> None:
    known = inputs._notes_on_known(reloaded(surrogate(), tmp_path))
    (unknown,) = inputs._notes_on_known(load_surrogate(SCHEMA_1).content.surrogate())
    assert known == []
    assert "does not hold its error" in unknown
