# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages in, predictions out: one object for the node, the replay and the bench."""

import math
from types import SimpleNamespace as Message
from typing import Any

import numpy as np
import pytest
from helpers.model import make_model
from helpers.signals import START_NS, arriving, drive, in_order, state

from adk_ros.errors import UsageError
from adk_ros.model.adaptation.online_methods import OnlineSettings
from adk_ros.model.pipeline import Pipeline, PipelineSettings
from adk_ros.model.prediction import Prediction, Status
from adk_ros.model.predictor import Predictor
from adk_ros.signals.align import Aligner
from adk_ros.signals.channels import TICK_NS, Flag, Reading, Source
from adk_ros.signals.decode import SensorConfig

S = 1_000_000_000


def message(reading: Reading, **changes: float) -> Message:
    """The message that decodes to `reading`."""
    header = Message(stamp=Message(sec=reading.stamp_ns // S, nanosec=reading.stamp_ns % S))
    values = list(reading.values)
    if reading.source is Source.COMMAND:
        torque, delta = values
        return Message(
            header=header, name=["drive", "steer"], position=[0.0, delta], effort=[torque, 0.0]
        )  # fmt: skip
    if reading.source is Source.ODOMETRY:
        twist = Message(
            linear=Message(x=values[0], y=values[1], z=0.0), angular=Message(x=0, y=0, z=values[2])
        )  # fmt: skip
        return Message(header=header, twist=Message(twist=twist, covariance=[0.0] * 36))
    return Message(
        header=header,
        linear_acceleration=Message(x=values[0], y=values[1], z=9.8),
        angular_velocity=Message(x=0.0, y=0.0, z=values[2]),
        linear_acceleration_covariance=[0.0] * 9,
        angular_velocity_covariance=[0.0] * 9,
    )


def run(pipeline: Pipeline, readings: list[Reading]) -> list[Prediction]:
    return [p for r in readings for p in pipeline.take(r.source, message(r))]


def assert_same(one: list[Prediction], other: list[Prediction]) -> None:
    assert len(one) == len(other) > 0
    for a, b in zip(one, other, strict=True):
        assert (a.origin_ns, a.stamp_ns, a.status) == (b.origin_ns, b.stamp_ns, b.status)
        np.testing.assert_array_equal(a.horizon, b.horizon)
        np.testing.assert_array_equal(a.covariance, b.covariance)
        np.testing.assert_array_equal(a.innovation, b.innovation)


def test_messages_to_predictions() -> None:
    pipeline = Pipeline(make_model())
    readings = in_order(drive(5.0, noise=1e-3))
    made = run(pipeline, readings)
    assert pipeline.received == {Source.IMU: 1000, Source.ODOMETRY: 250, Source.COMMAND: 200}
    assert pipeline.ticks == len(made) + 2
    assert pipeline.restarts == 1
    assert pipeline.last_prediction is made[-1]
    assert pipeline.last_sample is not None
    assert pipeline.last_sample.stamp_ns == made[-1].origin_ns
    assert [p.stamp_ns - p.origin_ns for p in made] == [TICK_NS] * len(made)
    assert set(np.diff([p.origin_ns for p in made])) == {TICK_NS}
    assert all(p.horizon.shape == (80, 3) for p in made)
    # A random model, but it has a disturbance and adapts: a tick ahead it cannot be far off.
    wrong = [p.x - state((p.stamp_ns - START_NS) * 1e-9) for p in made[80:]]
    assert np.abs(wrong).max() < 0.1
    assert not pipeline.decoder.refused
    assert not pipeline.aligner.counts


def test_pipeline_equals_decode_align_and_step() -> None:
    readings = arriving(drive(4.0, noise=1e-3), 1, 0.01)
    model = make_model()
    aligner = Aligner()
    predictor = Predictor(model, None, 80, max_coast_steps=40, withhold_implausible=True)
    samples = [s for r in readings for s in aligner.push(r)]
    by_hand = [p for s in samples if (p := predictor.step(s)) is not None]
    assert_same(run(Pipeline(model), readings), by_hand)


def test_order_of_arrival_does_not_matter() -> None:
    """What a live node hears and what its bag holds: other interleaving, the same predictions."""
    streams = drive(4.0, noise=1e-3, jitter=0.05)
    first = run(Pipeline(make_model()), in_order(streams))
    second = run(Pipeline(make_model()), arriving(streams, 2, 0.02))
    count = min(len(first), len(second))
    assert count > 150
    assert_same(first[:count], second[:count])


def test_readings_decoded_already() -> None:
    readings = in_order(drive(2.0))
    pipeline = Pipeline(make_model())
    made = [p for r in readings for p in pipeline.take_reading(r)]
    assert_same(made, run(Pipeline(make_model()), readings))


def spoilt(readings: list[Reading]) -> list[tuple[Source, Any]]:
    """Every tenth message with a fault of its own."""
    result: list[tuple[Source, Any]] = []
    for k, reading in enumerate(readings):
        msg: Any = message(reading)
        if k % 10 == 9:
            kind = (k // 10) % 5
            if kind == 0:
                msg.header.stamp.sec += 3600
            elif kind == 1:
                msg.header.stamp = Message(sec=0, nanosec=0)
            elif kind == 2:
                msg = None
            elif kind == 3 and reading.source is Source.IMU:
                msg.angular_velocity.z = math.nan
            elif kind == 4:
                result.append((reading.source, msg))
        result.append((reading.source, msg))
    return result


def test_faulty_messages_are_counted_and_ignored() -> None:
    readings = in_order(drive(5.0, noise=1e-3))
    messages = spoilt(readings)
    pipeline = Pipeline(make_model())
    made = [p for source, msg in messages for p in pipeline.take(source, msg)]
    assert pipeline.received.total() == len(messages)
    refused = pipeline.decoder.refused
    assert {reason for _, reason in refused} == {
        "no time stamp", "not the expected message type (NoneType)",
        "yaw rate is not finite or above 1146 rad/s",
    }  # fmt: skip
    assert refused.total() > 70
    assert set(pipeline.aligner.counts) == {"stray stamp", "duplicate"}
    assert pipeline.restarts == 1
    assert len(made) > 180
    assert all(np.isfinite(p.horizon).all() for p in made)
    plain = {p.origin_ns: p for p in run(Pipeline(make_model()), readings)}
    off = [np.abs(p.x - plain[p.origin_ns].x).max() for p in made if p.origin_ns in plain]
    assert len(off) == len(made)
    assert np.median(off) < 0.02


def test_clock_that_jumps_back() -> None:
    pipeline = Pipeline(make_model())
    readings = in_order(drive(3.0, noise=1e-3))
    first, second = run(pipeline, readings), run(pipeline, readings)
    assert_same(first, second)
    assert pipeline.restarts == 2
    assert pipeline.aligner.counts == {"clock jump": 1}


def test_reset_keeps_the_counts() -> None:
    pipeline = Pipeline(make_model())
    readings = in_order(drive(3.0, noise=1e-3))
    first = run(pipeline, readings)
    pipeline.take(Source.IMU, None)
    pipeline.reset()
    assert pipeline.predictor.status is Status.WARMING_UP
    assert pipeline.aligner.newest_ns is None
    assert_same(first, run(pipeline, readings))
    assert pipeline.restarts == 2
    assert pipeline.received.total() == 2 * len(readings) + 1
    assert pipeline.decoder.refused.total() == 1


def test_clock_moves_the_grid_where_streams_are_too_slow_to() -> None:
    pipeline = Pipeline(make_model())
    readings = in_order(drive(3.0, 0, 10, 10))
    run(pipeline, readings)
    before = pipeline.ticks
    newest_ns = pipeline.aligner.newest_ns
    assert newest_ns is not None
    made = list(pipeline.each_until(newest_ns + 90_000_000))
    assert len(made) == pipeline.ticks - before >= 2
    assert list(pipeline.each_until(newest_ns + 5 * S)) == []


def test_settings_reach_their_places() -> None:
    settings = PipelineSettings(
        sensors=SensorConfig(reference_point=(1.4, 0.0)),
        online=OnlineSettings("rls"),
        horizon_steps=7,
        odometry_timeout_s=0.2,
        frozen_after_s=0.3,
        max_wait_s=0.01,
        max_coast_s=0.5,
    )
    pipeline = Pipeline(make_model(), settings)
    assert pipeline.settings is settings
    assert pipeline.predictor.settings.method == "rls"
    assert pipeline.predictor.max_coast_steps == 20
    readings = in_order(drive(4.0))
    silent_ns = START_NS + 2 * S
    kept = [r for r in readings if r.source is not Source.ODOMETRY or r.stamp_ns < silent_ns]
    made = run(pipeline, kept)
    assert {p.horizon.shape for p in made} == {(7, 3)}
    # 0.2 s by dead reckoning, then half a second from itself, then nothing more.
    last_s = (made[-1].origin_ns - START_NS) * 1e-9
    assert last_s == pytest.approx(2.0 + 0.2 + 0.5, abs=0.05)
    assert [p.status for p in made].count(Status.COASTING) == 20
    assert pipeline.last_sample is not None
    assert pipeline.last_sample.flags & Flag.COASTING
    v_y, rate = made[60].x[1], made[60].x[2]
    plain = run(Pipeline(make_model(), PipelineSettings(horizon_steps=7)), kept)[60]
    assert v_y - plain.x[1] == pytest.approx(1.4 * rate, abs=0.05)


@pytest.mark.parametrize("max_wait_s", [0.0, 0.02, 0.05])
def test_how_long_a_tick_waits(max_wait_s: float) -> None:
    """For odometry that has fallen silent, by the stamps of the others."""
    pipeline = Pipeline(make_model(), PipelineSettings(max_wait_s=max_wait_s, horizon_steps=0))
    waits = []
    for reading in in_order(drive(4.0)):
        if reading.source is Source.ODOMETRY and reading.stamp_ns > START_NS + 2 * S:
            continue
        for made in pipeline.take_reading(reading):
            waits.append((reading.stamp_ns - made.origin_ns) * 1e-9)
    assert max_wait_s <= max(waits) <= max_wait_s + 0.006


def test_plausibility_is_watched() -> None:
    pipeline = Pipeline(make_model())
    readings = in_order(drive(20.0, noise=1e-3))
    run(pipeline, readings)
    assert pipeline.plausibility.warnings() == []
    pipeline.reset()
    flipped = [
        r._replace(values=(*r.values[:2], -r.values[2])) if r.source is Source.IMU else r
        for r in readings
    ]  # fmt: skip
    run(pipeline, flipped)
    assert "opposite sign" in pipeline.plausibility.warnings()[0]


def test_a_recording_without_commands_is_predicted_with_zeros() -> None:
    readings = [r for r in in_order(drive(20.0)) if r.source is not Source.COMMAND]
    without = Pipeline(make_model(), PipelineSettings(has_command=False))
    predictions = run(without, readings)
    zeros = Pipeline(make_model())
    given = []
    for reading in readings:
        given.append(reading)
        if reading.source is Source.ODOMETRY:
            given.append(Reading(Source.COMMAND, reading.stamp_ns, (0.0, 0.0)))
    assert_same(predictions, run(zeros, given))
    assert without.plausibility.warnings() == []
    assert len(zeros.plausibility.warnings()) == 2
    assert run(Pipeline(make_model()), readings) == []


def test_a_constant_torque_is_reported() -> None:
    pipeline = Pipeline(make_model())
    readings = in_order(drive(20.0))
    run(
        pipeline,
        [
            r._replace(values=(0.0, r.values[1])) if r.source is Source.COMMAND else r
            for r in readings
        ],
    )
    (text,) = pipeline.plausibility.warnings()
    assert text.startswith("the command's torque is 0 throughout while v_x varies by")


def test_a_horizon_out_of_range() -> None:
    with pytest.raises(UsageError, match="horizon is 500 steps"):
        Pipeline(make_model(), PipelineSettings(horizon_steps=500))
