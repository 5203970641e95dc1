# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One wrong reading in a real stream of messages does not spoil what follows."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from helpers.train import small

from adk_ros.api.replay import _rejections
from adk_ros.bags import Bag
from adk_ros.bags.recording import RecordingOptions, choose_topics, selected_messages
from adk_ros.model import artefact
from adk_ros.model.pipeline import Pipeline, PipelineSettings
from adk_ros.model.prediction import Prediction
from adk_ros.signals.channels import TICK_NS, Reading, Source
from adk_ros.signals.decode import Decoder, RefusedMessage

TOWN = Path(__file__).parents[2] / "bags" / "town"
LENGTH_S, AT_S = 22.0, (11.0, 14.3, 17.7)
RECOVERED_TICKS = 10


@lru_cache
def readings() -> list[Reading]:
    decoder, found = Decoder(), []
    with Bag(TOWN) as bag:
        for source, _, msg in selected_messages(bag, choose_topics(bag, RecordingOptions())):
            try:
                found.append(decoder.decode(source, msg))
            except RefusedMessage:
                continue
            if found[-1].stamp_ns - found[0].stamp_ns > LENGTH_S * 1e9:
                break
    return found


def run(items: list[Reading]) -> tuple[dict[int, Prediction], Pipeline]:
    pipeline = Pipeline(artefact.load(small().path).model, PipelineSettings())
    made = {p.origin_ns: p for item in items for p in pipeline.take_reading(item)}
    return made, pipeline


@lru_cache
def undisturbed() -> tuple[dict[int, Prediction], Pipeline]:
    return run(readings())


def index_at(source: Source, time_s: float) -> int:
    begin_ns = readings()[0].stamp_ns
    return next(
        i
        for i, r in enumerate(readings())
        if r.source is source and (r.stamp_ns - begin_ns) * 1e-9 > time_s
    )


def glitched(source: Source, channel: int, size: float, time_s: float) -> list[Reading]:
    items = list(readings())
    i = index_at(source, time_s)
    values = list(items[i].values)
    values[channel] += size
    items[i] = items[i]._replace(values=tuple(values))
    return items[: i + 1200]


def test_nothing_is_rejected_on_a_good_drive() -> None:
    _, pipeline = undisturbed()
    assert not pipeline.gate.rejected
    assert not pipeline.gate.level_changes
    assert not pipeline.gate.noise_changes
    assert pipeline.predictor.implausible == 0


@pytest.mark.parametrize(
    ("source", "channel", "size"),
    [
        (Source.ODOMETRY, 0, 0.1), (Source.ODOMETRY, 0, 0.3), (Source.ODOMETRY, 0, 1.0),
        (Source.ODOMETRY, 0, 3.0), (Source.ODOMETRY, 0, -10.0), (Source.ODOMETRY, 0, 30.0),
        (Source.ODOMETRY, 1, 0.5), (Source.ODOMETRY, 1, -5.0), (Source.IMU, 2, 0.1),
        (Source.IMU, 2, 3.0), (Source.IMU, 0, 5.0), (Source.IMU, 0, -50.0), (Source.IMU, 1, 50.0),
    ],
)  # fmt: skip
def test_the_horizon_recovers_from_a_single_glitch(
    source: Source, channel: int, size: float
) -> None:
    """Within ten ticks it is within two standard deviations of the undisturbed one."""
    usual, _ = undisturbed()
    for time_s in AT_S:
        begin_ns = readings()[index_at(source, time_s)].stamp_ns
        made, _ = run(glitched(source, channel, size, time_s))
        for origin_ns, prediction in made.items():
            if origin_ns <= begin_ns + RECOVERED_TICKS * TICK_NS:
                continue
            other = usual[origin_ns]
            deviation = np.sqrt(np.einsum("hii->hi", other.horizon_covariance))
            assert (np.abs(prediction.horizon - other.horizon) < 2.0 * deviation).all()
        assert max(made) > begin_ns + 40 * TICK_NS
        assert len([t for t in made if t > begin_ns]) >= 40


def test_a_glitch_is_named_and_the_covariance_grows() -> None:
    made, pipeline = run(glitched(Source.ODOMETRY, 0, 30.0, AT_S[0]))
    usual, _ = undisturbed()
    assert pipeline.gate.rejected == {Source.ODOMETRY: 1}
    latest = pipeline.gate.latest[Source.ODOMETRY]
    assert latest.channel == "v_x"
    assert latest.value - latest.expected == pytest.approx(30.0, abs=0.3)
    (line,) = _rejections(pipeline)
    assert line.startswith(
        "1 odometry readings contradict the prediction and are left out, the last"
    )
    assert _rejections(undisturbed()[1]) == []
    at_ns = -(-latest.stamp_ns // TICK_NS) * TICK_NS
    assert made[at_ns].covariance[0, 0] > usual[at_ns].covariance[0, 0]
    horizons = [found[at_ns].horizon_covariance[:, 0, 0].mean() for found in (made, usual)]
    assert horizons[0] > horizons[1]


def with_second_publisher(from_s: float) -> list[Reading]:
    """Between all odometry readings from a time on, another one that reads zero."""
    begin_ns = readings()[0].stamp_ns + round(from_s * 1e9)
    items = []
    for item in readings():
        items.append(item)
        if item.source is Source.ODOMETRY and item.stamp_ns > begin_ns:
            items.append(Reading(Source.ODOMETRY, item.stamp_ns + 7_000_000, (0.0, 0.0, 0.0)))
    return items


def test_a_second_publisher_does_not_move_the_prediction() -> None:
    usual, _ = undisturbed()
    made, pipeline = run(with_second_publisher(3.0))
    late = [t for t in made if t > readings()[0].stamp_ns + 5 * 10**9]
    assert len(late) > 600
    error = np.array([made[t].x - usual[t].x for t in late])
    speed = np.array([usual[t].x[0] for t in late])
    assert np.abs(error[speed > 3.0]).max() < 1.0
    assert pipeline.gate.rejected[Source.ODOMETRY] > 500


def test_two_publishers_from_the_start_lead_to_nothing_absurd() -> None:
    """Nobody can know which of them is right."""
    made, pipeline = run(with_second_publisher(0.0))
    assert len(made) > 600
    speeds = np.array([item.horizon[:, 0] for item in made.values()])
    assert speeds.max() < 60.0
    assert speeds.min() > -20.0
    assert pipeline.gate.rejected[Source.ODOMETRY] > 300


def test_a_new_level_of_a_sensor_is_followed() -> None:
    """An odometry that reads 1 m/s more from a time on: the prediction follows, without a jolt."""
    items = list(readings())
    first = index_at(Source.ODOMETRY, AT_S[0])
    for i, item in enumerate(items[first:], first):
        if item.source is Source.ODOMETRY:
            items[i] = item._replace(values=(item.values[0] + 1.0, *item.values[1:]))
    made, pipeline = run(items)
    usual, _ = undisturbed()
    assert pipeline.gate.level_changes[Source.ODOMETRY] == 1
    after = [t for t in made if t > items[first].stamp_ns + 12 * TICK_NS]
    moved = np.array([made[t].x[0] - usual[t].x[0] for t in after])
    np.testing.assert_allclose(moved, 1.0, atol=0.3)
