# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Open-loop predictions along a bag: starts, causality, commands, and accuracy."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from helpers.train import (
    START_NS,
    bag,
    changed_streams,
    drive,
    kept,
    made_record,
    record,
    small,
    small_without_imu,
)

from adk_ros.bags import BagWriter, message
from adk_ros.bags.recording import RecordingOptions, read_recording
from adk_ros.errors import DataError, UsageError
from adk_ros.model import artefact
from adk_ros.model.evaluation import sample_at
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.predictor import Predictor
from adk_ros.offline.rollout import (
    find_vehicle,
    horizon_steps,
    mean_commands,
    rollout,
    start_rows,
    write_csv,
)
from adk_ros.plant.scenario.sensor_simulation import SimulatedDrive
from adk_ros.plant.scenario.sensors import Stream
from adk_ros.plant.vehicle.vehicle_parameters import Vehicle, load_vehicle
from adk_ros.signals.channels import TICK_NS, Reading, Source

CAR = load_vehicle("imdv")
STEPS = 40
NOMINAL = {
    "mass": 1780.5, "yaw_inertia": 2950.0, "cg_to_front_axle": 1.21, "cg_to_rear_axle": 1.43,
    "track_width": 1.58, "cg_height": 0.55, "wheel_radius": 0.316, "wheel_inertia": 1.1,
    "side_force_area": 2.9, "yaw_moment_volume": 0.9,
}  # fmt: skip
"""Keys of a nominal vehicle file: no tyres, no actuators."""


@pytest.fixture(scope="module")
def model() -> KoopmanModel:
    return artefact.load(small().path).model


def aligned(of: SimulatedDrive, path: Path) -> Path:
    """Write the recording so that it begins on the grid, with log times equal to the stamps."""

    def change(source: Source, stream: Stream) -> Stream:
        if source is Source.COMMAND:
            # The first command is stamped before the start and acts from the start on.
            at = np.maximum(stream.stamp_ns, START_NS)
            stream = kept(Stream(at, at, stream.values), np.arange(len(at)) != 1)
        return Stream(stream.stamp_ns, stream.stamp_ns, stream.values)

    return changed_streams(of, path, change)


def test_starts_follow_the_stride_after_two_seconds(tmp_path: Path) -> None:
    path = aligned(drive("town", 12.0, clean=True), tmp_path / "b")
    read = read_recording(path)
    assert read.start_ns == START_NS
    starts, predicted = rollout(CAR, read, STEPS, 0.5)
    # The starts are on the grid; the last has a whole horizon before the end.
    np.testing.assert_allclose(starts, np.arange(2.0, 11.0, 0.5)[: starts.size], atol=1e-12)
    assert starts[-1] >= 10.5
    assert predicted.shape == (starts.size, STEPS, 3)
    starts, predicted = rollout(CAR, read, 4, 0.025)
    np.testing.assert_allclose(np.diff(starts), 0.025, atol=1e-12)
    assert (starts[0], predicted.shape[1]) == (2.0, 4)


def test_starts_are_rounded_up_to_the_grid() -> None:
    read = read_recording(bag())
    assert read.start_ns % TICK_NS != 0
    starts, _ = rollout(CAR, read, STEPS, 0.7)
    expected = 2.0 + 0.7 * np.arange(starts.size)
    assert np.all(starts - expected >= -1e-9)
    assert np.all(starts - expected < 0.025)
    ticks = (starts * 1e9 + read.start_ns) / TICK_NS
    np.testing.assert_allclose(ticks, np.rint(ticks), atol=1e-3)


def test_start_rows_require_state_and_commands() -> None:
    of = made_record(np.zeros((400, 3)), np.zeros((400, 2)))
    since_s = 0.025 * np.arange(400, dtype=np.float64)
    rows = start_rows(of, since_s, STEPS, 0.5)
    np.testing.assert_array_equal(rows, np.arange(80, 360, 20))
    x, u = of.x.copy(), of.u.copy()
    x[100] = np.nan
    u[210] = np.nan
    remaining = start_rows(replace(of, x=x, u=u), since_s, STEPS, 0.5)
    assert set(rows) - set(remaining) == {100, 180, 200}
    episode = (np.arange(400) >= 300).astype(np.int64)
    remaining = start_rows(replace(of, episode=episode), since_s, STEPS, 0.5)
    assert set(rows) - set(remaining) == {260, 280}
    assert start_rows(of.rows(slice(0, 100)), since_s[:100], STEPS, 0.5).size == 0


def test_gaps_have_no_start_and_cause_none_at_their_end() -> None:
    of = made_record(np.zeros((400, 3)), np.zeros((400, 2)))
    keep = np.ones(400, dtype=bool)
    keep[130:167] = False
    episode = (np.arange(400) >= 130).astype(np.int64)
    cut = replace(of, episode=episode).rows(keep)
    since_s = (cut.stamp_ns - START_NS).astype(np.float64) * 1e-9
    rows = start_rows(cut, since_s, 10, 0.5)
    times = np.rint(since_s[rows] / 0.025).astype(int)
    np.testing.assert_array_equal(times, [80, 100, *range(180, 390, 20)])


def command(stamp_ns: int, torque: float, delta: float = 0.0) -> Reading:
    return Reading(Source.COMMAND, stamp_ns, (torque, delta))


def test_mean_commands_over_a_step() -> None:
    of = made_record(np.zeros((5, 3)), np.full((5, 2), 7.0))
    tick = TICK_NS
    commands = [
        command(START_NS - 3 * tick, 100.0, 0.1),
        command(START_NS + tick // 5, 200.0, 0.2),
        command(START_NS + 2 * tick, 400.0, -0.1),
        command(START_NS + 3 * tick + tick // 2, 0.0, 0.0),
    ]
    mean = mean_commands(of, commands)
    np.testing.assert_allclose(mean[:, 0], [180.0, 200.0, 400.0, 200.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(mean[:, 1], [0.18, 0.2, -0.1, -0.05, 0.0], atol=1e-9)
    # Order of arrival has no effect; of duplicates the first counts, as in the aligner.
    shuffled = [commands[i] for i in (2, 0, 3, 1)] + [commands[1]._replace(values=(9e9, 9.0))]
    np.testing.assert_allclose(mean_commands(of, shuffled), mean, atol=1e-6)
    # Before the first command, the values of the record.
    np.testing.assert_array_equal(mean_commands(of, commands[2:])[:2], 7.0)
    backwards = replace(of, stamp_ns=of.stamp_ns[[0, 1, 2, 0, 1]])
    np.testing.assert_array_equal(mean_commands(backwards, commands), of.u)


def test_command_stamp_jitter_of_a_microsecond_has_no_effect(tmp_path: Path) -> None:
    """Otherwise every second command would act one whole step late."""
    of = drive("town", 20.0, clean=True)
    rng = np.random.default_rng(0)

    def on_the_tick(jitter_ns: int):
        def change(source: Source, stream: Stream) -> Stream:
            if source is not Source.COMMAND:
                return stream
            at = np.rint(stream.stamp_ns / TICK_NS).astype(np.int64) * TICK_NS
            at = at + rng.integers(-jitter_ns, jitter_ns + 1, len(at))
            return Stream(at, at + 10**6, stream.values)

        return change

    recordings = [
        read_recording(changed_streams(of, tmp_path / str(ns), on_the_tick(ns)))
        for ns in (0, 1000)
    ]
    (_, exact), (_, jittered) = (rollout(CAR, read, STEPS, 0.5) for read in recordings)
    np.testing.assert_allclose(jittered, exact, atol=2e-4)


def truth_at(of: SimulatedDrive, starts_s: np.ndarray, start_ns: int) -> np.ndarray:
    rows = np.rint((starts_s * 1e9 + start_ns - of.stamp_ns[0]) / TICK_NS).astype(int)
    truth: np.ndarray = of.x[rows[:, None] + 1 + np.arange(STEPS)]
    return truth


def test_true_vehicle_is_accurate() -> None:
    of = drive("town", 30.0, clean=True)
    read = read_recording(bag("town", 30.0, clean=True))
    starts, predicted = rollout(of.vehicle, read, STEPS, 0.5)
    truth = truth_at(of, starts, read.start_ns)
    error = predicted - truth
    change = np.sqrt(np.mean((truth[:, -1] - truth[:, 0]) ** 2, axis=0))
    final = np.sqrt(np.mean(error[:, -1] ** 2, axis=0))
    assert np.all(final < [0.01, 0.002, 0.001]), final
    assert np.all(final < 0.02 * change)
    assert np.all(np.abs(error).max(axis=(0, 1)) < [0.03, 0.02, 0.02])


def test_actuators_start_from_the_earlier_commands(monkeypatch) -> None:
    """Actuators that start at the command would jump at each start."""
    of = drive("town", 30.0, clean=True)
    read = read_recording(bag("town", 30.0, clean=True))
    starts, predicted = rollout(of.vehicle, read, STEPS, 0.5)
    truth = truth_at(of, starts, read.start_ns)
    early = np.sqrt(np.mean((predicted - truth)[:, 0] ** 2, axis=0))
    monkeypatch.setattr(
        "adk_ros.offline.rollout.actuator_state_history", lambda vehicle, record, u: u
    )
    _, settled = rollout(of.vehicle, read, STEPS, 0.5)
    settled_early = np.sqrt(np.mean((settled - truth)[:, 0] ** 2, axis=0))
    assert np.all(early < 0.5 * settled_early), early / settled_early


def test_another_vehicle_is_less_accurate() -> None:
    of = drive("town", 30.0, clean=True)
    read = read_recording(bag("town", 30.0, clean=True))
    heavy = of.vehicle.model_copy(update={"mass": 1.3 * of.vehicle.mass})
    starts, predicted = rollout(heavy, read, STEPS, 0.5)
    error = np.sqrt(np.mean((predicted - truth_at(of, starts, read.start_ns)) ** 2, axis=(0, 1)))
    assert error[0] > 0.1


def test_trained_model_beats_no_change(model: KoopmanModel) -> None:
    of = drive("town", 30.0)
    read = read_recording(bag())
    starts, predicted = rollout(model, read, STEPS, 0.25)
    truth = truth_at(of, starts, read.start_ns)
    rows = np.searchsorted(read.record.stamp_ns, starts * 1e9 + read.start_ns - 1e3)
    unchanged = read.record.x[rows]
    ours = np.sqrt(np.mean((predicted[:, -1] - truth[:, -1]) ** 2, axis=0))
    naive = np.sqrt(np.mean((unchanged - truth[:, -1]) ** 2, axis=0))
    assert np.all(ours < [0.3, 0.9, 0.4] * naive), ours / naive


def test_trained_model_adapts_up_to_each_start(model: KoopmanModel) -> None:
    """Equal to a predictor that received all samples up to the start."""
    read = read_recording(bag())
    starts, predicted = rollout(model, read, STEPS, 3.0)
    since_s = (read.record.stamp_ns - read.start_ns) * 1e-9
    predictor = Predictor(model)
    row = 0
    for start, expected in zip(starts, predicted, strict=True):
        while since_s[row] <= start:
            predictor.step(sample_at(read.record, row))
            row += 1
        ahead = predictor.rollout(read.record.u[row - 1 : row - 1 + STEPS])
        np.testing.assert_array_equal(ahead, expected)


CUT_S = 11.3


def falsified(of: SimulatedDrive, how: str):
    """Change the measurements after `CUT_S`, not the commands."""

    def change(source: Source, stream: Stream) -> Stream:
        if source is Source.COMMAND:
            return stream
        after = stream.stamp_ns > of.stamp_ns[0] + round(CUT_S * 1e9)
        if how == "gone":
            return kept(stream, ~after)
        values = stream.values.copy()
        if how == "other":
            values[after] = np.random.default_rng(1).normal(0.0, 5.0, values[after].shape)
        else:
            values[after] = values[after][0]
        return Stream(stream.stamp_ns, stream.log_ns, values)

    return change


@pytest.mark.parametrize("how", ["other", "frozen", "gone"])
@pytest.mark.parametrize("kind", ["model", "vehicle"])
def test_measurements_after_a_start_have_no_effect(
    tmp_path: Path, model: KoopmanModel, how: str, kind: str
) -> None:
    of = drive("town", 20.0)
    chosen: KoopmanModel | Vehicle = model if kind == "model" else CAR
    original = read_recording(bag("town", 20.0))
    changed = read_recording(changed_streams(of, tmp_path / "b", falsified(of, how)))
    assert changed.start_ns == original.start_ns
    starts, expected = rollout(chosen, original, STEPS, 0.1)
    changed_starts, changed_predicted = rollout(chosen, changed, STEPS, 0.1)
    last_ns = original.start_ns + changed_starts * 1e9 - of.stamp_ns[0]
    before = last_ns <= CUT_S * 1e9
    count = int(before.sum())
    assert count > 80
    np.testing.assert_array_equal(changed_starts[:count], starts[:count])
    np.testing.assert_array_equal(changed_predicted[:count], expected[:count])
    # The last of these starts is right before the cut, its whole horizon after it.
    assert starts[count - 1] > CUT_S - 0.15
    if how == "other":
        assert (
            np.abs(
                changed_predicted[count + 10 :] - expected[count + 10 : len(changed_predicted)]
            ).max()
            > 1.0
        )


@pytest.mark.parametrize("kind", ["model", "vehicle"])
def test_later_commands_are_used(tmp_path: Path, model: KoopmanModel, kind: str) -> None:
    of = drive("town", 20.0)
    chosen: KoopmanModel | Vehicle = model if kind == "model" else CAR

    def brake(source: Source, stream: Stream) -> Stream:
        values = stream.values.copy()
        if source is Source.COMMAND:
            values[stream.stamp_ns > of.stamp_ns[0] + round(CUT_S * 1e9), 0] = -4000.0
        return Stream(stream.stamp_ns, stream.log_ns, values)

    braked = read_recording(changed_streams(of, tmp_path / "b", brake))
    starts, before = rollout(chosen, read_recording(bag("town", 20.0)), STEPS, 0.1)
    _, after = rollout(chosen, braked, STEPS, 0.1)
    row = int(np.searchsorted(starts, CUT_S - 0.05)) - 1
    assert after[row, -1, 0] < before[row, -1, 0] - 1.0
    np.testing.assert_array_equal(after[starts < CUT_S - 1.1], before[starts < CUT_S - 1.1])


def test_without_an_imu(model: KoopmanModel) -> None:
    without_imu = artefact.load(small_without_imu()).model
    without = read_recording(bag("town", 20.0, imu=False))
    ignored = read_recording(bag("town", 20.0), RecordingOptions(use_imu=False))
    for read in (without, ignored):
        assert read.topics.imu is None
        for chosen in (without_imu, model, CAR):
            _, predicted = rollout(chosen, read, STEPS, 0.5)
            assert len(predicted) > 30
            assert np.isfinite(predicted).all()


def standstill(path: Path) -> Path:
    """Write ten seconds of a standing car with noise-free sensors."""
    odometry, joints = "nav_msgs/msg/Odometry", "sensor_msgs/msg/JointState"
    with BagWriter(path) as writer:
        writer.add_topic("/odometry", odometry)
        writer.add_topic("/command", joints)
        for step in range(400):
            header = {"stamp": START_NS + step * TICK_NS}
            writer.write("/odometry", message(odometry, header=header), header["stamp"])
            command_message = message(
                joints, header=header, name=["drive", "steer"], position=[0.0, 0.0],
                effort=[0.0, 0.0],
            )  # fmt: skip
            writer.write("/command", command_message, header["stamp"])
    return path


def test_standing_car_stays_at_rest(tmp_path: Path, model: KoopmanModel) -> None:
    read = read_recording(standstill(tmp_path / "b"))
    starts, predicted = rollout(CAR, read, STEPS, 0.5)
    np.testing.assert_allclose(starts[:3], [2.0, 2.5, 3.0], atol=1e-9)
    np.testing.assert_allclose(predicted, 0.0, atol=1e-9)
    _, predicted = rollout(model, read, STEPS, 0.5)
    assert np.isfinite(predicted).all()


def test_short_bag_is_refused() -> None:
    with pytest.raises(DataError) as caught:
        rollout(CAR, read_recording(bag("town", 2.5)), STEPS, 0.5)
    assert "no start after 2 s has commands for 1 s" in str(caught.value)
    assert "\n" not in str(caught.value)
    with pytest.raises(DataError, match="give a longer bag"):
        rollout(CAR, read_recording(bag("town", 1.0)), STEPS, 0.5)


def test_ranges_of_horizon_and_stride() -> None:
    assert horizon_steps(1.0, 0.5) == 40
    assert horizon_steps(0.025, 0.025) == 1
    assert horizon_steps(10.0, 60.0) == 400
    for horizon_s, stride_s in ((0.0, 0.5), (10.1, 0.5), (1.0, 0.0), (1.0, 4000.0)):
        with pytest.raises(UsageError, match=r"is out of range: choose 0\.025 to"):
            horizon_steps(horizon_s, stride_s)


def test_nominal_vehicle_file_is_accepted(tmp_path: Path) -> None:
    """Masses and lengths only: tyres and actuators default to those of a passenger car."""
    path = tmp_path / "vehicle.yaml"
    path.write_text("# Nominal vehicle\n" + yaml.safe_dump(NOMINAL))
    vehicle = find_vehicle(path)
    assert (vehicle.mass, vehicle.side_force_area) == (1780.5, 2.9)
    _, predicted = rollout(vehicle, read_recording(bag()), STEPS, 0.5)
    assert np.isfinite(predicted).all()
    assert find_vehicle(Path("imdv")) == CAR
    with pytest.raises(UsageError, match="does not exist: give a model folder"):
        find_vehicle(tmp_path / "other.yaml")
    path.write_text(yaml.safe_dump(NOMINAL | {"colour": "red"}))
    with pytest.raises(UsageError, match=r"vehicle\.yaml: colour: no such parameter"):
        find_vehicle(path)


def test_csv_is_written_completely_or_not_at_all(tmp_path: Path) -> None:
    starts = np.array([2.0, 2.5])
    predicted = np.arange(12.0).reshape(2, 2, 3) / 7.0
    out = tmp_path / "deep" / "r.csv"
    write_csv(out, starts, predicted)
    text = out.read_text()
    assert text.splitlines()[0] == "start_s,t_s,v_x,v_y,yaw_rate"
    table = np.loadtxt(out, delimiter=",", skiprows=1)
    np.testing.assert_allclose(table[:, 0], [2.0, 2.0, 2.5, 2.5])
    np.testing.assert_allclose(table[:, 1], [2.025, 2.05, 2.525, 2.55])
    np.testing.assert_allclose(table[:, 2:], predicted.reshape(4, 3), rtol=1e-8)
    assert [path.name for path in out.parent.iterdir()] == ["r.csv"]
    with pytest.raises(UsageError, match="cannot be written"):
        write_csv(out / "r.csv", starts, predicted)
    assert out.read_text() == text


def test_rollouts_stay_within_one_loop_of_a_looping_bag(model: KoopmanModel) -> None:
    """No prediction spans a clock jump."""
    of = record("town", 60.0)
    twice = replace(
        made_record(np.vstack([of.x[:400], of.x[:400]]), np.vstack([of.u[:400], of.u[:400]])),
        stamp_ns=np.concatenate([of.stamp_ns[:400], of.stamp_ns[:400]]),
        episode=np.repeat([0, 1], 400),
    )
    since_s = (twice.stamp_ns - twice.stamp_ns[0]) * 1e-9
    rows = start_rows(twice, np.maximum.accumulate(since_s), STEPS, 0.5)
    assert np.all(twice.episode[rows] == twice.episode[rows + STEPS])
