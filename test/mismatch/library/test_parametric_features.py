# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Features with a memory, a threshold or an oscillation: values, names, files."""

from __future__ import annotations

import numpy as np
import pytest

from adk_ros.mismatch.library.features import feature, feature_matrix
from adk_ros.mismatch.library.parametric_features import (
    gate_name,
    has_memory,
    is_transferable,
    lag_name,
    resonance_name,
    searched_parameters,
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


def test_names_say_what_was_searched() -> None:
    assert searched_parameters("speed") == 0
    assert searched_parameters(lag_name("delta", 0.3)) == 1
    assert searched_parameters(resonance_name("a_y", 0.5, 0.1)) == 2
    assert searched_parameters(gate_name("torque", "speed", True, 20.0)) == 1
    assert searched_parameters(wave_name(0.3, 0.5)) == 2
    assert searched_parameters(wave_name(0.3, 0.5, "speed>20")) == 3
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
        ("lag:delta:0.35", "steering angle with a lag of 0.35 s", "lag(delta, 0.35 s)"),
        (
            "wave:0.3:0.5:speed>20",
            "an oscillation in time at 0.3 Hz where the speed is above 20 m/s",
            "cos(2 pi 0.3 t +0.50) [v_x > 20 m/s]",
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
        ("lag:torque:-1", "-1 is not within 0.001 to 100"),
        ("resonance:a_y:nan:0.1", "nan is not within 0.02 to 10"),
        ("resonance:a_y:0.5:9", "9 is not within 0 to 2"),
        ("gate:tide:speed>3", "feature 'tide' is unknown"),
        ("gate:torque:tide>3", "'tide>3' is not a condition"),
        ("gate:torque:speed", "'speed' is not a condition"),
        ("wave:0:1", "0 is not within 0.02 to 10"),
        ("wave:0.1:1:speed", "'speed' is not a condition"),
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
