# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Several recordings on one axis of time: no signal crosses a joint, and routes are kept apart."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from helpers.mismatch import car, case, moved

from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.surrogate.activation import ROUTE_SPACING_M, Activation
from adk_ros.mismatch.surrogate.joined_problem import JoinedProblem
from adk_ros.mismatch.surrogate.lap import find_lap
from adk_ros.mismatch.surrogate.residuals import BIN_S, prepare_residual_problem
from adk_ros.mismatch.surrogate.routes import find_routes
from adk_ros.mismatch.surrogate.run_inputs import ActiveTerms


def joined(*logs: SensorLog) -> JoinedProblem:
    return JoinedProblem.of(logs, [log.noise() for log in logs])


@cache
def two() -> JoinedProblem:
    return joined(case().recording, case().held_out)


def test_residuals_are_those_of_each_recording() -> None:
    problem, p = two(), car()
    alone = [prepare_residual_problem(log) for log in (case().recording, case().held_out)]
    expected = np.concatenate([each.residuals(p) for each in alone], axis=1)
    np.testing.assert_allclose(problem.residuals(p), expected, atol=1e-6)
    given = problem.residuals(p, out=problem.run(p))
    np.testing.assert_array_equal(given, problem.residuals(p))
    distances = np.concatenate([each.distance_residuals(p) for each in alone])
    np.testing.assert_allclose(problem.distance_residuals(p), distances)


def test_bins_are_evenly_spaced_across_the_joint() -> None:
    problem = two()
    np.testing.assert_allclose(np.diff(problem.bin_s), BIN_S, atol=1e-9)
    time = problem.binned(problem.middle_s)
    np.testing.assert_allclose(time, problem.bin_s, atol=BIN_S)
    assert problem.log.duration_s == problem.parts[1].log.duration_s
    torque, delta = problem.mean_commands()
    assert torque.shape == delta.shape == problem.middle_s.shape


def test_a_term_acts_in_its_recording_only() -> None:
    problem, p = two(), car()
    active = np.ones((2, problem.steps))
    active[1, problem.step_slices[0]] = 0.0
    terms = ActiveTerms(np.array([0]), np.array([200.0]), np.array([1]), active)
    change = problem.residuals(p, terms) - problem.residuals(p)
    first, second = (np.abs(change[:, bins]).max() for bins in problem.bin_slices)
    assert first == 0.0
    assert second > 0.0


def test_recordings_in_one_frame_share_a_route() -> None:
    problem = two()
    assert find_lap(problem.parts[1]) is None
    lap, route_of = find_routes(problem)
    assert lap is not None
    assert route_of == (0, 0)
    assert len(lap.routes) == 1
    assert np.isfinite(lap.distance).all()


def test_recordings_in_different_frames_have_routes_of_their_own() -> None:
    recording = case().recording
    problem = joined(recording, moved(recording))
    lap, route_of = find_routes(problem)
    assert lap is not None
    assert route_of == (0, 1)
    first, second = lap.routes
    assert first.length == pytest.approx(second.length)
    half = problem.steps // 2
    assert np.isfinite(first.distance[:half]).all()
    assert np.isnan(first.distance[half:]).all()
    np.testing.assert_allclose(first.distance[:half], second.distance[half:], atol=1e-3)


def test_a_segment_acts_on_its_route_only() -> None:
    recording = case().recording
    problem = joined(recording, moved(recording))
    lap, _ = find_routes(problem)
    assert lap is not None
    lengths = tuple(route.length for route in lap.routes)
    half, out = problem.steps // 2, []
    for offset in (0.0, ROUTE_SPACING_M):
        segments = ((offset + lengths[0] - 50.0, offset + lengths[0] + 50.0),)
        activation = Activation(
            segments=segments, lap_length=lap.length, distance=lap.distance, route_lengths=lengths
        )
        out.append(activation.series(problem))
    assert out[0][:half].max() > 0.99
    assert out[0][half:].max() == 0.0
    np.testing.assert_allclose(out[1][half:], out[0][:half], atol=1e-3)
    assert out[1][:half].max() == 0.0


def test_a_recording_without_a_lap_is_on_none() -> None:
    recording = case().recording
    away = replace(moved(case().held_out), name="away")
    lap, route_of = find_routes(joined(recording, away))
    assert lap is not None
    assert route_of == (0, None)
    assert len(lap.routes) == 1
    assert np.isfinite(lap.unwrapped).sum() == prepare_residual_problem(recording).steps
