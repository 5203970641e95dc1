# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Results of the Python interface: their tables equal the arrays they come from."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from helpers.train import bag, changed_streams, drive, small
from matplotlib.figure import Figure

import adk_ros
from adk_ros.api.recording import BagRecording
from adk_ros.api.replay import ReplayResult
from adk_ros.api.rollout import RolloutResult
from adk_ros.signals.channels import STATE_NAMES
from adk_ros.signals.score import DISPLAY_NAMES

CHANNELS = list(STATE_NAMES)


@pytest.fixture(scope="module")
def recording() -> BagRecording:
    return adk_ros.read_recording(bag())


@pytest.fixture(scope="module")
def replayed(recording: BagRecording) -> ReplayResult:
    return adk_ros.replay(recording, small().path)


@pytest.fixture(scope="module")
def rollouts(recording: BagRecording) -> RolloutResult:
    return adk_ros.rollout(recording, "imdv", horizon_s=0.5, stride_s=1.0)


def test_a_recording_is_a_table_with_units(recording: BagRecording) -> None:
    frame, record = recording.frame, recording.record
    assert frame.index.name == "time_s"
    np.testing.assert_allclose(np.diff(frame.index), 0.025, atol=1e-9)
    np.testing.assert_array_equal(frame[CHANNELS].to_numpy(), record.x)
    np.testing.assert_array_equal(frame[["torque", "delta"]].to_numpy(), record.u)
    np.testing.assert_array_equal(frame[["a_x", "a_y"]].to_numpy(), record.a)
    measured = frame[[f"{name}_measured" for name in CHANNELS]].to_numpy()
    np.testing.assert_array_equal(measured, record.x_ref)
    units = frame.attrs["units"]
    assert units["v_x"] == units["v_y_measured"] == "m/s"
    assert (units["yaw_rate"], units["torque"], units["time_s"]) == ("rad/s", "N·m", "s")
    assert recording.warnings == []
    assert recording.topics.imu == "/imu/data"


def test_the_measured_state_between_samples_and_in_gaps(recording: BagRecording) -> None:
    time_s, reference = recording.time_s, recording.record.x_ref
    np.testing.assert_allclose(recording.measured_at(time_s[10:50]), reference[10:50], atol=1e-12)
    middle = recording.measured_at(0.5 * (time_s[10:49] + time_s[11:50]))
    np.testing.assert_allclose(middle, 0.5 * (reference[10:49] + reference[11:50]), atol=1e-9)
    outside = recording.measured_at(np.array([[-1.0, time_s[-1] + 1.0]]))
    assert outside.shape == (1, 2, 3)
    assert np.isnan(outside).all()
    kept = np.arange(len(recording.record)) != 30
    with_gap = BagRecording(
        recording.path,
        recording.options,
        type(recording.content)(
            recording.record.rows(kept),
            recording.topics,
            [],
            recording.content.start_ns,
            recording.content.commands,
            recording.content.sensors,
        ),
    )
    assert np.isnan(with_gap.measured_at(time_s[30:31])).all()
    assert np.isfinite(with_gap.measured_at(time_s[29:32:2])).all()


def test_options_choose_what_is_read(recording: BagRecording) -> None:
    without = adk_ros.read_recording(bag(), adk_ros.recording_options(use_imu=False))
    assert without.topics.imu is None
    assert without.frame[["a_x", "a_y"]].isna().all(axis=None)
    with pytest.raises(adk_ros.UsageError, match="give options to read_recording"):
        adk_ros.replay(recording, small().path, options=adk_ros.RecordingOptions())


def test_an_unknown_parameter_is_a_python_warning(tmp_path: Path) -> None:
    file = tmp_path / "p.yaml"
    file.write_text("/**:\n  ros__parameters:\n    referense_point: [1.0, 0.0]\n")
    with pytest.warns(UserWarning, match="did you mean 'reference_point'"):
        adk_ros.recording_options(params=file)


def test_a_loaded_model_has_the_scores_of_its_manifest() -> None:
    model = adk_ros.load_model(small().path)
    stored = model.facts["held_out"]
    assert list(model.scores.index.names) == ["channel", "horizon_s"]
    for channel in CHANNELS:
        scores = model.scores.loc[channel]
        assert list(scores.index) == stored["horizons_s"]
        assert list(scores["ratio"]) == stored["ratio_to_best_naive"][channel]
        for name, errors in stored["predictors"].items():
            assert list(scores[DISPLAY_NAMES.get(name, name)]) == errors[channel]["rmse"]
    assert isinstance(model.figure(), Figure)
    assert model.training is None


def test_replayed_predictions_as_a_table(replayed: ReplayResult) -> None:
    frame = replayed.frame
    assert len(frame) == len(replayed.predictions) > 1000
    first, last = replayed.predictions[0], replayed.predictions[-1]
    np.testing.assert_array_equal(frame[CHANNELS].iloc[0], first.x)
    deviation = frame[[f"{name}_std" for name in CHANNELS]].iloc[-1]
    np.testing.assert_allclose(deviation**2, np.diag(last.covariance))
    start_ns = replayed.recording.content.start_ns
    assert frame.index[-1] == pytest.approx((last.stamp_ns - start_ns) * 1e-9)
    # An innovation is the sample's state minus its prediction from the sample before.
    known = replayed.innovations[np.isfinite(replayed.innovations).all(axis=1)]
    np.testing.assert_allclose(replayed.innovation_rms, np.sqrt(np.mean(known**2, axis=0)))
    error = frame["v_x"] - frame["v_x_measured"]
    assert error.dropna().abs().max() < 1.0


def test_scores_of_a_replay(replayed: ReplayResult) -> None:
    scores = replayed.as_dict()["score"]
    ratio = replayed.scores["ratio"].unstack()
    for channel in CHANNELS:
        assert list(ratio.loc[channel]) == scores["ratio_to_best_naive"][channel]
    for figure in (replayed.figure(), replayed.figure(horizon_s=0.025)):
        assert len(figure.axes) == 3
    with pytest.raises(adk_ros.UsageError, match=r"choose 0\.025 to 2 s"):
        replayed.figure(horizon_s=3.0)
    assert replayed.warnings == []


def test_a_replay_of_the_training_data_warns(tmp_path: Path) -> None:
    path = changed_streams(drive("handling", 20.0), tmp_path / "handling", lambda _, x: x)
    (warning,) = adk_ros.replay(path, small().path).warnings
    assert "trained on a bag named handling" in warning


def test_rollouts_as_a_table(rollouts: RolloutResult) -> None:
    frame = rollouts.frame
    assert list(frame.index.names) == ["start_s", "t_s"]
    assert frame.shape == (rollouts.starts_s.size * 20, 6)
    np.testing.assert_array_equal(
        frame[CHANNELS].to_numpy().reshape(-1, 20, 3), rollouts.predicted
    )
    ahead_s = frame.index.get_level_values("t_s") - frame.index.get_level_values("start_s")
    np.testing.assert_allclose(ahead_s[:20], 0.025 * np.arange(1, 21), atol=1e-9)
    assert len(rollouts.figure().axes) == 3


def test_errors_of_rollouts(rollouts: RolloutResult) -> None:
    errors = rollouts.errors
    assert list(errors.index) == pytest.approx(0.025 * np.arange(1, 21))
    difference = rollouts.frame["v_x"] - rollouts.frame["v_x_measured"]
    by_step = difference.to_numpy().reshape(-1, 20)
    assert (errors["starts"] == rollouts.starts_s.size).all()
    np.testing.assert_allclose(errors["v_x"], np.sqrt(np.mean(by_step**2, axis=0)))
    # The simulation that made the bag predicts it almost exactly.
    assert errors["v_x"].max() < 0.2


def test_rollouts_are_written_as_csv(rollouts: RolloutResult, tmp_path: Path) -> None:
    out = tmp_path / "r.csv"
    rollouts.write_csv(out)
    table = np.genfromtxt(out, delimiter=",", names=True)
    np.testing.assert_allclose(table["v_y"], rollouts.frame["v_y"], rtol=1e-6, atol=1e-9)
    with pytest.raises(adk_ros.UsageError, match="exists already"):
        rollouts.write_csv(out)
    rollouts.write_csv(out, force=True)


def test_a_simulated_drive_is_the_true_motion() -> None:
    simulated = adk_ros.simulate("town", duration_s=10.0)
    of = drive("town", 10.0)
    assert simulated.out is None
    assert simulated.duration_s == 10.0
    np.testing.assert_array_equal(simulated.frame[CHANNELS].to_numpy(), of.x)
    assert simulated.frame.attrs["units"]["a_x"] == "m/s²"
    assert len(simulated.figure().axes) == 3


def test_results_are_shown_in_notebooks(
    recording: BagRecording, replayed: ReplayResult, rollouts: RolloutResult
) -> None:
    for result in (recording, replayed, rollouts, adk_ros.load_model(small().path)):
        text = result._repr_html_()
        assert "<table" in text
        assert len(text) < 30_000


def test_nothing_is_printed_and_progress_is_reported(
    recording: BagRecording, capsys: pytest.CaptureFixture[str]
) -> None:
    stages: dict[str, tuple[float, float]] = {}

    def progress(stage: str, done: float, total: float, detail: str) -> None:
        assert isinstance(detail, str)
        stages[stage] = (done, total)

    read = adk_ros.read_recording(bag(), progress=progress)
    adk_ros.replay(read, small().path, progress=progress)
    adk_ros.rollout(read, small().path, stride_s=5.0, progress=progress)
    adk_ros.simulate("town", duration_s=10.0, progress=progress)
    name = bag().name
    expected = {f"reading {name}", f"replaying {name}", "scoring", "rolling out", "simulating"}
    assert expected <= set(stages)
    assert all(done <= total for done, total in stages.values())
    assert capsys.readouterr() == ("", "")
