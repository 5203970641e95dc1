# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Data faults: the node's predictions, its diagnostics, and the recovery after the fault.

The rig runs the core of the node in simulated time on real ROS messages, without topics.
"""

import copy
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.node import Rig, write_model

from adk_ros.model import artefact
from adk_ros.model.adaptation.online_methods import WindowedRidge
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.pipeline import PipelineSettings
from adk_ros.ros.diagnostics import DiagnosticReport, Level
from adk_ros.ros.messages import join_stamp, split_stamp
from adk_ros.ros.traffic import Rates
from adk_ros.signals.channels import STANDARD_SOURCES, TICK_NS, Flag, Source
from adk_ros.signals.decode import SensorConfig


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> KoopmanModel:
    folder: Path = write_model(tmp_path_factory.mktemp("model") / "model")
    return artefact.load(folder).model


@pytest.fixture
def rig(model: KoopmanModel) -> Rig:
    rig = Rig(model)
    rig.drive(3.0)
    assert rig.reports[-1].level is Level.OK
    assert rig.reports[-1].message.startswith("predicting")
    return rig


def value(report: DiagnosticReport, key: str) -> float:
    return float(dict(report.values)[key])


def assert_recovered(rig: Rig, after_s: float = 3.0) -> None:
    """After the fault the level returns to OK, and every sample is predicted."""
    rig.drive(after_s)
    published = len(rig.published)
    report = rig.drive(1.0)[-1]
    assert report.level is Level.OK, report.message
    assert report.message.startswith("predicting")
    assert 39 <= len(rig.published) - published <= 41
    assert rig.all_finite()


def corrupted(source: Source, field: str, number: float, every: int = 1) -> Callable[..., Any]:
    """Return a change that sets a field of every `every`-th message to `number`."""
    seen = [0]

    def change(given: Source, msg: Any) -> Any:
        if given is source:
            seen[0] += 1
            if seen[0] % every == 0:
                *path, last = field.split(".")
                target = msg
                for name in path:
                    target = getattr(target, name)
                if last.isdigit():
                    target[int(last)] = number
                else:
                    setattr(target, last, number)
        return msg

    return change


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize(
    ("source", "field", "reason"),
    [
        (Source.IMU, "angular_velocity.z", "imu messages refused: yaw rate is not finite"),
        (Source.IMU, "linear_acceleration.y", "imu messages refused: acceleration is not finite"),
        (
            Source.ODOMETRY,
            "twist.twist.linear.x",
            "odometry messages refused: velocity is not finite",
        ),
        (
            Source.ODOMETRY,
            "twist.twist.angular.z",
            "odometry messages refused: yaw rate is not finite",
        ),
        (Source.COMMAND, "effort.0", "command messages refused: drive torque is not finite"),
        (Source.COMMAND, "position.1", "command messages refused: steering angle is not finite"),
    ],
)
def test_not_finite(rig: Rig, source: Source, field: str, reason: str, number: float) -> None:
    published = len(rig.published)
    report = rig.drive(2.0, corrupted(source, field, number, every=3))[-1]
    assert report.level is Level.WARN
    assert reason in report.message
    assert len(rig.published) - published >= 78
    assert any(
        key.startswith(reason.replace(" messages refused", ".refused")) for key, _ in report.values
    )
    assert_recovered(rig)


def test_all_odometry_is_nan(rig: Rig) -> None:
    report = rig.drive(4.0, corrupted(Source.ODOMETRY, "twist.twist.linear.x", math.nan))[-1]
    assert report.level is Level.ERROR
    assert "no predictions" in report.message
    assert "odometry messages refused: velocity is not finite" in report.message
    assert_recovered(rig)


@pytest.mark.parametrize(
    ("source", "field", "text"),
    [
        (Source.ODOMETRY, "twist.twist.linear.x", "1 odometry reading rejected: v_x 90 m/s, exp"),
        (Source.ODOMETRY, "twist.twist.linear.y", "1 odometry reading rejected: v_y 90 m/s, exp"),
        (Source.IMU, "linear_acceleration.x", "1 imu reading rejected: a_x 90 m/s², expected"),
        (Source.IMU, "angular_velocity.z", "1 imu reading rejected: yaw_rate 90 rad/s, expected"),
    ],
)
def test_a_single_glitch_is_rejected_and_named(
    rig: Rig, source: Source, field: str, text: str
) -> None:
    rig.drive(3.0)
    published = len(rig.published)
    once = corrupted(source, field, 90.0, every=30 if source is Source.ODOMETRY else 120)
    report = rig.drive(1.0, once)[-1]
    assert report.level is Level.WARN
    assert text in report.message
    assert dict(report.values)[f"{source.name.lower()}.rejected"] == "1"
    assert (
        text.partition(": ")[2] in dict(report.values)[f"{source.name.lower()}.latest_rejection"]
    )
    assert len(rig.published) - published >= 38
    speeds = np.array([p.horizon[:, 0] for p in rig.published[published:]])
    assert np.abs(speeds).max() < 30.0
    assert_recovered(rig)


def test_a_second_publisher_is_suspected(rig: Rig) -> None:
    def twice(source: Source, msg: Any) -> Any:
        if source is not Source.ODOMETRY:
            return msg
        other = copy.deepcopy(msg)
        other.header.stamp.nanosec = (msg.header.stamp.nanosec + 1_000_000) % 10**9
        other.twist.twist.linear.x = 0.0
        return [msg, other] if other.header.stamp.nanosec > msg.header.stamp.nanosec else msg

    rig.drive(3.0)
    report = rig.drive(2.0, twice)[-1]
    assert report.level is Level.WARN
    assert "odometry readings rejected: v_x 0 m/s, expected" in report.message
    assert "if another node publishes on this topic, stop one of the two" in report.message
    assert_recovered(rig)


def test_a_new_level_is_accepted_and_reported(rig: Rig) -> None:
    def faster(source: Source, msg: Any) -> Any:
        if source is Source.ODOMETRY:
            msg.twist.twist.linear.x += 4.0
        return msg

    rig.drive(3.0)
    report = rig.drive(1.0, faster)[-1]
    assert report.level is Level.WARN
    assert "4 odometry readings rejected" in report.message
    assert "odometry is at a new level: v_x" in report.message
    assert rig.drive(2.0, faster)[-1].level is Level.OK


def test_predictions_that_no_car_can_follow_are_withheld(rig: Rig) -> None:
    rig.drive(2.0)
    rig.pipeline.predictor.online.theta[0, -1] += 1e4
    published = len(rig.published)
    report = rig.drive(1.0)[-1]
    assert report.level is Level.ERROR
    assert "predictions withheld: no vehicle moves as predicted" in report.message
    assert np.abs(np.array([p.horizon[:, 0] for p in rig.published[published:]])).max() < 150.0
    rig.drive(1.0)
    assert_recovered(rig)


@pytest.mark.parametrize("hours", [1, -1, 24 * 365 * 10])
@pytest.mark.parametrize("source", STANDARD_SOURCES)
def test_single_implausible_stamp(rig: Rig, source: Source, hours: int) -> None:
    """A single wrong stamp is ignored; the samples do not shift."""
    changed: list[bool] = []

    def change(given: Source, msg: Any) -> Any:
        if given is source and not changed:
            changed.append(True)
            stamp_ns = join_stamp(msg.header.stamp) + hours * 3_600_000_000_000
            msg.header.stamp.sec, msg.header.stamp.nanosec = split_stamp(stamp_ns)
        return msg

    published = len(rig.published)
    report = rig.drive(1.0, change)[-1]
    assert report.level is Level.WARN
    assert "1 implausible time stamps ignored" in report.message
    assert value(report, "stray_stamps") == 1
    assert value(report, "clock_jumps") == 0
    assert 39 <= len(rig.published) - published <= 41
    assert_recovered(rig, 1.0)


def test_missing_stamp(rig: Rig) -> None:
    def change(given: Source, msg: Any) -> Any:
        if given is Source.COMMAND:
            msg.header.stamp.sec = msg.header.stamp.nanosec = 0
        return msg

    report = rig.drive(1.0, change)[-1]
    assert report.level is Level.WARN
    assert "command messages refused: no time stamp" in report.message
    assert_recovered(rig)


def test_stamps_beyond_ros_time_are_no_internal_errors(model: KoopmanModel) -> None:
    rig = Rig(model)
    rig.stamp_offset_ns = (2**31 - 12) * 10**9 - rig.mono_ns
    report = rig.drive(4.0)[-1]
    assert value(report, "internal_errors") == 0
    assert report.level is Level.ERROR
    assert "imu messages refused: the time stamp is beyond the range of ROS time" in report.message
    assert rig.published


def test_duplicates(model: KoopmanModel) -> None:
    """Duplicate messages change no prediction."""
    once, twice = Rig(model), Rig(model)
    once.drive(4.0)
    report = twice.drive(4.0, lambda _source, msg: [msg, copy.deepcopy(msg)])[-1]
    assert report.level is Level.WARN
    assert "duplicates" in report.message
    assert value(report, "duplicates") > 1000
    assert len(once.published) == len(twice.published)
    for a, b in zip(once.published, twice.published, strict=True):
        assert a.stamp_ns == b.stamp_ns
        np.testing.assert_array_equal(a.horizon, b.horizon)
    assert_recovered(twice, 1.0)


def swapped(source: Source) -> Callable[[Source, Any], Any]:
    """Return a change that swaps each pair of messages of `source`."""
    waiting: list[Any] = []

    def change(given: Source, msg: Any) -> Any:
        if given is not source:
            return msg
        if not waiting:
            waiting.append(msg)
            return None
        return [msg, waiting.pop()]

    return change


def test_out_of_order(rig: Rig) -> None:
    report = rig.drive(3.0, swapped(Source.IMU))[-1]
    assert "readings out of order" in report.message
    assert value(report, "out_of_order") >= 290
    assert_recovered(rig, 1.0)


def test_too_late(rig: Rig) -> None:
    """Odometry 0.3 s late: used for later samples, not for those already published."""
    delayed: list[Any] = []

    def change(given: Source, msg: Any) -> Any:
        if given is not Source.ODOMETRY:
            return msg
        delayed.append(msg)
        return delayed.pop(0) if len(delayed) > 15 else None

    report = rig.drive(4.0, change)[-1]
    assert report.level is Level.WARN
    assert "readings too late for their sample" in report.message
    assert value(report, "late") > 50
    assert_recovered(rig)


@pytest.mark.parametrize("jump_s", [-10.0, -2.0, 5.0, 3600.0])
def test_clock_jumps(rig: Rig, jump_s: float) -> None:
    """A bag loops, or the time is set: the state is reset, and predictions continue."""
    online = rig.pipeline.predictor.online
    rig.stamp_offset_ns += round(jump_s * 1e9)
    restarts = rig.pipeline.restarts
    before_ns = rig.published[-1].stamp_ns
    report = rig.drive(1.0)[-1]
    assert report.level is Level.WARN
    assert "clock jumped: all state was reset" in report.message
    assert value(report, "clock_jumps") == 1
    assert rig.pipeline.restarts == restarts + 1
    assert abs((rig.published[-1].stamp_ns - before_ns) * 1e-9 - jump_s - 1.0) < 0.1
    # The window contains only samples since the jump.
    assert isinstance(online, WindowedRidge)
    assert online.n_pairs <= 40
    assert_recovered(rig, 1.0)


def without(*sources: Source) -> Callable[[Source, Any], Any]:
    return lambda given, msg: None if given in sources else msg


def test_odometry_timeout(rig: Rig) -> None:
    reports = rig.drive(5.0, without(Source.ODOMETRY))
    assert reports[0].level is Level.WARN
    assert "coasting for" in reports[0].message
    assert reports[-1].level is Level.ERROR
    assert "no predictions: odometry timeout (" in reports[-1].message
    assert value(reports[-1], "ticks_odometry_stale") > 150
    assert_recovered(rig)


def test_command_timeout(rig: Rig) -> None:
    published = len(rig.published)
    report = rig.drive(5.0, without(Source.COMMAND))[-1]
    assert report.level is Level.WARN
    assert "command timeout (" in report.message
    assert "last command is used" in report.message
    assert value(report, "ticks_command_stale") > 150
    assert len(rig.published) - published > 195
    assert_recovered(rig)


def test_imu_timeout(rig: Rig) -> None:
    published = len(rig.published)
    report = rig.drive(5.0, without(Source.IMU))[-1]
    assert report.level is Level.WARN
    assert "IMU timeout (" in report.message
    assert "yaw rate from odometry" in report.message
    # After half a second the vehicle counts as one without an IMU, and the model adapts again.
    assert 15 <= value(report, "ticks_imu_stale") <= 25
    assert value(report, "ticks_no_imu") > 150
    assert len(rig.published) - published > 190
    assert_recovered(rig)


def test_a_steering_report_that_stops_is_named(rig: Rig) -> None:
    rig.core.counters.last_received_s[Source.STEERING] = rig.mono_ns * 1e-9
    report = rig.drive(3.0)[-1]
    assert report.level is Level.WARN
    assert "steering timeout (3.0 s): commanded steering angle is used" in report.message


def late(by: int) -> Callable[[Source, Any], Any]:
    """Deliver each message of odometry when the `by`-th after it is sent."""
    waiting: list[Any] = []

    def change(source: Source, msg: Any) -> Any:
        if source is not Source.ODOMETRY:
            return msg
        waiting.append(copy.deepcopy(msg))
        return waiting.pop(0) if len(waiting) > by else None

    return change


def test_odometry_that_is_always_late_still_corrects(rig: Rig) -> None:
    """The observer must not run open loop while old velocities, integrated, are better."""
    begin = len(rig.published)
    report = rig.drive(8.0, late(15))[-1]
    assert report.level is Level.WARN
    assert "odometry arrives more than max_wait_s (0.05 s) after the other streams" in (
        report.message
    )
    # The state of the slalom is known from the readings; its speed drifts without correction.
    innovations = np.array([p.innovation for p in rig.published[begin:]])
    late_ones = innovations[-160:]
    assert np.abs(late_ones[:, 0]).max() < 0.5
    spreads = [p.covariance[0, 0] for p in rig.published[begin:]]
    assert max(spreads[:60]) > spreads[0]
    assert_recovered(rig)


@pytest.mark.parametrize(
    "sources",
    [
        (Source.ODOMETRY, Source.COMMAND),
        (Source.ODOMETRY, Source.IMU),
        (Source.COMMAND, Source.IMU),
        STANDARD_SOURCES,
    ],
)
def test_several_timeouts(rig: Rig, sources: tuple[Source, ...]) -> None:
    report = rig.drive(8.0, without(*sources))[-1]
    assert report.level is (Level.ERROR if Source.ODOMETRY in sources else Level.WARN)
    for source in sources:
        assert f"{source.name.lower()} timeout (" in report.message.lower()
    assert_recovered(rig)


@pytest.mark.parametrize(
    ("missing", "message"),
    [
        ((Source.ODOMETRY,), "odometry never received"),
        ((Source.COMMAND,), "command never received"),
        ((Source.ODOMETRY, Source.COMMAND), "odometry never received, command never received"),
    ],
)
def test_missing_from_the_start(
    model: KoopmanModel, missing: tuple[Source, ...], message: str
) -> None:
    rig = Rig(model)
    rig.drive(0.5, without(*missing))
    assert rig.report().level is Level.WARN
    assert rig.reports[-1].message.startswith("waiting for")
    reports = rig.drive(20.0, without(*missing))
    assert {report.level for report in reports} == {Level.ERROR}
    assert "no predictions: " + message in reports[-1].message
    assert not rig.published
    assert_recovered(rig)


def test_no_messages_at_all(model: KoopmanModel) -> None:
    rig = Rig(model)
    report = rig.drive(60.0, without(*STANDARD_SOURCES))[-1]
    assert report.level is Level.ERROR
    assert report.message == "no predictions: odometry never received, command never received"
    assert_recovered(rig)


@pytest.mark.parametrize("trained_with_imu", [True, False])
def test_no_imu(tmp_path: Path, trained_with_imu: bool) -> None:
    model = artefact.load(write_model(tmp_path / "model", trained_with_imu)).model
    rig = Rig(model, rates=Rates(imu_hz=0.0))
    report = rig.drive(5.0)[-1]
    assert "no IMU: yaw rate from odometry" in report.message
    assert report.level is (Level.WARN if trained_with_imu else Level.OK)
    assert ("the model was trained with one" in report.message) is trained_with_imu
    assert len(rig.published) > 180
    assert value(report, "ticks_no_imu") == rig.pipeline.ticks


def test_imu_required(model: KoopmanModel) -> None:
    rig = Rig(model, use_imu="required", rates=Rates(imu_hz=0.0))
    report = rig.drive(3.0)[-1]
    assert report.level is Level.ERROR
    assert "no IMU, but use_imu is 'required' (imu never received)" in report.message
    dead = Rig(model, use_imu="required")
    dead.drive(3.0)
    assert dead.reports[-1].level is Level.OK
    report = dead.drive(3.0, without(Source.IMU))[-1]
    assert report.level is Level.ERROR
    assert "no IMU, but use_imu is 'required' (imu timeout (" in report.message
    assert_recovered(dead)
    never = Rig(model, use_imu="never", rates=Rates(imu_hz=0.0))
    assert never.drive(3.0)[-1] == never.reports[-1]
    assert "IMU" not in never.reports[-1].message


def frozen(source: Source) -> Callable[[Source, Any], Any]:
    """Return a change by which `source` repeats its first message with new stamps."""
    first: list[Any] = []

    def change(given: Source, msg: Any) -> Any:
        if given is not source:
            return msg
        first.append(msg)
        repeated = copy.deepcopy(first[0])
        repeated.header = msg.header
        return repeated

    return change


def test_frozen_odometry(rig: Rig) -> None:
    reports = rig.drive(4.0, frozen(Source.ODOMETRY))
    assert any("odometry frozen" in report.message for report in reports)
    assert reports[-1].level is Level.ERROR
    assert value(reports[-1], "ticks_frozen") > 100
    assert_recovered(rig)


def test_frozen_imu(rig: Rig) -> None:
    report = rig.drive(4.0, frozen(Source.IMU))[-1]
    assert report.level is Level.WARN
    assert "IMU frozen" in report.message
    assert_recovered(rig)


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        ({"name": ["drive", "wheel"]}, "joint 'steer' is missing"),
        ({"name": ["motor", "steer"]}, "joint 'drive' is missing"),
        ({"name": []}, "joint 'drive' is missing"),
        ({"effort": []}, "joint 'drive' has no effort"),
        ({"position": [0.0]}, "joint 'steer' has no position"),
    ],
)
def test_missing_joint(rig: Rig, fields: dict[str, Any], reason: str) -> None:
    def change(given: Source, msg: Any) -> Any:
        if given is Source.COMMAND:
            for name, content in fields.items():
                setattr(msg, name, content)
        return msg

    report = rig.drive(3.0, change)[-1]
    assert report.level is Level.WARN
    assert f"command messages refused: {reason}" in report.message
    assert_recovered(rig)


def test_missing_joint_from_the_start(model: KoopmanModel) -> None:
    rig = Rig(model)

    def change(given: Source, msg: Any) -> Any:
        if given is Source.COMMAND:
            msg.name = ["a", "b"]
        return msg

    report = rig.drive(8.0, change)[-1]
    assert report.level is Level.ERROR
    assert "no predictions: all command messages are refused" in report.message
    assert "joint 'drive' is missing" in report.message


def test_streams_of_different_clocks(model: KoopmanModel) -> None:
    """Odometry in time since boot, other sensors in Unix time: reported as such."""
    rig = Rig(model)

    def change(given: Source, msg: Any) -> Any:
        if given is Source.ODOMETRY:
            stamp_ns = join_stamp(msg.header.stamp) - 1_700_000_000_000_000_000
            msg.header.stamp.sec, msg.header.stamp.nanosec = split_stamp(stamp_ns)
        return msg

    report = rig.drive(8.0, change)[-1]
    assert report.level is Level.ERROR
    assert "odometry stamps are 53.9 years behind the other streams" in report.message
    assert "implausible time stamps ignored" in report.message


def test_imu_in_g(model: KoopmanModel) -> None:
    rig = Rig(model)

    def change(given: Source, msg: Any) -> Any:
        if given is Source.IMU:
            force = msg.linear_acceleration
            force.x, force.y, force.z = force.x / 9.81, force.y / 9.81, force.z / 9.81
        return msg

    report = rig.drive(30.0, change)[-1]
    assert report.level is Level.WARN
    assert "it looks like g, the topic must carry m/s²" in report.message
    assert rig.published
    assert rig.all_finite()


def test_imu_in_degrees(model: KoopmanModel) -> None:
    rig = Rig(model)

    def change(given: Source, msg: Any) -> Any:
        if given is Source.IMU:
            msg.angular_velocity.z = math.degrees(msg.angular_velocity.z)
        return msg

    report = rig.drive(30.0, change)[-1]
    assert report.level is Level.WARN
    assert "it looks like deg/s, the topic must carry rad/s" in report.message
    assert rig.all_finite()


@pytest.mark.parametrize(
    ("after", "message"),
    [
        (Rates(imu_hz=100.0), "imu rate changed from 200 Hz to 100 Hz"),
        (Rates(odometry_hz=10.0), "odometry rate changed from"),
        (Rates(imu_hz=1000.0), "imu rate changed from"),
    ],
)
def test_rate_changes(rig: Rig, after: Rates, message: str) -> None:
    published = len(rig.published)
    rig.rates = after
    reports = rig.drive(10.0)
    assert any(message in report.message for report in reports)
    assert all(report.level is Level.OK for report in reports)
    assert len(rig.published) - published >= 397
    rates = [value(reports[-1], f"{source.name.lower()}.rate_hz") for source in STANDARD_SOURCES]
    np.testing.assert_allclose(rates, after, rtol=0.03)


def test_sim_time_starts_late(model: KoopmanModel) -> None:
    """Predictions depend on stamps only; the missing clock is reported."""
    rig = Rig(model)
    rig.sim_time = (True, False)
    report = rig.drive(3.0)[-1]
    assert report.level is Level.WARN
    assert "simulation time has not started: no /clock" in report.message
    assert rig.published
    rig.sim_time = (True, True)
    assert_recovered(rig, 1.0)


def test_internal_error(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    """An exception resets the state, is logged once and counted each time."""
    step = rig.pipeline.predictor.step
    calls = [0]

    def faulty(sample: Any) -> Any:
        calls[0] += 1
        if calls[0] in (5, 10):
            raise ZeroDivisionError("for the test")
        return step(sample)

    monkeypatch.setattr(rig.pipeline.predictor, "step", faulty)
    report = rig.drive(1.0)[-1]
    assert report.level is Level.ERROR
    assert "2 internal errors, last: ZeroDivisionError: for the test" in report.message
    assert [type(error) for error in rig.errors] == [ZeroDivisionError]
    assert_recovered(rig, 1.0)


def test_a_publisher_that_fails_does_not_end_the_node(rig: Rig) -> None:
    def fail(_prediction: Any) -> None:
        raise RuntimeError("context is not valid")

    rig.core._publish, original = fail, rig.core._publish
    assert rig.drive(1.0)[-1].level is Level.ERROR
    rig.core._publish = original
    assert_recovered(rig, 1.0)


@pytest.mark.parametrize("name", ["x", "covariance", "horizon"])
@pytest.mark.parametrize("number", [math.nan, math.inf])
def test_predictions_that_are_not_finite_are_withheld(
    rig: Rig, monkeypatch: pytest.MonkeyPatch, name: str, number: float
) -> None:
    """A predictor that returns NaN or infinity."""
    step = rig.pipeline.predictor.step

    def broken(sample: Any) -> Any:
        prediction: Any = step(sample)
        values = np.array(getattr(prediction, name))
        values.flat[-1] = number
        return prediction._replace(**{name: values})

    published = len(rig.published)
    monkeypatch.setattr(rig.pipeline.predictor, "step", broken)
    report = rig.drive(1.0)[-1]
    assert len(rig.published) == published
    assert report.level is Level.ERROR
    assert "predictions withheld: not finite" in report.message
    assert value(report, "predictions_withheld") >= 39
    monkeypatch.undo()
    assert_recovered(rig, 1.0)


def test_online_estimator_reset(model: KoopmanModel) -> None:
    rig = Rig(model)
    rig.drive(2.0)
    rig.pipeline.predictor.online.failures += 3
    report = rig.drive(1.0)[-1]
    assert report.level is Level.WARN
    assert "online estimator reset 3 times" in report.message
    assert_recovered(rig, 1.0)


def test_slow_tick_is_a_missed_deadline(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    step = rig.pipeline.predictor.step
    slow = [True, True]

    def late(sample: Any) -> Any:
        if slow:
            slow.pop()
            rig.mono_ns += 30_000_000
        return step(sample)

    monkeypatch.setattr(rig.pipeline.predictor, "step", late)
    report = rig.drive(1.0)[-1]
    assert report.level is Level.WARN
    assert "2 deadlines missed" in report.message
    assert value(report, "tick_max_us") == pytest.approx(30_000.0)
    assert_recovered(rig, 1.0)


def test_stall_is_counted_and_completes_no_sample(rig: Rig) -> None:
    """After a stall the clock is ahead of the queued messages, which are processed first."""
    ticks, missed = rig.pipeline.ticks, rig.core.counters.missed_deadlines
    rig.mono_ns += 110_000_000
    rig.core.on_timer(rig.stamp_ns)
    assert rig.pipeline.ticks == ticks
    assert rig.core.counters.missed_deadlines == missed + 3
    # No input from here on: after a call on time, the clock completes samples.
    rig.mono_ns += TICK_NS
    rig.core.on_timer(rig.stamp_ns)
    assert rig.pipeline.ticks > ticks


def test_no_deadline_is_missed_without_input(model: KoopmanModel) -> None:
    rig = Rig(model)
    for _ in range(5):
        rig.mono_ns += 10 * TICK_NS
        rig.core.on_timer(rig.stamp_ns)
    assert rig.core.counters.missed_deadlines == 0


@pytest.mark.parametrize("rates", [Rates(0.0, 10.0, 5.0), Rates(50.0, 10.0, 5.0)])
def test_slow_streams_are_completed_by_the_clock(
    model: KoopmanModel, rates: Rates, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Readings 100 ms apart: samples every 25 ms, equal to those without the clock."""
    samples: list[dict[int, Any]] = []
    delays_ns = []
    for watch in (True, False):
        rig = Rig(model, rates=rates)
        taken: dict[int, Any] = {}
        step = rig.pipeline.predictor.step

        def note(
            sample: Any, rig: Rig = rig, taken: dict[int, Any] = taken, step: Any = step
        ) -> Any:
            taken[sample.stamp_ns] = sample
            if len(samples) == 0:
                delays_ns.append(rig.stamp_ns - sample.stamp_ns)
            return step(sample)

        monkeypatch.setattr(rig.pipeline.predictor, "step", note)
        rig.drive(10.0, watch=watch)
        samples.append(taken)
    by_clock, by_data = samples
    assert max(delays_ns[40:]) <= 100_000_000
    assert np.median(delays_ns[40:]) < 70_000_000
    # Before the second command its period is unknown, and the clock marks it stale earlier.
    known = sorted(by_data)[40:]
    assert len(known) > 340
    for stamp_ns in known:
        assert repr(by_clock[stamp_ns]) == repr(by_data[stamp_ns])


def test_the_clock_waits_for_streams_that_are_slow_and_late(
    model: KoopmanModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Stamps 0.2 s behind: the clock must not complete samples before their readings arrive."""
    counts = []
    for watch in (True, False):
        rig = Rig(model, rates=Rates(imu_hz=0.0, odometry_hz=10.0, command_hz=10.0))
        rig.stamp_offset_ns -= 200_000_000
        timer = rig.core.on_timer

        def ahead_of_the_stamps(now_ns: int, timer: Callable[[int], None] = timer) -> None:
            timer(now_ns + 200_000_000)

        monkeypatch.setattr(rig.core, "on_timer", ahead_of_the_stamps)
        rig.drive(10.0, watch=watch)
        late = {s: rig.pipeline.aligner.counts_by_source["late", s] for s in Source}
        counts.append((len(rig.published), late[Source.ODOMETRY], late[Source.COMMAND]))
    by_clock, by_data = counts
    assert by_clock[1:] == by_data[1:] == (0, 0)
    assert by_clock[0] >= by_data[0] > 370


@pytest.mark.parametrize("by_s", [1.2, 1.9, 2.5])
def test_a_clock_that_is_another_one_completes_no_sample(
    model: KoopmanModel, by_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The computer's clock is ahead of the sensors': their readings are not late by it."""
    rig = Rig(model, rates=Rates(imu_hz=0.0, odometry_hz=20.0, command_hz=20.0))
    timer = rig.core.on_timer
    monkeypatch.setattr(rig.core, "on_timer", lambda now_ns: timer(now_ns + round(by_s * 1e9)))
    rig.drive(10.0)
    assert rig.pipeline.aligner.counts["late"] == 0
    assert not any(bits & Flag.COASTING for bits in rig.pipeline.flagged)


def test_a_known_delay_is_no_difference_of_the_stamps(model: KoopmanModel) -> None:
    """Odometry's clock is 0.3 s ahead, as the configuration says."""
    sensors = SensorConfig(odometry_delay=0.3)
    rig = Rig(model, PipelineSettings(sensors=sensors))

    def ahead(source: Source, msg: Any) -> Any:
        if source is Source.ODOMETRY:
            stamp_ns = join_stamp(msg.header.stamp) + 300_000_000
            msg.header.stamp.sec, msg.header.stamp.nanosec = split_stamp(stamp_ns)
        return msg

    report = rig.drive(4.0, ahead)[-1]
    assert report.level is Level.OK, report.message


def test_samples_are_counted_by_their_flags(rig: Rig) -> None:
    """Also those that one message completes together."""
    before = sum(rig.pipeline.flagged.values())
    rig.drive(0.3, lambda source, msg: None if source is Source.COMMAND else msg)
    rig.drive(0.2)
    flagged = sum(rig.pipeline.flagged.values()) - before
    assert flagged == rig.pipeline.flagged[int(Flag.COMMAND_STALE)]
    assert 6 <= flagged <= 12


def test_reset_on_request(rig: Rig) -> None:
    rig.core.reset()
    report = rig.drive(1.0)[-1]
    assert report.level is Level.OK
    assert "reset on request" in report.message
    assert value(report, "resets_on_request") == 1
    assert_recovered(rig, 1.0)


def test_disabled_ignores_everything_and_begins_afresh(rig: Rig) -> None:
    rig.drive(2.0)
    published = len(rig.published)
    theta = rig.pipeline.predictor.online.theta.copy()
    rig.core.enable(False)
    rig.diagnostics.begin(rig.mono_ns * 1e-9)
    reports = rig.drive(5.0)
    assert {report.message for report in reports} == {"disabled"}
    assert {report.level for report in reports} == {Level.OK}
    assert not rig.diagnostics.is_overdue(rig.mono_ns * 1e-9)
    assert len(rig.published) == published
    np.testing.assert_array_equal(rig.pipeline.predictor.online.theta, theta)
    rig.core.enable(True)
    rig.diagnostics.begin(rig.mono_ns * 1e-9)
    np.testing.assert_array_equal(rig.pipeline.predictor.online.theta, rig.model.theta0)
    assert not rig.pipeline.aligner.streams[Source.ODOMETRY]
    rig.drive(1.0)
    assert rig.reports[-1].level is Level.OK
    assert len(rig.published) - published > 30


def test_values_of_a_healthy_report(rig: Rig) -> None:
    report = rig.drive(1.0)[-1]
    values = dict(report.values)
    assert values["model"] == "test"
    assert values["status"] == "predicted"
    assert value(report, "imu.rate_hz") == pytest.approx(200.0, abs=2.0)
    assert value(report, "odometry.rate_hz") == pytest.approx(50.0, abs=1.0)
    assert value(report, "command.rate_hz") == pytest.approx(40.0, abs=1.0)
    assert 0.0 <= value(report, "odometry.age_s") < 0.05
    assert value(report, "condition_number") > 1.0
    for name in ("v_x", "v_y", "yaw_rate"):
        assert value(report, f"innovation_rms.{name}") > 0.0
    assert value(report, "ticks") == rig.pipeline.ticks
    assert value(report, "predictions") == len(rig.published)
    for key in ("missed_deadlines", "internal_errors", "predictions_withheld", "duplicates"):
        assert value(report, key) == 0


def edited(source: Source, edit: Callable[[Any], None]) -> Callable[[Source, Any], Any]:
    def change(given: Source, msg: Any) -> Any:
        if given is source:
            edit(msg)
        return msg

    return change


def in_odom_frame(msg: Any) -> None:
    msg.child_frame_id = "odom"


def huge_variance(msg: Any) -> None:
    msg.twist.covariance[7] = 1e9


def no_acceleration(msg: Any) -> None:
    msg.linear_acceleration_covariance[0] = -1.0


@pytest.mark.parametrize(
    ("source", "edit", "text"),
    [
        (Source.ODOMETRY, in_odom_frame, "odometry's child_frame_id is 'odom'"),
        (Source.ODOMETRY, huge_variance, "odometry's variance of v_y is above 10000"),
        (Source.IMU, no_acceleration, "the IMU marks its acceleration as not available"),
    ],
)
def test_frames_and_covariances_are_reported(
    rig: Rig, source: Source, edit: Callable[[Any], None], text: str
) -> None:
    report = rig.drive(3.0, edited(source, edit))[-1]
    assert report.level is Level.WARN
    assert text in report.message
    assert_recovered(rig)


def test_odometry_in_the_axes_of_odom_is_reported(model: KoopmanModel) -> None:
    rig = Rig(model)

    def rotated(msg: Any) -> None:
        # The heading of the slalom of `ros.traffic`: 0.2 sin(t / 2) rad/s, and 0.15 rad/s.
        time_s = (rig.mono_ns - 50_000_000_000) * 1e-9
        heading = 0.4 * (1.0 - math.cos(0.5 * time_s)) + 0.15 * time_s
        twist = msg.twist.twist
        v_x, v_y = twist.linear.x, twist.linear.y
        twist.linear.x = v_x * math.cos(heading) - v_y * math.sin(heading)
        twist.linear.y = v_x * math.sin(heading) + v_y * math.cos(heading)
        twist.angular.z += 0.15

    report = rig.drive(60.0, edited(Source.ODOMETRY, rotated))[-1]
    assert "odometry's velocity turns with the heading" in report.message
    assert report.level is not Level.OK


def test_a_velocity_that_is_always_zero_is_reported(model: KoopmanModel) -> None:
    rig = Rig(model)

    def no_v_y(msg: Any) -> None:
        msg.twist.twist.linear.y = 0.0

    report = rig.drive(15.0, edited(Source.ODOMETRY, no_v_y))[-1]
    assert report.level is Level.WARN
    assert "odometry's v_y is 0 throughout: it is not measured" in report.message


def test_steering_ratio_and_reference_point_reach_the_pipeline(model: KoopmanModel) -> None:
    settings = PipelineSettings(horizon_steps=0)
    rig = Rig(model, settings)
    rig.drive(2.0)
    assert rig.published
    assert rig.published[-1].horizon.shape == (0, 3)
