# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Every fault of the data that the node knows: what it answers, what its diagnostics say, and that
both are well again when the fault is over.

The rig drives the node's core in simulated time with real ROS messages; only topics are missing.
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
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.pipeline import PipelineSettings
from adk_ros.ros.diagnostics import DiagnosticReport, Level
from adk_ros.ros.messages import join_stamp, split_stamp
from adk_ros.ros.traffic import Rates
from adk_ros.signals.channels import STANDARD_SOURCES, TICK_NS, Source


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


def is_well(rig: Rig, after_s: float = 3.0) -> None:
    """After the fault the level recovers, and the grid is predicted without a gap."""
    rig.drive(after_s)
    published = len(rig.published)
    report = rig.drive(1.0)[-1]
    assert report.level is Level.OK, report.message
    assert report.message.startswith("predicting")
    assert 39 <= len(rig.published) - published <= 41
    assert rig.all_finite()


def spoil(source: Source, field: str, number: float, every: int = 1) -> Callable[..., Any]:
    """Return a change that writes `number` to a field of each `every`-th message."""
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
        (Source.IMU, "angular_velocity.z", "imu refused: yaw rate is not finite"),
        (Source.IMU, "linear_acceleration.y", "imu refused: acceleration is not finite"),
        (Source.ODOMETRY, "twist.twist.linear.x", "odometry refused: velocity is not finite"),
        (Source.ODOMETRY, "twist.twist.angular.z", "odometry refused: yaw rate is not finite"),
        (Source.COMMAND, "effort.0", "command refused: drive torque is not finite"),
        (Source.COMMAND, "position.1", "command refused: steering angle is not finite"),
    ],
)
def test_not_finite(rig: Rig, source: Source, field: str, reason: str, number: float) -> None:
    published = len(rig.published)
    report = rig.drive(2.0, spoil(source, field, number, every=3))[-1]
    assert report.level is Level.WARN
    assert reason in report.message
    assert len(rig.published) - published >= 78
    assert any(key.startswith(reason.replace(" refused", ".refused")) for key, _ in report.values)
    is_well(rig)


def test_nothing_but_nan(rig: Rig) -> None:
    report = rig.drive(4.0, spoil(Source.ODOMETRY, "twist.twist.linear.x", math.nan))[-1]
    assert report.level is Level.ERROR
    assert "no predictions" in report.message
    assert "odometry refused: velocity is not finite" in report.message
    is_well(rig)


@pytest.mark.parametrize("hours", [1, -1, 24 * 365 * 10])
@pytest.mark.parametrize("source", STANDARD_SOURCES)
def test_message_from_another_time(rig: Rig, source: Source, hours: int) -> None:
    """A single one is ignored; the grid does not move."""
    done: list[bool] = []

    def change(given: Source, msg: Any) -> Any:
        if given is source and not done:
            done.append(True)
            stamp_ns = join_stamp(msg.header.stamp) + hours * 3_600_000_000_000
            msg.header.stamp.sec, msg.header.stamp.nanosec = split_stamp(stamp_ns)
        return msg

    published = len(rig.published)
    report = rig.drive(1.0, change)[-1]
    assert report.level is Level.WARN
    assert "1 stray stamps ignored" in report.message
    assert value(report, "stray_stamps") == 1
    assert value(report, "clock_jumps") == 0
    assert 39 <= len(rig.published) - published <= 41
    is_well(rig, 1.0)


def test_no_stamp_at_all(rig: Rig) -> None:
    def change(given: Source, msg: Any) -> Any:
        if given is Source.COMMAND:
            msg.header.stamp.sec = msg.header.stamp.nanosec = 0
        return msg

    report = rig.drive(1.0, change)[-1]
    assert report.level is Level.WARN
    assert "command refused: no time stamp" in report.message
    is_well(rig)


def test_duplicates(model: KoopmanModel) -> None:
    """Each message twice changes no prediction."""
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
    is_well(twice, 1.0)


def swapped(source: Source) -> Callable[[Source, Any], Any]:
    """Return a change that lets each pair of messages of `source` come in the wrong order."""
    kept: list[Any] = []

    def change(given: Source, msg: Any) -> Any:
        if given is not source:
            return msg
        if not kept:
            kept.append(msg)
            return None
        return [msg, kept.pop()]

    return change


def test_out_of_order(rig: Rig) -> None:
    report = rig.drive(3.0, swapped(Source.IMU))[-1]
    assert "readings out of order" in report.message
    assert value(report, "out_of_order") >= 290
    is_well(rig, 1.0)


def test_too_late(rig: Rig) -> None:
    """Odometry 0.3 s behind the others: used for what comes, not for what is gone."""
    held: list[Any] = []

    def change(given: Source, msg: Any) -> Any:
        if given is not Source.ODOMETRY:
            return msg
        held.append(msg)
        return held.pop(0) if len(held) > 15 else None

    report = rig.drive(4.0, change)[-1]
    assert report.level is Level.WARN
    assert "readings too late for their tick" in report.message
    assert value(report, "late") > 50
    is_well(rig)


@pytest.mark.parametrize("jump_s", [-10.0, -2.0, 5.0, 3600.0])
def test_clock_jumps(rig: Rig, jump_s: float) -> None:
    """A bag loops, or time is set: the state starts afresh, and predictions go on."""
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
    # What was learned before the jump is gone: the window holds no more than came since.
    assert getattr(online, "_count") <= 40  # noqa: B009
    is_well(rig, 1.0)


def without(*sources: Source) -> Callable[[Source, Any], Any]:
    return lambda given, msg: None if given in sources else msg


def test_odometry_silent(rig: Rig) -> None:
    reports = rig.drive(5.0, without(Source.ODOMETRY))
    assert reports[0].level is Level.WARN
    assert "coasting for" in reports[0].message
    assert reports[-1].level is Level.ERROR
    assert "no predictions: odometry silent for" in reports[-1].message
    assert value(reports[-1], "ticks_odometry_stale") > 150
    is_well(rig)


def test_command_silent(rig: Rig) -> None:
    published = len(rig.published)
    report = rig.drive(5.0, without(Source.COMMAND))[-1]
    assert report.level is Level.WARN
    assert "command silent for" in report.message
    assert "the last one is held" in report.message
    assert value(report, "ticks_command_stale") > 150
    assert len(rig.published) - published > 195
    is_well(rig)


def test_imu_silent(rig: Rig) -> None:
    published = len(rig.published)
    report = rig.drive(5.0, without(Source.IMU))[-1]
    assert report.level is Level.WARN
    assert "IMU silent for" in report.message
    assert "yaw rate from odometry" in report.message
    assert value(report, "ticks_imu_stale") > 150
    assert len(rig.published) - published > 190
    is_well(rig)


@pytest.mark.parametrize(
    "sources",
    [
        (Source.ODOMETRY, Source.COMMAND),
        (Source.ODOMETRY, Source.IMU),
        (Source.COMMAND, Source.IMU),
        STANDARD_SOURCES,
    ],
)
def test_several_silent(rig: Rig, sources: tuple[Source, ...]) -> None:
    report = rig.drive(8.0, without(*sources))[-1]
    assert report.level is (Level.ERROR if Source.ODOMETRY in sources else Level.WARN)
    for source in sources:
        assert f"{source.name.lower()} silent for" in report.message.lower()
    is_well(rig)


@pytest.mark.parametrize(
    ("missing", "said"),
    [
        ((Source.ODOMETRY,), "odometry never received"),
        ((Source.COMMAND,), "command never received"),
        ((Source.ODOMETRY, Source.COMMAND), "odometry never received, command never received"),
    ],
)
def test_never_there(model: KoopmanModel, missing: tuple[Source, ...], said: str) -> None:
    rig = Rig(model)
    reports = rig.drive(20.0, without(*missing))
    assert reports[0].level is Level.WARN
    assert reports[0].message.startswith("waiting for")
    assert reports[-1].level is Level.ERROR
    assert "no predictions: " + said in reports[-1].message
    assert not rig.published
    is_well(rig)


def test_nothing_ever(model: KoopmanModel) -> None:
    rig = Rig(model)
    report = rig.drive(60.0, without(*STANDARD_SOURCES))[-1]
    assert report.level is Level.WARN
    assert report.message == "waiting for odometry, command"
    is_well(rig)


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
    never = Rig(model, use_imu="never", rates=Rates(imu_hz=0.0))
    assert never.drive(3.0)[-1] == never.reports[-1]
    assert "IMU" not in never.reports[-1].message


def frozen(source: Source) -> Callable[[Source, Any], Any]:
    """Return a change that lets `source` repeat its first message with new stamps."""
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
    is_well(rig)


def test_frozen_imu(rig: Rig) -> None:
    report = rig.drive(4.0, frozen(Source.IMU))[-1]
    assert report.level is Level.WARN
    assert "IMU frozen" in report.message
    is_well(rig)


@pytest.mark.parametrize(
    ("spoiled", "reason"),
    [
        ({"name": ["drive", "wheel"]}, "joint 'steer' is missing"),
        ({"name": ["motor", "steer"]}, "joint 'drive' is missing"),
        ({"name": []}, "joint 'drive' is missing"),
        ({"effort": []}, "joint 'drive' has no effort"),
        ({"position": [0.0]}, "joint 'steer' has no position"),
    ],
)
def test_missing_joint(rig: Rig, spoiled: dict[str, Any], reason: str) -> None:
    def change(given: Source, msg: Any) -> Any:
        if given is Source.COMMAND:
            for name, content in spoiled.items():
                setattr(msg, name, content)
        return msg

    report = rig.drive(3.0, change)[-1]
    assert report.level is Level.WARN
    assert f"command refused: {reason}" in report.message
    is_well(rig)


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
    """Odometry in time since boot beside sensors in Unix time: told as that."""
    rig = Rig(model)

    def change(given: Source, msg: Any) -> Any:
        if given is Source.ODOMETRY:
            stamp_ns = join_stamp(msg.header.stamp) - 1_700_000_000_000_000_000
            msg.header.stamp.sec, msg.header.stamp.nanosec = split_stamp(stamp_ns)
        return msg

    report = rig.drive(8.0, change)[-1]
    assert report.level is Level.ERROR
    assert "odometry has stamps of another time than the other streams" in report.message
    assert "stray stamps ignored" in report.message


def test_imu_in_g(model: KoopmanModel) -> None:
    rig = Rig(model)

    def change(given: Source, msg: Any) -> Any:
        if given is Source.IMU:
            force = msg.linear_acceleration
            force.x, force.y, force.z = force.x / 9.81, force.y / 9.81, force.z / 9.81
        return msg

    report = rig.drive(30.0, change)[-1]
    assert report.level is Level.WARN
    assert "it looks like g, the topic must carry m/s^2" in report.message
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
    ("after", "said"),
    [
        (Rates(imu_hz=100.0), "imu now comes at 100 Hz, before at 200 Hz"),
        (Rates(odometry_hz=10.0), "odometry now comes at"),
        (Rates(imu_hz=1000.0), "imu now comes at"),
    ],
)
def test_rate_changes(rig: Rig, after: Rates, said: str) -> None:
    published = len(rig.published)
    rig.rates = after
    reports = rig.drive(10.0)
    assert any(said in report.message for report in reports)
    assert all(report.level is Level.OK for report in reports)
    assert len(rig.published) - published >= 397
    rates = [value(reports[-1], f"{source.name.lower()}.rate_hz") for source in STANDARD_SOURCES]
    np.testing.assert_allclose(rates, after, rtol=0.03)


def test_sim_time_starts_late(model: KoopmanModel) -> None:
    """Predictions hang on stamps alone; that the clock is missing is said."""
    rig = Rig(model)
    rig.sim_time = (True, False)
    report = rig.drive(3.0)[-1]
    assert report.level is Level.WARN
    assert "sim time has not started: no /clock" in report.message
    assert rig.published
    rig.sim_time = (True, True)
    is_well(rig, 1.0)


def test_internal_error(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    """A fault in the program resets the state, is told once and counted each time."""
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
    assert [type(error) for error in rig.told] == [ZeroDivisionError]
    is_well(rig, 1.0)


def test_a_publisher_that_fails_does_not_end_the_node(rig: Rig) -> None:
    def fail(_prediction: Any) -> None:
        raise RuntimeError("context is not valid")

    rig.core._publish, kept = fail, rig.core._publish
    assert rig.drive(1.0)[-1].level is Level.ERROR
    rig.core._publish = kept
    is_well(rig, 1.0)


@pytest.mark.parametrize("name", ["x", "covariance", "horizon"])
@pytest.mark.parametrize("number", [math.nan, math.inf])
def test_not_finite_is_withheld(
    rig: Rig, monkeypatch: pytest.MonkeyPatch, name: str, number: float
) -> None:
    """The last line of defence, with a predictor that does what it must not."""
    step = rig.pipeline.predictor.step

    def broken(sample: Any) -> Any:
        prediction = step(sample)
        spoiled = np.array(getattr(prediction, name))
        spoiled.flat[-1] = number
        return prediction._replace(**{name: spoiled})

    published = len(rig.published)
    monkeypatch.setattr(rig.pipeline.predictor, "step", broken)
    report = rig.drive(1.0)[-1]
    assert len(rig.published) == published
    assert report.level is Level.ERROR
    assert "predictions withheld: not finite" in report.message
    assert value(report, "predictions_withheld") >= 39
    monkeypatch.undo()
    is_well(rig, 1.0)


def test_online_method_that_fails(model: KoopmanModel) -> None:
    rig = Rig(model)
    rig.drive(2.0)
    rig.pipeline.predictor.online.failures += 3
    report = rig.drive(1.0)[-1]
    assert report.level is Level.WARN
    assert "online method set back 3 times" in report.message
    is_well(rig, 1.0)


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
    is_well(rig, 1.0)


def test_stall_is_counted_and_does_not_move_the_grid(rig: Rig) -> None:
    """After a stall the clock is ahead of the messages that wait: these come first."""
    ticks, missed = rig.pipeline.ticks, rig.core.counters.missed_deadlines
    rig.mono_ns += 110_000_000
    rig.core.on_timer(rig.stamp_ns)
    assert rig.pipeline.ticks == ticks
    assert rig.core.counters.missed_deadlines == missed + 3
    # Idle from here on: the clock may complete ticks, after a call that was in time.
    rig.mono_ns += TICK_NS
    rig.core.on_timer(rig.stamp_ns)
    assert rig.pipeline.ticks > ticks


def test_waiting_without_sensors_misses_no_deadline(model: KoopmanModel) -> None:
    rig = Rig(model)
    for _ in range(5):
        rig.mono_ns += 10 * TICK_NS
        rig.core.on_timer(rig.stamp_ns)
    assert rig.core.counters.missed_deadlines == 0


@pytest.mark.parametrize("rates", [Rates(0.0, 10.0, 5.0), Rates(50.0, 10.0, 5.0)])
def test_slow_streams_go_on_by_the_clock(
    model: KoopmanModel, rates: Rates, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Between readings 100 ms apart samples still come every 25 ms, the same as by data alone."""
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
    # Before the second command its period is not known, and the clock shows it as stale sooner.
    known = sorted(by_data)[40:]
    assert len(known) > 340
    for stamp_ns in known:
        assert repr(by_clock[stamp_ns]) == repr(by_data[stamp_ns])


def test_reset_on_request(rig: Rig) -> None:
    rig.core.reset()
    report = rig.drive(1.0)[-1]
    assert report.level is Level.OK
    assert "reset on request" in report.message
    assert value(report, "resets_on_request") == 1
    is_well(rig, 1.0)


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


def test_steering_ratio_and_reference_point_reach_the_pipeline(model: KoopmanModel) -> None:
    settings = PipelineSettings(horizon_steps=0)
    rig = Rig(model, settings)
    rig.drive(2.0)
    assert rig.published
    assert rig.published[-1].horizon.shape == (0, 3)
