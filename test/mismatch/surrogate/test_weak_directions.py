# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a simulation leaves open about a car, and the slip of wheels that spin up."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.mismatch import car

from adk_ros.mismatch.library.surrogate_parameters import INDEX, default_parameters
from adk_ros.mismatch.surrogate.command_response import spin_up_lag
from adk_ros.mismatch.surrogate.weak_directions import weakly_identified_directions

NAMES = ("drag_area", "rolling", "roll_gradient")
SIGMA = np.array([0.7, 0.015, 0.01])


def test_what_is_determined_is_no_direction_but_slip_always_is() -> None:
    known = weakly_identified_directions(np.diag(1e6 / SIGMA**2), SIGMA, NAMES)
    assert known.shape[0] == 1
    (entry,) = np.flatnonzero(known[-1])
    assert entry == INDEX["slip_compliance"]
    # One standard deviation leads to wheels that do not slip.
    assert known[-1, entry] == default_parameters()[entry]


def test_an_open_parameter_is_a_direction_of_its_prior_but_not_one_of_the_body() -> None:
    normal = np.diag([0.0, 1e6 / SIGMA[1] ** 2, 0.0])
    directions = weakly_identified_directions(normal, SIGMA, NAMES)
    assert directions.shape[0] == 2
    assert np.flatnonzero(directions[0]).tolist() == [INDEX["drag_area"]]
    assert abs(directions[0, INDEX["drag_area"]]) == pytest.approx(0.7)


def test_only_additional_inertia_delays_the_force_and_only_with_slip() -> None:
    assert spin_up_lag(car(), 20.0) == 0.0
    heavy = spin_up_lag(car(spin_up_inertia=20.0), 20.0)
    assert heavy > 0.0
    assert spin_up_lag(car(spin_up_inertia=20.0), 40.0) == pytest.approx(2.0 * heavy)
    assert spin_up_lag(car(spin_up_inertia=20.0, slip_compliance=0.0), 20.0) == 0.0
