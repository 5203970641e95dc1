# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Driving that is harder than the simulation: found, left out, and said."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import yaml
from helpers.mismatch import case

from adk_ros.errors import UsageError
from adk_ros.files.yaml_file import validate
from adk_ros.mismatch.deployment.held_out import Evidence, persistence_errors
from adk_ros.mismatch.deployment.surrogate_file import SurrogateFile
from adk_ros.mismatch.deployment.surrogate_writer import simulation_yaml
from adk_ros.mismatch.inference.hypothesis import ActiveEffect, Hypothesis, road_friction
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inputs import Inputs
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.surrogate.acceleration_envelope import AccelerationEnvelope
from adk_ros.mismatch.surrogate.activation import Activation
from adk_ros.mismatch.surrogate.identification import SurrogateModel, identify_surrogate
from adk_ros.mismatch.surrogate.residuals import (
    BIN_S,
    ResidualProblem,
    prepare_residual_problem,
)
from adk_ros.mismatch.validation import validate_on_held_out
from adk_ros.numerics.arrays import BoolArray

SQUARE = AccelerationEnvelope(np.array([[-3.0, -5.0], [3.0, -5.0], [3.0, 5.0], [-3.0, 5.0]]))


@cache
def problem() -> ResidualProblem:
    return prepare_residual_problem(case().simulation)


@cache
def surrogate() -> SurrogateModel:
    plain = identify_surrogate(problem(), case().nominal.parameters())
    return plain.with_known_driving(problem())


def gentler(share: float) -> SurrogateModel:
    """A surrogate of a simulation with smaller accelerations."""
    envelope = surrogate().envelope
    assert envelope is not None
    return replace(surrogate(), envelope=AccelerationEnvelope(share * envelope.vertices))


def runs(beyond: BoolArray) -> list[int]:
    """The lengths of stretches, in bins."""
    edges = np.flatnonzero(np.diff(beyond.astype(int), prepend=0, append=0))
    return list(edges[1::2] - edges[::2])


def test_a_hull_contains_what_spans_it() -> None:
    grid = np.random.default_rng(0).uniform([-3.0, -5.0], [3.0, 5.0], (500, 2))
    hull = AccelerationEnvelope.of(grid)
    assert hull is not None
    assert not hull.excludes(0.999 * grid).any()
    np.testing.assert_array_equal(
        SQUARE.excludes(np.array([[0.0, 0.0], [2.9, -4.9], [3.1, 0.0], [0.0, -5.1]])),
        [False, False, True, True],
    )
    straight = np.column_stack([np.linspace(-3.0, 3.0, 50), np.zeros(50)])
    assert AccelerationEnvelope.of(straight) is None
    assert AccelerationEnvelope.of(np.empty((0, 2))) is None


def test_the_simulation_is_not_beyond_itself() -> None:
    assert not surrogate().bins_beyond(problem()).any()
    assert not replace(surrogate(), envelope=None).bins_beyond(problem()).any()


def test_harder_driving_is_found_with_what_it_influences() -> None:
    beyond = gentler(0.9).bins_beyond(problem())
    assert 0.0 < beyond.mean() < 0.5
    # A quarter of a second before, a second after.
    assert min(runs(beyond)) * BIN_S >= 1.25


@pytest.mark.parametrize("moved", ["measured", "simulated"])
def test_missing_physics_that_moves_one_of_both_is_kept(moved: str) -> None:
    log = case().simulation
    # Either the simulated acceleration alone is outside, or the measured one.
    share, known = (0.5, gentler(0.9)) if moved == "simulated" else (3.0, surrogate())
    recording = prepare_residual_problem(replace(log, imu=log.imu * [share, share, 1.0]))
    assert known.bins_beyond(recording).sum() < 0.2 * gentler(0.9).bins_beyond(problem()).sum()


def test_without_an_imu_the_odometry_tells() -> None:
    log = case().simulation
    blind = replace(log, imu_s=np.empty(0), imu=np.empty((0, 3)))
    with_imu = gentler(0.9).bins_beyond(problem())
    without = gentler(0.9).bins_beyond(prepare_residual_problem(blind))
    assert np.mean(with_imu[: without.size] == without[: with_imu.size]) > 0.8


def test_a_drive_that_is_harder_throughout_is_kept() -> None:
    known = gentler(0.2)
    assert known.harder_driving(problem()).mean() > 0.5
    assert not known.bins_beyond(problem()).any()


def test_a_slippery_road_is_driven_harder_at_the_same_accelerations() -> None:
    recording = prepare_residual_problem(case().recording)
    half = np.full(recording.bins, 0.5)
    # As if the simulation had been driven half as hard.
    slippery, gentle = surrogate().harder_driving(recording, half), gentler(0.5)
    np.testing.assert_array_equal(slippery, gentle.harder_driving(recording))
    assert slippery.sum() > surrogate().harder_driving(recording).sum()


def test_friction_is_that_of_the_effect_where_it_acts() -> None:
    recording = prepare_residual_problem(case().recording)
    low = EFFECTS["low_friction"]
    assert road_friction([], recording) is None
    everywhere = road_friction([ActiveEffect(low, (0.7,))], recording)
    assert everywhere is not None
    np.testing.assert_allclose(everywhere, 0.7)
    late = road_friction([ActiveEffect(low, (0.7,), Activation(onset_s=45.0))], recording)
    assert late is not None
    assert late[recording.bin_s < 40.0] == pytest.approx(1.0, abs=1e-3)
    assert late[recording.bin_s > 50.0] == pytest.approx(0.7, abs=1e-3)
    # The places of another drive are not known here: it may act anywhere.
    placed = Activation(segments=((0.0, 50.0),), lap_length=300.0, distance=np.zeros(7))
    unknown = road_friction([ActiveEffect(low, (0.7,), placed)], recording)
    assert unknown is not None
    np.testing.assert_allclose(unknown, 0.7)


def test_sliding_beyond_the_simulation_does_not_count_against_a_correction() -> None:
    low = ActiveEffect(EFFECTS["low_friction"], (0.95,))
    known = surrogate()
    nuisances = np.zeros(15 + known.weak_directions.shape[0])
    evidence = [Evidence(case().recording)]
    with_friction, without = (
        validate_on_held_out(known, Hypothesis(effects, nuisances, 0.0), None, evidence).errors
        for effects in ((low,), ())
    )
    # The same predictions are compared with the simulation's; fewer judge the correction.
    assert with_friction.starts == without.starts
    np.testing.assert_array_equal(with_friction.before, without.before)
    assert (with_friction.corrected != with_friction.after).any()


def test_what_is_beyond_neither_counts_nor_is_predicted() -> None:
    recording = prepare_residual_problem(case().recording)
    known = gentler(0.9)
    beyond = known.bins_beyond(recording)
    assert beyond.any()
    weights = Likelihood.of(recording, known).weights
    assert not weights[:, beyond].any()
    assert np.array_equal(
        weights[:, ~beyond], Likelihood.of(recording, surrogate()).weights[:, ~beyond]
    )
    everything = Hypothesis((), np.zeros(15 + known.weak_directions.shape[0]), 0.0)
    evidence = [Evidence(case().recording)]
    fewer, every = (
        validate_on_held_out(x, everything, None, evidence).errors.starts
        for x in (known, replace(known, envelope=None))
    )
    assert 0 < fewer < every


def test_a_prediction_does_not_touch_what_is_skipped() -> None:
    item = Evidence(case().recording, skipped_s=np.array([[20.0, 21.0]]))
    errors, all_errors = persistence_errors([item]), persistence_errors([Evidence(item.log)])
    hidden = np.isnan(errors[:, :, 0]) & np.isfinite(all_errors[:, :, 0])
    # Starts every 0.25 s; a prediction over h touches it from 20 - h to 21 s.
    assert list(hidden.sum(axis=0)) == [6, 9, 13]


def test_a_file_keeps_the_envelope() -> None:
    content = yaml.safe_load(simulation_yaml(surrogate()))
    again = validate("model", content, SurrogateFile).surrogate()
    assert again.envelope is not None
    np.testing.assert_array_equal(again.bins_beyond(problem()), False)
    sides = [again.envelope.vertices, surrogate().envelope.vertices]  # type: ignore[union-attr]
    np.testing.assert_allclose(np.sort(sides[0], axis=0), np.sort(sides[1], axis=0), rtol=1e-6)


@pytest.mark.parametrize(
    "envelope", [[], [[0.0, 1.0]], [[0.0], [1.0], [2.0]], [[0, 0], [1, 1], [2, 2]]]
)
def test_an_envelope_without_area_is_refused(envelope: list[list[float]]) -> None:
    content = yaml.safe_load(simulation_yaml(surrogate()))
    content["identification"]["envelope"] = envelope
    with pytest.raises(UsageError, match="envelope needs vertices"):
        validate("model", content, SurrogateFile)


def test_the_result_says_how_much_is_left_out() -> None:
    def notes(known: SurrogateModel) -> str:
        inputs = Inputs.of(known, [case().recording], None, 0.25, lambda done, text: None)
        return "\n".join(inputs.notes)

    assert "nothing is compared; simulate a drive that is as hard" in notes(gentler(0.9))
    assert "its error is unknown; simulate a drive that is as hard" in notes(gentler(0.2))
    assert "driven harder" not in notes(replace(surrogate(), envelope=None))
