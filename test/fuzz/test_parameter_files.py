# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Altered YAML files of each kind: refused in one line, or what they describe can be used."""

import json
from collections.abc import Callable
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from helpers.fuzzing import assert_one_line, byte_edits, edited_bytes, edited_content, fuzz
from helpers.watch import surrogate
from hypothesis import strategies as st

from adk_ros.errors import AdkError
from adk_ros.mismatch.deployment.simulator_input import load_simulator
from adk_ros.mismatch.deployment.surrogate_file import load_surrogate
from adk_ros.mismatch.deployment.surrogate_writer import simulation_yaml
from adk_ros.mismatch.recording.nominal_vehicle import load_nominal_vehicle
from adk_ros.mismatch.watch.watched_model import watched_surrogate
from adk_ros.model.adaptation.online_methods import OnlineSettings
from adk_ros.plant.scenario.scenario_file import load_scenario
from adk_ros.plant.vehicle.vehicle_parameters import load_vehicle
from adk_ros.ros.parameter_file import read_parameter_file
from adk_ros.ros.parameter_settings import pipeline_settings

pytestmark = pytest.mark.slow(seconds=20)
DATA = resources.files("adk_ros.plant") / "data"
CONFIG = Path(__file__).parents[2] / "config"


def use_vehicle(path: Path) -> None:
    load_vehicle(path)
    load_nominal_vehicle(path)
    load_simulator(path)


def use_surrogate(path: Path) -> None:
    content = load_surrogate(path)
    model, notes = watched_surrogate(content)
    assert np.isfinite(model.parameters).all()
    for note in notes:
        assert_one_line(note)
    load_simulator(path)


def use_parameters(path: Path) -> None:
    values, warnings = read_parameter_file(path)
    pipeline_settings(values, OnlineSettings())
    for warning in warnings:
        assert_one_line(warning)


def surrogate_file() -> str:
    return simulation_yaml(surrogate())


USES: dict[str, tuple[Callable[[], str], Callable[[Path], Any]]] = {
    "vehicle": ((DATA / "imdv.vehicle.yaml").read_text, use_vehicle),
    "scenario": ((DATA / "mountain.scenario.yaml").read_text, load_scenario),
    "surrogate": (surrogate_file, use_surrogate),
    "parameters": ((CONFIG / "predictor.yaml").read_text, use_parameters),
}


def as_yaml(content: Any) -> bytes:
    """Return content as JSON, which is YAML, and which PyYAML's writer is not too deep for."""
    text = json.dumps(content).replace("Infinity", ".inf").replace("NaN", ".nan")
    return text.encode("utf-8", "replace")


@pytest.mark.parametrize("kind", sorted(USES))
def test_parameter_files(kind: str, tmp_path: Path) -> None:
    write, use = USES[kind]
    text = write()
    path = tmp_path / "file.yaml"
    path.write_text(text)
    use(path)

    def check(content: bytes) -> None:
        path.write_bytes(content)
        try:
            use(path)
        except AdkError as error:
            assert_one_line(str(error))

    altered = edited_content(yaml.safe_load(text)).map(as_yaml)
    damaged = byte_edits().map(lambda edits: edited_bytes(text.encode(), edits))
    fuzz(st.one_of(altered, damaged), check)
