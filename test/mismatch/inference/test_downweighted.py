# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Episodes beyond what noise causes: times, channels, and whether chance explains them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import yaml
from helpers.mismatch import case

from adk_ros.files.yaml_file import validate
from adk_ros.mismatch.deployment.surrogate_file import SurrogateFile
from adk_ros.mismatch.deployment.surrogate_writer import simulation_yaml
from adk_ros.mismatch.inference.decision import Decision
from adk_ros.mismatch.inference.downweighted import (
    _seconds,
    downweighted_residuals,
    episodes_describe_more,
    note_on,
    with_episodes,
)
from adk_ros.mismatch.inference.downweighted_episodes import Downweighted, Episode
from adk_ros.mismatch.inference.feature_effect import active_feature
from adk_ros.mismatch.inference.fit_budget import FEATURE_REFIT, NULL_HYPOTHESIS
from adk_ros.mismatch.inference.hypothesis import Hypothesis
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.result import EXPLAINED, NONE, UNKNOWN, UnexplainedResidual
from adk_ros.mismatch.library.features import feature
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.simulator import surrogate_of
from adk_ros.mismatch.surrogate.feature_terms import FeatureTerm, feature_signals
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.mismatch.surrogate.lap import find_lap
from adk_ros.mismatch.surrogate.residuals import prepare_residual_problem
from adk_ros.mismatch.surrogate.state_index import IMU_A_X
from adk_ros.numerics.arrays import FloatArray

PULSES_S = (15.0, 24.0, 33.0, 47.0, 58.0, 71.0)


@cache
def surrogate() -> SurrogateModel:
    c = case()
    found = surrogate_of(c.simulation, c.recording, c.nominal, lambda done, text: None)[0]
    # All of the recording counts, also where it is driven harder than the simulation.
    return replace(found, envelope=None)


def with_pulses(pulses_s: Sequence[float], size: float) -> SensorLog:
    log = case().recording
    imu = log.imu.copy()
    for begin in pulses_s:
        imu[(log.imu_s > begin) & (log.imu_s < begin + 0.4), 1] += size
    return replace(log, imu=imu)


def hidden_by(pulses_s: Sequence[float], size: float = 1.5) -> Downweighted | None:
    """What is downweighted in a clean recording with pulses of 0.4 s of a_y."""
    problem = prepare_residual_problem(with_pulses(pulses_s, size))
    likelihood = Likelihood.of(problem, surrogate())
    null = likelihood.fit([], budget=NULL_HYPOTHESIS)
    return downweighted_residuals(likelihood, null, surrogate(), find_lap(problem))


def test_nothing_is_downweighted_in_a_clean_recording() -> None:
    assert hidden_by([]) is None
    assert note_on(None) == []


def test_a_step_of_the_torque_is_known_to_half_a_time_step() -> None:
    log = case().recording
    steps = np.abs(np.diff(log.command[:, 0]))
    largest_s = log.command_s[1:][np.argsort(-steps)[:6]]
    after = np.searchsorted(log.imu_s, largest_s, side="right")
    change = 0.5 * (log.imu[after, 0] - log.imu[after - 1, 0])

    def changed(at: npt.NDArray[np.integer[Any]], channel: int = 0) -> Downweighted | None:
        imu = log.imu.copy()
        imu[at, channel] -= change
        problem = prepare_residual_problem(replace(log, imu=imu))
        likelihood = Likelihood.of(problem, surrogate())
        null = likelihood.fit([], budget=NULL_HYPOTHESIS)
        return downweighted_residuals(likelihood, null, surrogate(), find_lap(problem))

    assert changed(after) is None
    elsewhere, sideways = changed(after + 150), changed(after, 1)
    assert elsewhere is not None
    assert sideways is not None
    assert {x.channel for x in elsewhere.episodes} == {"imu_a_x"}
    assert {x.channel for x in sideways.episodes} == {"imu_a_y"}


def test_the_time_step_of_the_surrogate_is_known_on_the_simulation_too() -> None:
    model = surrogate()
    error = np.asarray(model.timing_error)
    assert error.shape == model.residuals.shape
    others = np.delete(error, IMU_A_X, axis=0)
    assert not others.any()
    assert np.median(error[IMU_A_X]) < 0.01 < 0.1 < error[IMU_A_X].max()
    problem = prepare_residual_problem(case().recording)
    likelihood = Likelihood.of(problem, model)
    null = likelihood.fit([], budget=NULL_HYPOTHESIS)
    pulses = np.zeros_like(model.residuals)
    at = np.argsort(error[IMU_A_X])[-6:]
    pulses[IMU_A_X, at] = 0.9 * error[IMU_A_X, at]

    def simulated(residuals: FloatArray) -> int:
        as_wrong = replace(model, residuals=residuals, systematic=None)
        log = with_pulses(PULSES_S, 1.5)
        of = Likelihood.of(prepare_residual_problem(log), model)
        hidden = downweighted_residuals(of, null, as_wrong, None)
        assert hidden is not None
        return hidden.simulated

    assert simulated(pulses) == 0
    assert simulated(np.roll(pulses, 25, axis=1)) > 0


@pytest.mark.slow
def test_episodes_have_their_times_channel_and_size() -> None:
    hidden = hidden_by(PULSES_S)
    assert hidden is not None
    assert hidden.is_material
    assert [round(x.begin_s) for x in hidden.episodes] == [round(x) for x in PULSES_S]
    for episode in hidden.episodes:
        assert episode.channel == "imu_a_y"
        assert episode.size == pytest.approx(1.5, abs=0.3)
        assert 0.1 < episode.end_s - episode.begin_s < 0.8
    assert hidden.equations == ("v_y",)
    assert 0.0 < hidden.share < 1.0
    assert all(x.share > 0.0 for x in hidden.episodes)
    assert sum(x.share for x in hidden.episodes) == pytest.approx(hidden.share)
    assert note_on(hidden)[0].startswith(
        "residuals, or means of up to 0.8 s, exceed 8 standard deviations in 6 episodes of 0."
    )


@pytest.mark.slow
def test_weak_pulses_are_episodes_though_no_residual_is_beyond_noise() -> None:
    """Five standard deviations of a bin, 15 of the mean over 0.4 s."""
    noise = prepare_residual_problem(case().recording).bin_noise[1]
    hidden = hidden_by(PULSES_S, 5.0 * noise)
    assert hidden is not None
    assert hidden.is_material
    assert hidden.is_most
    assert [round(x.begin_s) for x in hidden.episodes] == [round(x) for x in PULSES_S]
    for episode in hidden.episodes:
        assert episode.channel == "imu_a_y"
        assert episode.size == pytest.approx(5.0 * noise, rel=0.5)
        assert episode.sigmas > 8.0
        assert 0.1 < episode.end_s - episode.begin_s < 1.0
    assert hidden.equations == ("v_y",)


@pytest.mark.slow
def test_one_accident_is_noted_and_not_material() -> None:
    hidden = hidden_by(PULSES_S[:1])
    assert hidden is not None
    assert not hidden.is_material
    assert len(hidden.episodes) == 1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "pulses_s", "episodes"),
    # A wave fits the spectrum of six pulses; then without pulses, or a formula of the drive.
    [("wave:0.09:0", PULSES_S, True), ("wave:0.09:0", (), False), ("speed", PULSES_S, False)],
)
def test_episodes_describe_more_than_a_wave_that_fits_them(
    name: str, pulses_s: Sequence[float], episodes: bool
) -> None:
    problem = prepare_residual_problem(with_pulses(pulses_s, 1.5))
    likelihood = Likelihood.of(problem, surrogate())
    null = likelihood.fit([], budget=NULL_HYPOTHESIS)
    out = problem.run(*likelihood.simulation_inputs(null.nuisances, ()))
    signals = feature_signals(problem, out)
    added = active_feature("v_y", name, feature(name).function(signals))
    fitted = likelihood.fit([added], nuisances=null.nuisances, budget=FEATURE_REFIT)
    lap = find_lap(problem)
    assert episodes_describe_more(likelihood, fitted, null, surrogate(), lap) is episodes
    assert not episodes_describe_more(likelihood, null, null, surrogate(), lap)
    every = episodes_describe_more(likelihood, fitted, null, surrogate(), lap, of_time_only=False)
    assert every is bool(pulses_s)


def material(
    seconds: int, simulated: int = 0, exposure: float = 1.0, recordings: int = 1
) -> Downweighted:
    episode = Episode(35.2, 35.8, "imu_a_y", 1.4, 20.0, 3.0, 4.0, 120.0)
    return Downweighted(
        (episode,) * seconds, seconds, simulated, exposure, recordings, 0.4, ("v_y", "yaw_rate")
    )


@pytest.mark.parametrize(
    ("seconds", "simulated", "is_material"),
    [(4, 0, False), (5, 0, True), (8, 2, False), (9, 2, True), (13, 5, False), (14, 5, True)],
)
def test_what_the_simulation_has_as_well_is_not_material(
    seconds: int, simulated: int, is_material: bool
) -> None:
    assert material(seconds, simulated).is_material is is_material


def test_a_longer_simulation_without_episodes_says_more() -> None:
    assert not material(4).is_material
    assert material(4, exposure=0.1).is_material
    assert material(4, exposure=0.1).expected == 0.0


def test_accidents_are_those_of_every_recording() -> None:
    assert material(4, exposure=0.0).is_material
    assert not material(4, exposure=0.0, recordings=3).is_material


@pytest.mark.slow
def test_episodes_are_material_for_a_surrogate_from_a_file() -> None:
    content = yaml.safe_load(simulation_yaml(surrogate()))
    known = validate("model", content, SurrogateFile).surrogate()
    log = with_pulses(PULSES_S, 1.5)
    problem = prepare_residual_problem(log)
    likelihood = Likelihood.of(problem, known)
    null = likelihood.fit([], budget=NULL_HYPOTHESIS)
    hidden = downweighted_residuals(likelihood, null, known, find_lap(problem))
    assert hidden is not None
    assert hidden.exposure == 0.0
    assert hidden.is_material


def test_chance_of_episodes_is_that_of_drawn_counts() -> None:
    rng = np.random.default_rng(0)
    rate = rng.gamma(2.5, 1.0, 200_000)
    drawn = rng.poisson(1.0, rate.size) + rng.poisson(1.5 * rate)
    assert material(7, 2, 1.5).chance() == pytest.approx(np.mean(drawn >= 7), abs=0.005)


def decision(verdict: str, unexplained: UnexplainedResidual | None = None) -> Decision:
    return Decision(verdict, [], unexplained, Hypothesis((), np.zeros(0), 0.0), None)


def test_episodes_rule_out_the_verdict_none() -> None:
    changed = with_episodes(decision(NONE), material(5))
    assert changed.verdict == UNKNOWN
    assert changed.unexplained is not None
    assert changed.unexplained.equations == ["v_y", "yaw_rate"]
    assert changed.unexplained.text == (
        "lateral acceleration against time: 5 episodes of 0.6 to 0.6 s, the largest at 35.2 s; "
        "yaw acceleration against time: 5 episodes of 0.6 to 0.6 s, the largest at 35.2 s"
    )
    for same in (decision(NONE), decision(EXPLAINED)):
        assert with_episodes(same, material(2)) is same
        assert with_episodes(same, None) is same
    explained = decision(EXPLAINED)
    assert with_episodes(explained, material(5)) is explained


def test_episodes_describe_what_is_known_to_be_unexplained_if_most_is_in_them() -> None:
    assert material(5).describes(True)
    assert not material(4).describes(False)
    elsewhere = replace(material(5), share_of_excess=0.3)
    assert elsewhere.describes(False)
    assert not elsewhere.describes(True)
    assert replace(material(5), counted_s=9.0).is_rule


def test_an_episode_takes_at_least_a_second() -> None:
    beyond = np.zeros((6, 500), dtype=bool)
    assert _seconds(beyond) == 0
    beyond[0, 100] = beyond[1, 102] = True
    assert _seconds(beyond) == 1
    # Of 1.2 s, and one after more than a second.
    beyond[3, 100:130] = True
    beyond[2, 200:220] = True
    assert _seconds(beyond) == 2 + 1


def test_episodes_do_not_replace_a_formula() -> None:
    terms = (FeatureTerm("v_x", "speed", 0.1, 50.0),)
    formula = decision(UNKNOWN, UnexplainedResidual(["v_x"], 0.3, "text", "expression", terms))
    assert with_episodes(formula, material(5)) is formula
    nothing = decision(UNKNOWN, UnexplainedResidual(["v_x"], 0.3, "a structured residual", ""))
    kept = with_episodes(nothing, material(5), keep_text=True).unexplained
    assert kept is not None
    assert kept.text.endswith("at 35.2 s; a structured residual")
    replaced = with_episodes(nothing, material(5)).unexplained
    assert replaced is not None
    assert replaced.share == 0.3
    assert replaced.text.startswith("lateral acceleration against time: 5 episodes")
