# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`adk_ros.train_model` from recordings and bags."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from helpers.train import bag

import adk_ros
from adk_ros.api.training import default_settings

pytestmark = pytest.mark.usefixtures("one_candidate")

QUICK = adk_ros.TrainSettings(steps=20, hidden=8, history=2, validate_every=2)


@pytest.mark.slow
def test_a_model_is_trained_from_recordings(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recording = adk_ros.read_recording(bag("handling", 60.0))
    steps, stages = [], []
    model = adk_ros.train_model(
        [recording, bag("town", 30.0)],
        out=tmp_path / "m",
        settings=QUICK,
        progress=lambda stage, *_: stages.append(stage),
        on_step=lambda step: steps.append(step.step),
    )
    assert capsys.readouterr() == ("", "")
    # Training may stop early.
    assert steps == list(range(1, len(steps) + 1))
    assert 2 <= len(steps) <= 20
    assert "training" in stages
    assert (tmp_path / "m" / "report.html").is_file()
    assert [data["name"] for data in model.facts["data"]] == [
        recording.name,
        bag("town", 30.0).name,
    ]
    assert model.training is not None
    assert model.training.facts["held_out"] == model.facts["held_out"]
    loaded = adk_ros.load_model(tmp_path / "m")
    assert loaded.scores.equals(model.scores)


def test_recordings_with_and_without_commands_are_not_trained_on_together(tmp_path: Path) -> None:
    recording = adk_ros.read_recording(bag("town", 20.0))
    topics = replace(recording.topics, command=None)
    other = replace(recording, content=replace(recording.content, topics=topics))
    with pytest.raises(adk_ros.DataError, match="train a model on each kind of recording"):
        adk_ros.train_model([recording, other], out=tmp_path / "m", settings=QUICK)


def test_steps_and_seed_change_the_default_settings() -> None:
    settings = default_settings(steps=500, seed=3)
    assert (settings.steps, settings.seed, settings.validate_every) == (500, 3, 50)
    assert default_settings() == adk_ros.TrainSettings()
