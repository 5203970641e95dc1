# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Single wrong readings are rejected, new levels and more noise are accepted after a few."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from adk_ros.errors import UsageError
from adk_ros.signals.channels import TICK_NS, Reading, Source
from adk_ros.signals.gate import GateSettings, ReadingGate

ERRORS = np.full(3, 0.02**2)
CHANGE = np.array([0.03, 0.01, 0.01])
STATE, AHEAD = np.array([10.0, 0.2, 0.3]), np.array([10.1, 0.2, 0.3])
NONE = np.zeros(3)
NOISE = 0.02


def odometry(step: int, *values: float, variances: tuple[float, ...] | None = None) -> Reading:
    return Reading(Source.ODOMETRY, step * TICK_NS, values, variances)


def trained(settings: GateSettings | None = None, seed: int = 0) -> ReadingGate:
    """A gate that has seen a hundred readings with noise."""
    gate = ReadingGate(CHANGE, ERRORS, settings)
    rng = np.random.default_rng(seed)
    for k in range(100):
        gate.expect(k * TICK_NS, STATE, STATE, NONE)
        values = STATE + rng.normal(0.0, NOISE, 3)
        assert gate.accepts(odometry(k, *values))
        force = rng.normal(0.0, 0.3, 2) + np.array([-0.06, 3.0])
        imu = (float(force[0]), float(force[1]), float(values[2]))
        # The noise of the forces is not known at first.
        assert gate.accepts(Reading(Source.IMU, k * TICK_NS, imu)) or k < 20
    gate.expect(100 * TICK_NS, STATE, STATE, NONE)
    return gate


def bound(channel: int, variance: float = 0.0) -> float:
    """Bound on a deviation at p = 1e-6, about; 4.892 is the normal quantile."""
    return 4.892 * math.sqrt(NOISE**2 + CHANGE[channel] ** 2 + variance)


@pytest.mark.parametrize("channel", [0, 1, 2])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_reading_is_rejected_beyond_its_bound_only(channel: int, sign: float) -> None:
    for factor, accepted in ((0.7, True), (1.4, False)):
        values = STATE.copy()
        values[channel] += sign * factor * bound(channel)
        gate = trained()
        assert gate.accepts(odometry(100, *values)) is accepted
        assert gate.rejected[Source.ODOMETRY] == (not accepted)


def test_a_rejection_names_channel_value_and_bound() -> None:
    gate = trained()
    assert not gate.accepts(odometry(100, 37.82, 0.2, 0.3))
    latest = gate.latest[Source.ODOMETRY]
    assert (latest.channel, latest.value) == ("v_x", 37.82)
    assert latest.expected == pytest.approx(10.0)
    assert latest.bound == pytest.approx(bound(0), rel=0.2)
    assert str(latest).startswith("v_x 37.82 m/s, expected 10 ± 0.1")


def test_an_imu_is_compared_with_the_predicted_force() -> None:
    gate = trained()
    assert not gate.accepts(Reading(Source.IMU, 100 * TICK_NS, (40.0, 3.0, 0.3)))
    assert gate.latest[Source.IMU].channel == "a_x"
    assert not gate.accepts(Reading(Source.IMU, 100 * TICK_NS, (-0.06, -30.0, 0.3)))
    assert gate.latest[Source.IMU].channel == "a_y"
    assert gate.latest[Source.IMU].expected == pytest.approx(3.0)
    # Without an accelerometer the gyro is tested.
    assert gate.accepts(Reading(Source.IMU, 100 * TICK_NS, (math.nan, math.nan, 0.3)))
    assert not gate.accepts(Reading(Source.IMU, 100 * TICK_NS, (math.nan, math.nan, 2.0)))


def test_the_expectation_follows_the_prediction_between_ticks() -> None:
    gate = trained()
    gate.expect(100 * TICK_NS, STATE, STATE + np.array([4.0, 0.0, 0.0]), NONE)
    half = Reading(Source.ODOMETRY, 100 * TICK_NS + TICK_NS // 2, (12.0, 0.2, 0.3))
    assert gate.accepts(half)
    assert not gate.accepts(odometry(101, 12.0, 0.2, 0.3))
    assert gate.accepts(odometry(101, 14.0, 0.2, 0.3))


def test_nothing_is_rejected_without_a_prediction() -> None:
    gate = ReadingGate(CHANGE, ERRORS)
    assert gate.accepts(odometry(0, 99.0, 0.0, 0.0))
    gate.expect(0, STATE, STATE, NONE)
    assert not gate.accepts(odometry(0, 99.0, 0.0, 0.0))
    gate = trained()
    gate.forget()
    assert gate.accepts(odometry(100, 99.0, 0.0, 0.0))


def test_an_uncertain_prediction_widens_the_bound() -> None:
    values = STATE + np.array([2.0 * bound(0), 0.0, 0.0])
    gate = trained()
    assert not gate.accepts(odometry(100, *values))
    gate.expect(100 * TICK_NS, STATE, STATE, np.array([0.5, 0.0, 0.0]))
    assert gate.accepts(odometry(100, *values))


def test_a_message_that_reports_more_variance_is_allowed_more() -> None:
    gate = trained()
    usual = (NOISE**2,) * 3
    for k in range(100, 400):
        gate.expect(k * TICK_NS, STATE, STATE, NONE)
        assert gate.accepts(odometry(k, *STATE, variances=usual))
    values = STATE + np.array([1.0, 0.0, 0.0])
    assert not gate.accepts(odometry(400, *values, variances=usual))
    assert gate.accepts(odometry(400, *values, variances=(0.25, 0.25, 0.25)))


def test_a_new_level_is_accepted_after_consistent_readings() -> None:
    gate = trained(GateSettings(confirmations=4))
    decisions = [gate.accepts(odometry(100, 13.0 + 0.01 * i, 0.2, 0.3)) for i in range(6)]
    assert decisions == [False, False, False, True, True, True]
    assert gate.level_changes == {Source.ODOMETRY: 1}
    assert gate.level_changed
    gate.expect(101 * TICK_NS, STATE, STATE, NONE)
    assert not gate.level_changed


def test_an_offset_of_the_force_is_accepted_once() -> None:
    """As of an IMU that is mounted with a roll of 15 degrees: no prediction takes it over."""
    gate = trained()
    rng = np.random.default_rng(3)
    rejected = []
    for k in range(100, 300):
        gate.expect(k * TICK_NS, STATE, STATE, NONE)
        values = (-0.06 + rng.normal(0.0, 0.3), 3.0 + 12.0 + rng.normal(0.0, 0.3), 0.3)
        if not gate.accepts(Reading(Source.IMU, k * TICK_NS, values)):
            rejected.append(k)
    assert rejected == [100, 101, 102, 103]
    assert gate.level_changes[Source.IMU] == 1
    # What contradicts the offset is rejected, and its end is accepted as well.
    assert not gate.accepts(Reading(Source.IMU, 299 * TICK_NS, (-0.06, 3.0, 0.3)))
    for k in range(300, 310):
        gate.expect(k * TICK_NS, STATE, STATE, NONE)
        gate.accepts(Reading(Source.IMU, k * TICK_NS, (-0.06, 3.0, 0.3)))
    assert gate.level_changes[Source.IMU] == 2
    assert gate.accepts(Reading(Source.IMU, 309 * TICK_NS, (-0.06, 3.0, 0.3)))


def test_an_offset_of_the_force_follows_its_cause() -> None:
    """A bank that the car leaves over three seconds must not widen the bound for good."""
    gate = trained()
    rng = np.random.default_rng(4)
    for k in range(100, 1300):
        gate.expect(k * TICK_NS, STATE, STATE, NONE)
        bank = 12.0 * min(max((300 - k) / 120.0, 0.0), 1.0)
        values = (-0.06 + rng.normal(0.0, 0.3), 3.0 + bank + rng.normal(0.0, 0.3), 0.3)
        gate.accepts(Reading(Source.IMU, k * TICK_NS, values))
    gate.expect(1300 * TICK_NS, STATE, STATE, NONE)
    assert not gate.accepts(Reading(Source.IMU, 1300 * TICK_NS, (-0.06, 3.0 + 8.0, 0.3)))
    assert gate.latest[Source.IMU].expected == pytest.approx(3.0, abs=0.3)


def test_two_publishers_do_not_add_up_to_a_new_level() -> None:
    gate = trained()
    for k in range(100, 2000):
        gate.expect(k * TICK_NS, STATE, STATE, NONE)
        assert gate.accepts(odometry(k, *STATE))
        assert not gate.accepts(odometry(k, 0.0, 0.0, 0.0))
    assert gate.rejected[Source.ODOMETRY] == 1900
    assert not gate.level_changes


def test_more_noise_is_adopted() -> None:
    gate, rng = trained(), np.random.default_rng(1)
    accepted = []
    for k in range(100, 600):
        gate.expect(k * TICK_NS, STATE, STATE, NONE)
        accepted.append(gate.accepts(odometry(k, *(STATE + rng.normal(0.0, 50 * NOISE, 3)))))
    assert gate.noise_changes[Source.ODOMETRY] >= 1
    assert np.mean(accepted[-200:]) > 0.98


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: GateSettings(false_rejection=0.5), "gate_false_rejection is 0.5: choose 0 to"),
        (lambda: GateSettings(confirmations=1), "gate_confirmations is 1: choose 2 to"),
    ],
)
def test_settings_out_of_range(make: Callable[[], GateSettings], text: str) -> None:
    with pytest.raises(UsageError, match=text):
        make()


def test_a_gate_can_be_switched_off() -> None:
    gate = trained(GateSettings(false_rejection=0.0))
    assert gate.accepts(odometry(100, 1e9, 0.0, 0.0))


def test_late_readings_in_hard_braking_are_accepted() -> None:
    """Readings of 0.2 s ago, 1 m/s faster: the line is followed two ticks back only."""
    gate, braking = trained(), np.array([-0.125, 0.0, 0.0])
    for k in range(100, 140):
        state = STATE + (k - 100) * braking
        gate.expect(k * TICK_NS, state, state + braking, NONE)
        assert gate.accepts(odometry(k - 8, *(state - 8.0 * braking)))
        # What the change does not explain is rejected, late or not.
        assert not gate.accepts(odometry(k - 8, *(state + np.array([2.0, 0.0, 0.0]))))
        assert gate.accepts(odometry(k, *state))


def test_one_reading_after_a_pause_does_not_replace_what_was_learned() -> None:
    gate, off = trained(), np.array([bound(0), 0.0, 0.0])
    gate.expect(300 * TICK_NS, STATE, STATE, NONE)
    assert gate.accepts(odometry(300, *(STATE + 0.8 * off)))
    # With a mean square of that one reading, four times the bound would pass.
    gate.expect(301 * TICK_NS, STATE, STATE, NONE)
    assert not gate.accepts(odometry(301, *(STATE + 2.0 * off)))
