# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Errors that build tolerances of the car cause in open-loop predictions."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from helpers.mismatch import case

from adk_ros.files.yaml_file import validate
from adk_ros.mismatch.deployment.held_out import Evidence, horizon_errors, rmse
from adk_ros.mismatch.deployment.surrogate_file import SurrogateFile
from adk_ros.mismatch.deployment.tolerance_error import tolerance_error
from adk_ros.mismatch.library.criteria import TOLERANCE_SIGMA
from adk_ros.mismatch.library.surrogate_parameters import NAMES


@cache
def evidence() -> list[Evidence]:
    return [Evidence(case().recording)]


def model(**tolerances: float) -> SurrogateFile:
    p = case().nominal.parameters()
    parameters = {name: float(x) for name, x in zip(NAMES, p, strict=True)}
    content = {"kind": "surrogate", "schema": 2, "parameters": parameters}
    return validate("model", content | {"tolerances": tolerances}, SurrogateFile)


def test_it_is_the_error_of_independent_tolerances() -> None:
    expected = tolerance_error(model(), evidence())
    assert expected.shape == (3, 3)
    assert np.all(expected > 0.0)
    # Speed drifts away; lateral motion is bounded by the tyres.
    assert np.all(np.diff(expected[:, 0]) > 0.0)
    base = horizon_errors(model(), evidence())
    for name in ("mass", "stiffness_f", "drag_area"):
        one = rmse(horizon_errors(model(**{name: TOLERANCE_SIGMA}), evidence()) - base)
        assert np.all(one <= expected)


def test_it_starts_from_the_tolerances_of_the_model() -> None:
    assert tolerance_error(model(mass=0.004), evidence()) == pytest.approx(
        tolerance_error(model(), evidence()), rel=0.1
    )
