# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Text of `simulation.yaml` and `corrected.yaml`; see `surrogate_file` for the format."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import yaml  # type: ignore[import-untyped, unused-ignore]

from adk_ros.mismatch.deployment.surrogate_file import KIND, SCHEMA
from adk_ros.mismatch.library.surrogate_parameters import INDEX, NAMES
from adk_ros.mismatch.recording.sensor_log import CHANNELS
from adk_ros.mismatch.surrogate.error_autocovariance import ErrorAutocovariance
from adk_ros.mismatch.surrogate.feature_terms import FeatureTerm
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.channels import STATE_NAMES


def surrogate_yaml(
    parameters: FloatArray,
    tolerances: dict[str, float] | None = None,
    terms: list[dict[str, Any]] | None = None,
    feature_terms: Sequence[FeatureTerm] = (),
    surrogate: SurrogateModel | None = None,
) -> str:
    """Return a file's text; the extras are those of `surrogate`."""
    return _dump(_content(parameters, tolerances, terms, feature_terms, surrogate))


def simulation_yaml(surrogate: SurrogateModel) -> str:
    """Return the text of a surrogate's own file, with its identification if that is known."""
    content = _content(surrogate.parameters, surrogate=surrogate)
    if np.any(surrogate.error > 0.0):
        content["identification"] = _identification(surrogate)
    return _dump(content)


def _dump(content: dict[str, Any]) -> str:
    text: str = yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=96)
    return text


def _content(
    parameters: FloatArray,
    tolerances: dict[str, float] | None = None,
    terms: list[dict[str, Any]] | None = None,
    feature_terms: Sequence[FeatureTerm] = (),
    surrogate: SurrogateModel | None = None,
) -> dict[str, Any]:
    content: dict[str, Any] = {
        "kind": KIND,
        "schema": SCHEMA,
        "parameters": {name: _rounded(parameters[i]) for i, name in enumerate(NAMES)},
    }
    if tolerances:
        content["tolerances"] = {name: _rounded(x) for name, x in tolerances.items()}
    if terms:
        content["terms"] = terms
    if feature_terms:
        content["feature_terms"] = _feature_entries(feature_terms)
    extras = {} if surrogate is None else _extras(surrogate)
    if extras:
        content["extras"] = extras
    return content


def _extras(surrogate: SurrogateModel) -> dict[str, Any]:
    extras: dict[str, Any] = {}
    road = surrogate.road
    if road is not None:
        extras["road"] = {
            "spacing": road.spacing,
            "curves": {
                name: [_rounded(x) for x in knots]
                for name, knots in zip(road.entries, road.coefficients, strict=True)
            },
            "line": [[round(float(x), 4) for x in row] for row in road.line],
        }
    if surrogate.feature_terms:
        extras["feature_terms"] = _feature_entries(surrogate.feature_terms)
    return extras


def _feature_entries(terms: Sequence[FeatureTerm]) -> list[dict[str, Any]]:
    return [
        {
            "equation": term.equation,
            "feature": term.feature,
            "coefficient": _rounded(term.coefficient),
        }
        for term in terms
    ]


def _identification(surrogate: SurrogateModel) -> dict[str, Any]:
    error = surrogate.autocovariance or ErrorAutocovariance.of(surrogate.residuals)
    open_loop = surrogate.open_loop_error
    content: dict[str, Any] = {
        "error": dict(zip(CHANNELS, map(_rounded, surrogate.error), strict=True)),
        "autocovariance": {
            name: {
                "limits": [_rounded(x) for x in error.limits[i]],
                "values": [[_rounded(x) for x in row] for row in error.values[i]],
            }
            for i, name in enumerate(CHANNELS)
        },
        "weak_directions": [
            {name: _rounded(row[INDEX[name]]) for name in NAMES if row[INDEX[name]] != 0.0}
            for row in surrogate.weak_directions
        ],
    }
    if open_loop is not None:
        content["open_loop_error"] = {
            name: [_rounded(x) for x in open_loop[:, i]] for i, name in enumerate(STATE_NAMES)
        }
    if surrogate.envelope is not None:
        content["envelope"] = [
            [_rounded(x) for x in vertex] for vertex in surrogate.envelope.vertices
        ]
    return content


def _rounded(value: float) -> float:
    """Return a value to eight significant digits."""
    return float(np.format_float_positional(value, 8, unique=False, fractional=False))
