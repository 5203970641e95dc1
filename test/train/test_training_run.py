# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From records to an artefact: whole, the same for the same seed, continued after a kill."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.train import SMALL, lines, record, small

from adk_ros.errors import DataError, UsageError
from adk_ros.model import artefact
from adk_ros.model.evaluation import rollout_record
from adk_ros.signals.channels import Record
from adk_ros.signals.decode import SensorConfig
from adk_ros.train import network_fit
from adk_ros.train.network_fit import Step
from adk_ros.train.training_run import run_training

pytestmark = [pytest.mark.slow(seconds=30), pytest.mark.usefixtures("one_candidate")]

SHORT = replace(SMALL, steps=20, batch=32, validate_every=10)


def part() -> Record:
    return record("handling", 90.0)


def digest(folder: Path) -> dict[str, str]:
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.iterdir()}


def test_the_artefact_is_whole_and_tells_how_it_came_about(tmp_path: Path) -> None:
    sensors = SensorConfig(reference_point=(1.3, 0.0), steer_joint="column", steering_ratio=16.0)
    told: list[tuple[str, int, int]] = []
    run = run_training(
        [part()], tmp_path / "m", SHORT, sensors=sensors, note=lambda *what: told.append(what)
    )
    loaded = artefact.load(tmp_path / "m")
    facts = loaded.manifest["training"]
    assert facts == json.loads(json.dumps(run.facts))
    assert loaded.model.motion_limits.tolist() == [12.0, 12.0, 9.0, 12.0], "gentle driving"
    assert facts["kind"] == "default"
    assert facts["settings"] == asdict(SHORT)
    stored: dict[str, Any] = {
        key: tuple(value) if isinstance(value, list) else value
        for key, value in facts["sensors"].items()
    }
    assert SensorConfig(**stored) == sensors
    assert facts["data"] == [{"name": "handling", "seconds": 89.975, "imu": True}]
    assert facts["split"]["kind"] == "blocks"
    total = sum(facts["split"][name] for name in ("train", "validation", "test"))
    assert total == pytest.approx(part().duration_s, abs=0.01)
    assert run.trained is not None
    assert run.test is not None
    assert (facts["best_step"], facts["stopped_early"]) == (run.trained.best_step, False)
    assert facts["held_out"]["starts"] == run.test.scores["model"].count
    assert loaded.model.uses_imu
    assert {what for what, _, _ in told} == {
        "preparing: fitting the observer",
        "selecting hyperparameters",
        "comparing with naive predictors",
        "scoring held-out data",
    }
    assert all(0 <= done <= total for _, done, total in told)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["m"]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """What an undisturbed training writes."""
    path = tmp_path_factory.mktemp("whole") / "m"
    run_training([part()], path, SHORT)
    return digest(path)


def test_same_seed_same_bytes_other_seed_others(whole: dict[str, str], tmp_path: Path) -> None:
    out = tmp_path / "m"
    run_training([part()], out, SHORT)
    assert digest(out) == whole
    assert whole.keys() == {"encoder.pt", "arrays.npz", "manifest.json"}
    # Into the same place: a model is replaced by the next one.
    run_training([part()], out, replace(SHORT, seed=1))
    assert digest(out).keys() == whole.keys()
    assert not set(digest(out).values()) & set(whole.values())
    artefact.load(out)


def test_killed_and_started_again_it_is_the_same_model(
    whole: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(network_fit, "_CHECKPOINT_EVERY", 5)
    killed = tmp_path / "killed"

    def kill(step: Step) -> None:
        if step.step == 13:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_training([part()], killed, SHORT, on_step=kill)
    assert not killed.exists()
    assert {path.name for path in tmp_path.glob("*.npz")} == {
        "killed.checkpoint.npz",
        "killed.first.checkpoint.npz",
    }
    told: list[Step] = []
    run_training([part()], killed, SHORT, on_step=told.append)
    assert told[0].step == 11
    assert digest(killed) == whole
    assert not list(tmp_path.glob("*.npz"))


def test_a_place_that_is_no_model_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "chapter").write_text("years of work")
    with pytest.raises(UsageError, match="exists and is not a model"):
        run_training([part()], tmp_path / "thesis", SHORT)
    assert (tmp_path / "thesis" / "chapter").read_text() == "years of work"
    # Known before hours are spent on the training.
    with pytest.raises(UsageError, match="cannot be written"):
        run_training([part()], tmp_path / "thesis" / "chapter" / "m", SHORT)


def test_too_short_is_said_in_one_line(tmp_path: Path) -> None:
    for seconds, said in ((5, "5 s of data are too short"), (12, "too short|no validation|only")):
        with pytest.raises(DataError, match=said) as caught:
            run_training([part().rows(slice(0, 40 * seconds))], tmp_path / "m", SHORT)
        assert len(lines(str(caught.value))) == 1
    assert not list(tmp_path.iterdir())


def test_bags_with_and_without_an_imu_go_together(tmp_path: Path) -> None:
    records = [part(), record("handling", 90.0, imu=False)]
    run = run_training(records, tmp_path / "m", SHORT)
    assert [item["imu"] for item in run.facts["data"]] == [True, False]
    assert artefact.load(tmp_path / "m").model.uses_imu


def test_without_an_imu(tmp_path: Path) -> None:
    run = run_training([record("handling", 90.0, imu=False)], tmp_path / "m", SHORT)
    assert not artefact.load(tmp_path / "m").model.uses_imu
    assert run.test is not None
    assert "IMU integration" not in run.test.scores


def test_held_out_bag(tmp_path: Path) -> None:
    run = run_training([part(), record("town", 60.0)], tmp_path / "m", SHORT, "bags")
    assert run.test is not None
    assert [rolled.record.name for rolled in run.test.rollouts] == ["town"]
    assert run.facts["split"]["test"] == pytest.approx(60.0, abs=0.1)


def test_the_small_model_is_good_for_something() -> None:
    """What the other tests rely on."""
    test = small().run.test
    assert test is not None
    assert (test.ratio[3] < [0.2, 0.9, 0.3]).all()


def test_beyond_its_range_a_single_track_model_counts(tmp_path: Path) -> None:
    """Trained on the fast half of a drive, tested on its slow half."""
    recorded = record("handling", 300.0)
    fast = recorded.x[:, 0] > 12.0
    episode = np.cumsum(np.concatenate([[False], np.diff(fast.astype(int)) != 0]))
    trained = replace(recorded, episode=episode).rows(fast)
    rmse = {}
    for single_track in (False, True):
        folder = tmp_path / str(single_track)
        settings = replace(SHORT, steps=100, single_track=single_track)
        run = run_training([trained], folder, settings)
        model = artefact.load(folder).model
        assert model.lifting.compiled is not None
        assert (model.lifting.compiled.car.size > 0) == single_track
        stored = run.facts["single_track"]
        assert (stored is None) != single_track
        rolled = rollout_record(model, recorded, None, ~fast, 40, 10)
        error = rolled.predicted[:, -1] - recorded.x_ref[rolled.rows + 40]
        rmse[single_track] = np.sqrt(np.nanmean(error**2, axis=0))
    # v_y and yaw rate, 1 s ahead.
    assert (rmse[True][1:] < 0.7 * rmse[False][1:]).all(), rmse
