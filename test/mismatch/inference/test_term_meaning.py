# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Feature terms in words and units."""

from __future__ import annotations

import pytest

from adk_ros.mismatch.inference.term_meaning import Body, meaning
from adk_ros.mismatch.surrogate.feature_terms import FeatureTerm


@pytest.mark.parametrize(
    ("term", "said"),
    [
        (
            FeatureTerm("v_y", "resonance:a_y:0.47:0.05", -0.085, 0.0),
            "a mass of about 170 kg moves sideways at 0.47 Hz with a damping ratio of 0.05",
        ),
        (
            FeatureTerm("v_x", "resonance:torque:1.2:0.1", 0.3 / 600.0, 0.0),
            "about 30 % more of the wheel torque acts, through a spring that oscillates at 1.2 Hz "
            "with a damping ratio of 0.1",
        ),
        (
            FeatureTerm("steering", "lag:delta:0.4", -0.2, 0.0),
            "about 20 % less of the steering angle acts, with a lag of 0.4 s",
        ),
        (FeatureTerm("yaw_rate", "lag:torque:1.5", 2e-5, 0.0), ""),
        (
            FeatureTerm("v_x", "gate:drive_torque:lateral_size>3.4", -0.8 / 600.0, 0.0),
            "the drive torque is about 80 % less where the lateral acceleration is above 3.4 m/s²",
        ),
        (
            # A fitted share is not known to a per cent, and no more than all torque is cut.
            FeatureTerm("v_x", "gate:drive_torque:lateral_size>3.2", -1.01 / 600.0, 0.0),
            "the drive torque is about 100 % less where the lateral acceleration is above "
            "3.2 m/s²",
        ),
        (
            FeatureTerm("yaw_rate", "wave:0.3:0.5:speed>20", 0.4, 0.0),
            "a yaw moment of about 1200 N·m that oscillates in time at 0.3 Hz where the speed is "
            "above 20 m/s",
        ),
        (
            FeatureTerm("steering", "gate:delta:speed>20", -0.08, 0.0),
            "the road wheels turn by about 8 % less where the speed is above 20 m/s",
        ),
        (
            FeatureTerm("steering", "wave:0.3:0.5", 0.004, 0.0),
            "a road-wheel angle of about 0.23° that oscillates in time at 0.3 Hz",
        ),
        (
            FeatureTerm("v_x", "gate:brake_torque:deceleration>6", -0.6 / 600.0, 0.0),
            "the brake torque is about 60 % less where the deceleration is above 6 m/s²",
        ),
        (
            FeatureTerm("v_x", "excess:brake_torque:1500", -1.0 / 600.0, 0.0),
            "the brake torque is about 100 % less beyond 1500 N·m",
        ),
        (
            FeatureTerm("v_x", "gate:drive_torque:time>83.2", -0.2 / 600.0, 0.0),
            "the drive torque is about 20 % less from 83.2 s",
        ),
        (
            FeatureTerm("v_x", "drift:brake_torque:brake_work:519400", -0.4 / 600.0, 0.0),
            "the brake torque loses 20 % after 1.2 MJ of braking work, and at most 40 %",
        ),
        (
            FeatureTerm("v_x", "drift:brake_torque:brake_work:3e6", -1.2 / 600.0, 0.0),
            "the brake torque loses 12 % per MJ of braking work",
        ),
        (
            FeatureTerm("v_x", "drift:drive_torque:time:120", 1.2 / 600.0, 0.0),
            "the drive torque gains 60 % per minute",
        ),
        (
            FeatureTerm("v_x", "decay:constant:time:50", -0.2, 0.0),
            "a longitudinal force of about 400 N that fades, half of it after 35 s",
        ),
        (
            FeatureTerm("v_x", "decay:drive_torque:time:50", -0.2 / 600.0, 0.0),
            "the drive torque is at first 20 % less, half of it after 35 s",
        ),
        (
            FeatureTerm("v_x", "pulsation:2.5:0.3:torque", 0.12 / 600.0, 0.0),
            "the wheel torque varies by ±12 % at 2.5 Hz",
        ),
        (
            FeatureTerm("v_y", "drift:constant:time:60", 0.2, 0.0),
            "a lateral force of about 400 N that builds up, half of it after 42 s",
        ),
        (
            FeatureTerm("v_x", "heat:brake_torque:30", -1e-4 / 600.0 / 3.0, 0.0),
            "the brake torque loses 10 % per 10 kW of braking power, averaged over 30 s",
        ),
        (
            FeatureTerm("yaw_rate", "hysteresis:delta:0.004", -20.0, 0.0),
            "a yaw moment of about 240 N·m that changes sign only after the steering angle has "
            "reversed by 0.008 rad, as with play or dry friction",
        ),
        (
            FeatureTerm("v_x", "ripple:1.87:0.3:speed_squared", 1e-4, 0.0),
            "a longitudinal force of about 80 N at 20 m/s that oscillates every 1.87 m, once per "
            "turn of the wheel",
        ),
        (
            FeatureTerm("v_x", "ripple:0.94:0.3:brake_torque", -0.1 / 600.0, 0.0),
            "the brake torque varies by ±10 % every 0.94 m, twice per turn of the wheel",
        ),
        (
            FeatureTerm("yaw_rate", "speed_wave:4.19:0.3:constant", 0.05, 0.0),
            "a yaw moment of about 150 N·m that changes its sign every 2.1 m/s",
        ),
        (
            FeatureTerm("v_y", "ripple:30:0.3:constant", 0.1, 0.0),
            "a lateral force of about 200 N that oscillates every 30 m",
        ),
        (FeatureTerm("v_y", "speed", 0.1, 0.0), ""),
        (FeatureTerm("yaw_rate", "drift:delta:time:60", 0.1, 0.0), ""),
    ],
)
def test_terms_are_described_as_physical_quantities(term: FeatureTerm, said: str) -> None:
    assert meaning([term], Body(2000.0, 3000.0, 0.3)) == said
