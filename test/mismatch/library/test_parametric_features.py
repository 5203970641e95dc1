# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Features with a memory, a threshold or an oscillation: values, names, files."""

from __future__ import annotations

import numpy as np
import pytest

from adk_ros.mismatch.library.features import feature, feature_matrix
from adk_ros.mismatch.library.parametric_features import (
    decay_name,
    drift_name,
    excess_name,
    gate_name,
    has_memory,
    has_unlimited_memory,
    heat_name,
    hysteresis_name,
    is_transferable,
    lag_name,
    pulsation_name,
    resonance_name,
    ripple_name,
    scaled,
    searched_parameters,
    sizes_of,
    speed_wave_name,
    wave_name,
)
from adk_ros.numerics.arrays import FloatArray

STEP = 0.01
TIME = STEP * np.arange(6000)


def signals(**values: FloatArray) -> dict[str, FloatArray]:
    zero = np.zeros_like(TIME)
    names = ("v_x", "v_y", "yaw_rate", "a_x", "a_y", "torque", "delta")
    return {"time": TIME, **dict.fromkeys(names, zero), **values}


def amplitude(values: FloatArray, frequency: float) -> float:
    """Amplitude of the second half at a frequency, Hz."""
    half = values[values.size // 2 :]
    wave = np.exp(-2j * np.pi * frequency * TIME[: half.size])
    return float(2.0 * np.abs(np.mean(half * wave)))


@pytest.mark.parametrize("frequency", [0.2, 0.5, 1.0])
def test_a_resonance_has_the_transmissibility_of_a_mass_on_a_spring(frequency: float) -> None:
    natural, damping = 0.5, 0.1
    a_y = np.sin(2.0 * np.pi * frequency * TIME)
    out = feature(resonance_name("a_y", natural, damping)).function(signals(a_y=a_y))
    ratio = frequency / natural
    friction = 2.0 * damping * ratio
    expected = np.hypot(1.0, friction) / np.hypot(1.0 - ratio**2, friction)
    assert amplitude(out, frequency) == pytest.approx(expected, rel=0.05)


def test_a_resonance_passes_a_constant() -> None:
    out = feature(resonance_name("a_x", 1.0, 0.2)).function(signals(a_x=np.full_like(TIME, 2.0)))
    np.testing.assert_allclose(out, 2.0, atol=1e-9)


def test_a_lag_reaches_63_percent_in_its_time_constant() -> None:
    torque = np.where(TIME < 10.0, 0.0, 100.0)
    out = feature(lag_name("torque", 2.0)).function(signals(torque=torque))
    assert out[999] == 0.0
    assert out[1200] == pytest.approx(100.0 * (1.0 - np.exp(-1.0)), rel=0.01)


def test_a_gate_passes_a_feature_where_its_condition_holds() -> None:
    a_y = 5.0 * np.sin(TIME)
    given = signals(a_y=a_y, torque=np.full_like(TIME, 300.0))
    out = feature(gate_name("torque", "lateral_size", True, 3.4)).function(given)
    np.testing.assert_array_equal(out, np.where(np.abs(a_y) > 3.4, 300.0, 0.0))
    below = feature(gate_name("torque", "lateral_size", False, 3.4)).function(given)
    np.testing.assert_array_equal(out + below, given["torque"])


def test_a_wave_oscillates_in_time_where_its_condition_holds() -> None:
    speed = 20.0 + 5.0 * np.sin(0.1 * TIME)
    out = feature(wave_name(0.3, 0.5, "speed>20")).function(signals(v_x=speed))
    expected = np.where(speed > 20.0, np.cos(2.0 * np.pi * 0.3 * TIME + 0.5), 0.0)
    np.testing.assert_allclose(out, expected, atol=1e-12)
    assert not is_transferable(wave_name(0.3, 0.5))
    assert is_transferable(lag_name("delta", 0.3))


def test_a_hysteresis_is_the_lost_motion_of_a_backlash() -> None:
    delta = 0.02 * np.sin(TIME)
    out = feature(hysteresis_name("delta", 0.003)).function(signals(delta=delta))
    assert np.abs(out).max() == pytest.approx(0.003)
    # Backlash keeps its output while the input crosses the gap; the rest is lost.
    behind = delta - out
    inside = np.abs(out[1:]) < 0.003 - 1e-9
    np.testing.assert_allclose(np.diff(behind)[inside], 0.0, atol=1e-12)
    assert has_memory("hysteresis:delta:0.003")
    assert not has_unlimited_memory("hysteresis:delta:0.003")


def test_an_excess_is_the_part_beyond_a_threshold_on_both_sides() -> None:
    torque = np.linspace(-2000.0, 1000.0, TIME.size)
    out = feature(excess_name("torque", 500.0)).function(signals(torque=torque))
    expected = np.where(np.abs(torque) > 500.0, torque - 500.0 * np.sign(torque), 0.0)
    np.testing.assert_allclose(out, expected)


def test_a_drift_follows_the_braking_work() -> None:
    braking = TIME % 10.0 < 2.0
    given = signals(v_x=np.full_like(TIME, 20.0), torque=np.where(braking, -1000.0, 200.0))
    out = feature(drift_name("brake_torque", "brake_work", 4e5)).function(given)
    # 2 s at 1000 N m and 20 m/s are 4e4 N m^2; six such intervals are 0.6 of the scale.
    assert out[~braking].max() == 0.0
    assert out[5199] == pytest.approx(-1000.0 * (1.0 - np.exp(-0.6)), rel=1e-3)


def test_a_drift_in_time_and_an_onset_count_from_the_start_of_the_recording() -> None:
    given = signals(delta=np.ones_like(TIME))
    out = feature(drift_name("delta", "time", 30.0)).function(given)
    np.testing.assert_allclose(out, 1.0 - np.exp(-TIME / 30.0))
    fading = feature(decay_name("delta", "time", 30.0)).function(given)
    np.testing.assert_allclose(out + fading, 1.0)
    onset = feature(gate_name("delta", "time", True, 25.0)).function(given)
    np.testing.assert_array_equal(onset, TIME > 25.0)


def test_heat_decays_after_braking() -> None:
    torque = np.where(TIME < 10.0, -1000.0, -1.0)
    given = signals(v_x=np.full_like(TIME, 20.0), torque=torque)
    out = feature(heat_name("brake_torque", 5.0)).function(given) / torque
    assert out[999] == pytest.approx(2e4 * 1.0, rel=0.2)
    assert out[1499] / out[999] == pytest.approx(np.exp(-1.0), rel=0.01)


def test_a_ripple_repeats_every_wavelength_whatever_the_speed() -> None:
    speed = 15.0 + 5.0 * np.sin(0.3 * TIME)
    distance = STEP * np.cumsum(speed)
    out = feature(ripple_name(2.04, 0.3, "speed_squared")).function(signals(v_x=speed))
    expected = speed**2 * np.cos(2.0 * np.pi * distance / 2.04 + 0.3)
    np.testing.assert_allclose(out, expected, atol=1e-6)


def test_a_speed_wave_depends_on_the_speed_alone() -> None:
    speed = 15.0 + 5.0 * np.sin(0.3 * TIME)
    name = speed_wave_name(4.0, 0.3, "constant")
    out = feature(name).function(signals(v_x=speed))
    np.testing.assert_allclose(out, np.cos(2.0 * np.pi * speed / 4.0 + 0.3), atol=1e-9)
    assert is_transferable(name)
    assert not has_memory(name)
    assert searched_parameters(name) == 2


def test_a_pulsation_is_a_feature_that_oscillates_in_time() -> None:
    given = signals(torque=np.full_like(TIME, 300.0))
    out = feature(pulsation_name(2.5, 0.3, "torque")).function(given)
    np.testing.assert_allclose(out, 300.0 * np.cos(5.0 * np.pi * TIME + 0.3), atol=1e-9)
    assert not is_transferable(pulsation_name(2.5, 0.3, "torque"))


def test_what_depends_on_time_or_phase_is_not_transferable() -> None:
    assert not is_transferable(ripple_name(2.04, 0.3, "constant"))
    assert not is_transferable(drift_name("delta", "time", 30.0))
    assert not is_transferable(gate_name("delta", "time", True, 30.0))
    assert is_transferable(drift_name("brake_torque", "brake_work", 4e5))
    assert is_transferable(gate_name("brake_torque", "deceleration", True, 6.0))
    assert has_unlimited_memory(drift_name("brake_torque", "brake_work", 4e5))


def test_sizes_are_scaled_within_their_range() -> None:
    assert sizes_of("resonance:a_y:0.5:0.1") == [0.5, 0.1]
    assert scaled("resonance:a_y:0.5:0.1", [2.0, 0.5]) == "resonance:a_y:1:0.05"
    assert scaled("drift:brake_torque:brake_work:4e5", [1.1]) == (
        "drift:brake_torque:brake_work:4.4e+05"
    )
    assert scaled("lag:a_y:500", [10.0]) == "lag:a_y:1000"
    assert sizes_of("gate:torque:speed>3") == sizes_of("wave:0.3:0.5") == []


def test_names_say_what_was_searched() -> None:
    assert searched_parameters("speed") == 0
    assert searched_parameters(lag_name("delta", 0.3)) == 1
    assert searched_parameters(resonance_name("a_y", 0.5, 0.1)) == 2
    assert searched_parameters(gate_name("torque", "speed", True, 20.0)) == 1
    assert searched_parameters(wave_name(0.3, 0.5)) == 2
    assert searched_parameters(wave_name(0.3, 0.5, "speed>20")) == 3
    assert searched_parameters(ripple_name(2.04, 0.3, "constant")) == 2
    assert searched_parameters(drift_name("delta", "time", 30.0)) == 1
    assert has_memory(lag_name("delta", 0.3))
    assert not has_memory("speed")


@pytest.mark.parametrize(
    ("name", "words", "expression"),
    [
        (
            "gate:drive_torque:lateral_size>3.4",
            "drive torque where the lateral acceleration is above 3.4 m/s²",
            "max(T, 0) [|a_y| > 3.4 m/s²]",
        ),
        ("gate:constant:torque<0", "a constant while braking", "1 [T < 0]"),
        (
            "resonance:a_y:0.47:0.05",
            "a mass on a spring moved by lateral acceleration (0.47 Hz, damping ratio 0.05)",
            "resonance(a_y, 0.47 Hz, 0.05)",
        ),
        (
            "resonance:torque:1.2:0.1",
            "a spring bent by torque (1.2 Hz, damping ratio 0.1)",
            "resonance(T, 1.2 Hz, 0.1)",
        ),
        ("lag:delta:0.35", "steering angle with a lag of 0.35 s", "lag(delta, 0.35 s)"),
        (
            "wave:0.3:0.5:speed>20",
            "an oscillation in time at 0.3 Hz where the speed is above 20 m/s",
            "cos(2 pi 0.3 t +0.50) [v_x > 20 m/s]",
        ),
        (
            "hysteresis:delta:0.003",
            "steering angle with a hysteresis of ±0.003 rad",
            "hysteresis(delta, 0.003 rad)",
        ),
        (
            "excess:brake_torque:1500",
            "brake torque beyond 1500 N·m",
            "min(T, 0) [beyond 1500 N m]",
        ),
        (
            "drift:brake_torque:brake_work:4e5",
            "brake torque that changes with the braking work",
            "min(T, 0) (1 - exp(-W / 4e+05 N m^2))",
        ),
        (
            "drift:delta:time:90",
            "steering angle that changes with the time over 90 s",
            "delta (1 - exp(-t / 90 s))",
        ),
        (
            "decay:constant:time:50",
            "a constant that fades with the time over 50 s",
            "1 exp(-t / 50 s)",
        ),
        (
            "pulsation:2.5:0.3:drive_torque",
            "drive torque that oscillates in time at 2.5 Hz",
            "max(T, 0) cos(2 pi 2.5 t +0.30)",
        ),
        (
            "heat:brake_torque:30",
            "brake torque that changes with the braking power of the last 30 s",
            "min(T, 0) lag(max(-T v_x, 0), 30 s)",
        ),
        (
            "ripple:2.042:0.3:constant",
            "an oscillation every 2.042 m travelled",
            "cos(2 pi s / 2.042 m +0.30)",
        ),
        (
            "speed_wave:4.19:0.3:constant",
            "an oscillation with speed every 4.19 m/s",
            "cos(2 pi v_x / 4.19 m/s +0.30)",
        ),
        (
            "gate:drive_torque:time>83.2",
            "drive torque from 83.2 s",
            "max(T, 0) [t > 83.2 s]",
        ),
    ],
)
def test_features_are_described_in_words(name: str, words: str, expression: str) -> None:
    assert feature(name).description == words
    assert feature(name).expression == expression


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("tide", "feature 'tide' is unknown"),
        ("lag:tide:1", "feature 'lag:tide:1' is unknown"),
        ("lag:torque:x", "'x' is not a number"),
        ("lag:torque:-1", "-1 is not within 0.001 to 1000"),
        ("resonance:a_y:nan:0.1", "nan is not within 0.02 to 10"),
        ("resonance:a_y:0.5:9", "9 is not within 0 to 2"),
        ("gate:tide:speed>3", "feature 'tide' is unknown"),
        ("gate:torque:tide>3", "'tide>3' is not a condition"),
        ("gate:torque:speed", "'speed' is not a condition"),
        ("wave:0:1", "0 is not within 0.02 to 10"),
        ("wave:0.1:1:speed", "'speed' is not a condition"),
        ("drift:torque:tide:3", "feature 'drift:torque:tide:3' is unknown"),
        ("drift:tide:time:3", "feature 'tide' is unknown"),
        ("hysteresis:speed:3", "feature 'hysteresis:speed:3' is unknown"),
        ("ripple:2:0", "feature 'ripple:2:0' is unknown"),
        ("excess:torque:-5", "-5 is not within 1e-09 to 1e+12"),
    ],
)
def test_a_wrong_name_is_refused(name: str, said: str) -> None:
    with pytest.raises(ValueError, match=r".") as caught:
        feature(name)
    assert str(caught.value) == said


def test_static_and_parametric_features_form_one_matrix() -> None:
    given = signals(v_x=np.full_like(TIME, 12.0), a_y=np.sin(TIME))
    table = feature_matrix(["speed", "lag:a_y:0.5"], given)
    assert table.shape == (TIME.size, 2)
    np.testing.assert_array_equal(table[:, 0], 12.0)
