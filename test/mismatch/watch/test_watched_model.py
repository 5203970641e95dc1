# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The surrogate that a watch runs, from the files of a report."""

from __future__ import annotations

import numpy as np
import yaml
from helpers.mismatch_drive import simulated_car
from helpers.watch import surrogate

from adk_ros.files.yaml_file import validate
from adk_ros.mismatch.deployment.surrogate_file import NamedSurrogate, SurrogateFile
from adk_ros.mismatch.deployment.surrogate_writer import simulation_yaml, surrogate_yaml
from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.mismatch.watch.watched_model import watched_surrogate

PLACE = {
    "kind": "place",
    "lap": 100.0,
    "stretches": [[10.0, 20.0]],
    "line": [[0.0, 0.0, 0.0, 0.0], [50.0, 50.0, 0.0, 0.0]],
}


def loaded(text: str, name: str = "corrected.yaml") -> NamedSurrogate:
    return NamedSurrogate(name, validate(name, yaml.safe_load(text), SurrogateFile))


def test_all_terms_are_part_of_the_model_but_those_at_a_place() -> None:
    terms = [
        {"effect": "payload", "parameters": {"mass": 100.0}, "where": {"kind": "always"}},
        {"effect": "low_friction", "parameters": {"mu_scale": 0.5}, "where": PLACE},
    ]
    corrected = loaded(surrogate_yaml(simulated_car(), {"drag_area": 0.01}, terms))
    model, notes = watched_surrogate(corrected)
    p = model.parameters
    assert p[INDEX["mass"]] == simulated_car()[INDEX["mass"]] + 100.0
    assert p[INDEX["friction"]] == 1.0
    np.testing.assert_allclose(p[INDEX["drag_area"]], 0.6 * 1.01)
    assert len(notes) == 2
    assert "--simulation" in notes[0]
    assert "low_friction" in notes[1]


def test_the_error_comes_from_the_simulation_of_the_same_report() -> None:
    known = surrogate()
    text = simulation_yaml(
        type(known)(known.parameters, np.full(6, 0.01), known.residuals, known.weak_directions)
    )
    corrected = loaded(surrogate_yaml(simulated_car(mass=1900.0)))
    model, notes = watched_surrogate(corrected, loaded(text, "simulation.yaml"))
    assert notes == []
    assert model.parameters[INDEX["mass"]] == 1900.0
    np.testing.assert_allclose(model.error, 0.01)
    assert model.autocovariance is not None
