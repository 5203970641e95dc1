# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Small calls of every kernel that the commands and the node use.

Numba compiles a kernel for the argument types of a call. Each function below therefore runs one
flow on a few samples, through the same functions as the flow itself.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from adk_ros.mismatch.deployment.surrogate_file import NamedSurrogate
    from adk_ros.mismatch.recording.sensor_log import SensorLog
    from adk_ros.model.adaptation.online_methods import OnlineSettings
    from adk_ros.model.koopman import KoopmanModel

_STEPS = 80
"""Horizon of the small models, in steps of 25 ms: the node's default."""
_LOG_S, _RADIUS_M, _SPEED = 40.0, 30.0, 10.0
"""Duration, s, radius and speed, m/s, of the circle that the small recording drives twice."""


def predict() -> None:
    """Predict as the node and `adk replay`, `rollout` and `train` do, adapting online."""
    from adk_ros.model.pipeline import PipelineSettings
    from adk_ros.ros.core import warm_up

    # The first adapts by windowed least squares, the second by recursive least squares.
    for model in (_small_model(), _small_paper_model()):
        warm_up(model, PipelineSettings(horizon_steps=_STEPS))
        roll_out_model(model)


def roll_out_model(model: KoopmanModel) -> None:
    """Predict under known commands, as `adk rollout`, evaluations and planners do."""
    from adk_ros.model.predictor import Predictor
    from adk_ros.signals.channels import TICK_NS, Sample

    predictor = Predictor(model, horizon_steps=0)
    for k in range(1, model.history + 3):
        predictor.step(Sample(k * TICK_NS, (10.0, 0.0, 0.0), (0.0, 0.0), (0.0, 0.0), 0))
    predictor.rollout(np.zeros((1, 2)))
    predictor.roll_out_many(np.zeros((1, 1, 2)))
    predictor.linearized(np.zeros((1, 2)))


def simulate_vehicle() -> None:
    """Simulate with 7 and 14 degrees of freedom, as `adk simulate` does."""
    from adk_ros.plant.scenario.oracle import oracle_rollout
    from adk_ros.plant.scenario.scenario_file import load_scenario
    from adk_ros.plant.scenario.simulate import simulate

    scenario = load_scenario("handling")
    for plant in ("seven_dof", "fourteen_dof"):
        drive = simulate(scenario.model_copy(update={"plant": plant}), duration_s=0.2)
        oracle_rollout(drive, np.zeros(1, dtype=np.int64), drive.x[:1], 1)


def roll_out_vehicle() -> None:
    """Predict with a vehicle's physics, as `adk rollout --model VEHICLE` does."""
    from adk_ros.plant.identification.vehicle_rollout import rollout
    from adk_ros.plant.vehicle.vehicle_parameters import load_vehicle

    rollout(load_vehicle("imdv"), np.full((1, 3), 0.1), np.zeros((1, 1, 2)))


def compare_with_surrogate() -> None:
    """Run the surrogate along a recording, as `adk mismatch` does."""
    from adk_ros.mismatch.deployment.open_loop import OpenLoopPredictor
    from adk_ros.mismatch.surrogate.lap import find_lap
    from adk_ros.mismatch.surrogate.residuals import prepare_residual_problem

    log, surrogate = _small_log(), _small_surrogate().content
    problem = prepare_residual_problem(log)
    problem.residuals(surrogate.vector())
    find_lap(problem)
    OpenLoopPredictor(surrogate, log).predict(np.array([3.0, 3.5]), 1)
    search_features()


def search_features() -> None:
    """Evaluate features with a memory and their linear response, as for an unknown effect."""
    import numpy as np

    from adk_ros.mismatch.inference.linear_response import propagate
    from adk_ros.numerics.filters import causal_filter, low_pass, resonance, stop_operator

    signal = np.zeros(8)
    causal_filter(signal, np.ones(3))
    low_pass(signal, 0.01, 1.0)
    resonance(signal, 0.01, 3.0, 0.1)
    stop_operator(signal, 1.0)
    propagate(signal, np.ones(8), np.zeros((3, 8)), 0.01, 0)


def simulate_surrogate() -> None:
    """Drive a scenario with a surrogate, as `adk simulate --model` does."""
    from adk_ros.mismatch.deployment.scenario_drive import simulate_scenario
    from adk_ros.plant.scenario.scenario_file import load_scenario

    simulate_scenario(_small_surrogate(), load_scenario("handling"), duration_s=0.2)


Call = Callable[[], None]


def combine_a_fleet() -> None:
    """Fit the deviations of cars, as `adk fleet mismatch` does."""
    from adk_ros.fleet.inference.restricted_likelihood import Profile

    rows = np.zeros((1, 2))
    profile = Profile(
        np.eye(2)[None],
        np.zeros((1, 2)),
        rows,
        rows[:, 0],
        rows[:, 0],
        np.zeros(1, dtype=np.int64),
        np.ones(1),
        0,
        0,
        0.0,
    )
    profile.restricted(1.0, 1.0)


GROUPS: tuple[tuple[Call, ...], ...] = (
    (predict, combine_a_fleet),
    (simulate_vehicle, roll_out_vehicle, compare_with_surrogate),
)
"""What each process does. No kernel is in two groups."""
AFTER_GROUPS: tuple[Call, ...] = (simulate_surrogate,)
"""What uses kernels of several groups."""


def _small_model() -> KoopmanModel:
    """Return a model of the default form with random encoder weights that predicts no change."""
    from adk_ros.model.adaptation.online_methods import OnlineSettings
    from adk_ros.model.lifting.encoder import input_size
    from adk_ros.train.network import Encoder, Lift, as_tensor, to_torchscript
    from adk_ros.train.quadratic_features import QuadraticFeatures

    history, features = 2, 3
    n = input_size(history)

    def normal(*shape: int) -> Any:
        return np.random.default_rng(0).normal(size=shape).astype(np.float32)

    quadratic = QuadraticFeatures(
        normal(n) ** 2, normal(n, 2), normal(2, 1), normal(n, 1), normal(1)
    )
    encoder = Encoder(history, 4, features - 1, quadratic)
    lift = Lift(encoder, as_tensor(np.zeros(features)), as_tensor(np.ones(features)))
    online = OnlineSettings("windowed", window=10)
    return _model(to_torchscript(lift), history, features, online)


def _small_paper_model() -> KoopmanModel:
    """Return a model of the paper's form: no past samples, linear in the lifted space."""
    from adk_ros.model.adaptation.online_methods import OnlineSettings
    from adk_ros.train.network import PaperNetwork, to_torchscript

    program = to_torchscript(PaperNetwork(hidden=4, features=3).encoder)
    return _model(program, 0, 3, OnlineSettings("ffrls"))


def _model(program: bytes, history: int, features: int, online: OnlineSettings) -> KoopmanModel:
    from adk_ros.model.estimation.observer_gains import ObserverGains
    from adk_ros.model.koopman import KoopmanModel
    from adk_ros.model.lifting.encoder import Lifting, input_size
    from adk_ros.model.lifting.scaling import Scaling
    from adk_ros.model.uncertainty.fallback import Fallback

    default, n_z = history > 0, 3 + features
    errors = np.tile(np.eye(3), (_STEPS, 1, 1))
    return KoopmanModel(
        lifting=Lifting(program, input_size(history), features),
        scaling=Scaling(np.zeros(3), np.ones(3), np.zeros(2), np.ones(2), np.ones(3)),
        theta0=np.zeros((n_z, n_z + 2 + default)),
        history=history,
        residual=default,
        affine=default,
        relift=default,
        observer_gains=ObserverGains.none(),
        horizon_covariance=errors,
        mean_square_change=np.ones((_STEPS, 3)) if default else np.zeros((0, 3)),
        uses_imu=True,
        online=online,
        held_input_covariance=errors,
        fallback=Fallback(np.full((2, 3, _STEPS, 3), 0.1)),
    )


def _small_log() -> SensorLog:
    """Return the sensor log of a car that drives a circle twice."""
    from adk_ros.mismatch.recording.sensor_log import SensorLog

    imu_s, odometry_s = np.arange(0.005, _LOG_S, 0.01), np.arange(0.005, _LOG_S, 0.02)
    command_s = np.arange(0.0, _LOG_S, 0.025)
    rate = _SPEED / _RADIUS_M
    heading = rate * odometry_s
    east, north = _RADIUS_M * np.sin(heading), _RADIUS_M * (1.0 - np.cos(heading))
    return SensorLog(
        "circle",
        _LOG_S,
        imu_s,
        np.tile([0.0, _SPEED * rate, rate], (imu_s.size, 1)),
        odometry_s,
        np.tile([_SPEED, 0.0, rate], (odometry_s.size, 1)),
        np.column_stack([east, north, heading]),
        command_s,
        np.tile([100.0, 2.7 / _RADIUS_M], (command_s.size, 1)),
    )


def _small_surrogate() -> NamedSurrogate:
    """Return a surrogate of a packaged vehicle."""
    from adk_ros.mismatch.deployment.surrogate_file import NamedSurrogate, SurrogateFile
    from adk_ros.mismatch.library.surrogate_parameters import NAMES
    from adk_ros.mismatch.recording.nominal_vehicle import load_nominal_vehicle

    values = load_nominal_vehicle("imdv").parameters()
    parameters = dict(zip(NAMES, map(float, values), strict=True))
    return NamedSurrogate("imdv", SurrogateFile(kind="surrogate", parameters=parameters))
