# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The catalogue for vehicles of other sizes."""

from __future__ import annotations

import numpy as np
import pytest

from adk_ros.mismatch.library.catalogue import EFFECTS, effects_of
from adk_ros.mismatch.library.surrogate_parameters import INDEX, default_parameters
from adk_ros.mismatch.surrogate.identification import FITTED_PARAMETERS, fitted_parameters
from adk_ros.mismatch.surrogate.substeps import scale_of, substeps

TENTH = 0.1


def small_car() -> np.ndarray:
    p = default_parameters()
    p[[INDEX["cg_to_front_axle"], INDEX["cg_to_rear_axle"]]] = 0.13, 0.13
    return p


def test_a_full_size_car_has_the_catalogue_itself() -> None:
    assert effects_of(1.0) is EFFECTS
    p = default_parameters()
    assert (scale_of(p), substeps(p)) == (1.0, 1)
    assert fitted_parameters((), p) == FITTED_PARAMETERS


def test_masses_and_lengths_scale_and_ratios_and_delays_do_not() -> None:
    effects = effects_of(TENTH)
    payload = effects["payload"].parameters[0]
    assert payload.materiality_threshold == pytest.approx(0.03)
    # 1.1 m² between yaw inertia and mass.
    assert payload.targets == pytest.approx({"mass": 1.0, "yaw_inertia": 0.011})
    assert effects["aero_drag"].parameters[0].materiality_threshold == pytest.approx(3e-4)
    for name in ("steering_ratio", "steering_delay", "imu_tilt", "low_friction", "yaw_inertia"):
        assert effects[name] == EFFECTS[name]


def test_a_power_limit_scales_with_its_reciprocal() -> None:
    power = effects_of(TENTH)["power_limit"].parameters[0]
    assert power.materiality_threshold == pytest.approx(1.5e5 * TENTH**3.5)
    assert power.step == pytest.approx(2e-7 * TENTH**-3.5)
    assert power.targets == {"power_inverse": 1.0}


def test_a_small_car_has_shorter_steps_and_priors_of_its_size() -> None:
    p = small_car()
    assert substeps(p) == 4
    prior = fitted_parameters((), p)["relaxation_length"]
    assert prior.sigma == pytest.approx(0.5 * scale_of(p))
