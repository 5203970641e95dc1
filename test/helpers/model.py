# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Small models with random encoders, and samples to feed them."""

import functools
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import torch

from adk_ros.model.adaptation.online_methods import OnlineSettings
from adk_ros.model.estimation.observer_gains import ObserverGains
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.lifting.encoder import Lifting, input_size
from adk_ros.model.lifting.encoder_kernels import EncoderArrays
from adk_ros.model.lifting.scaling import Scaling
from adk_ros.model.lifting.single_track import SingleTrackParameters
from adk_ros.model.prediction import Prediction
from adk_ros.model.predictor import Predictor
from adk_ros.signals.channels import TICK_NS, Flag, Sample
from adk_ros.train.network import Encoder, Lift, to_torchscript
from adk_ros.train.quadratic_features import QuadraticFeatures, input_columns
from adk_ros.train.single_track_fit import SingleTrack, single_track_arrays

Array = npt.NDArray[np.float64]
START_NS = 68_000_000_000 * TICK_NS
HISTORY, FEATURES = 2, 4


@functools.cache
def program(
    history: int = HISTORY,
    features: int = FEATURES,
    hidden: int = 8,
    is_quadratic: bool | None = None,
) -> bytes:
    """
    A TorchScript encoder with random weights, of the form that can be compiled.

    `is_quadratic`: with a single-track model, see `car_model`; None: without one.
    """
    single = None if is_quadratic is None else car_model(history, is_quadratic)
    with torch.random.fork_rng():
        torch.manual_seed(0)
        return to_torchscript(random_lift(history, hidden, features, single))


CAR = SingleTrackParameters(1.2, 1.5, 13.0, 15.0, 0.9, 0.95, 0.55, 0.0015, 0.1, 3e-4, 0.2, 5.0)


def car_model(history: int, is_quadratic: bool = True) -> SingleTrack:
    """A single-track model whose training data end within what `slalom` drives."""
    limits = np.array([
        [14.0, -300.0, -0.06, -0.05, -0.05, -3.0],
        [19.0, 500.0, 0.06, 0.05, 0.05, 3.0],
        [2.0, 0.0125, 80.0, 100.0, 100.0, 1.6],
    ])  # fmt: skip
    single = single_track_arrays(CAR, (0.05, 0.08), limits, SCALING, history)
    return single.with_quadratic(is_quadratic)


def random_lift(
    history: int, hidden: int, features: int, single: SingleTrack | None = None
) -> Lift:
    """
    An encoder with torch's random weights; of two or more features the last is quadratic.

    With a single-track model the last six are its features, three of them also quadratic.
    """
    columns, k = input_columns(history), int(features > 1)
    if single is not None:
        k, features = 3, features - 3

    def normal(*shape: int) -> npt.NDArray[np.float32]:
        values: npt.NDArray[np.float32] = torch.randn(*shape).numpy()
        return values

    n = input_size(history)
    reach, directions = np.full(n, 1.5, np.float32), np.zeros((n, 5), np.float32)
    directions[columns] = 0.3 * normal(columns.size, 5)
    forms = QuadraticFeatures(reach, directions, 0.3 * normal(5, k), 0.1 * normal(n, k), normal(k))
    encoder = Encoder(history, hidden, features - k, forms, single)
    features += 3 * (single is not None)
    return Lift(encoder, torch.zeros(features), torch.ones(features))


def weights(lift: Lift) -> EncoderArrays:
    """The arrays that the kernels take."""
    columns = np.flatnonzero(lift.directions.any(dim=1).numpy())
    given: dict[str, Any] = {name: value.numpy() for name, value in lift.state_dict().items()}
    given["input_bound"] = given["reach"]
    given |= {"columns": columns, "directions": given["directions"][columns]}
    empty = {"car": np.zeros(0), "command_filter": np.zeros((len(given["w1"]), 2))}
    empty |= {"limits": np.zeros((3, 6))}
    for name, value in empty.items():
        stored = given.get(f"single_track.{name}", value)
        given[name] = stored.astype(np.float32)
    return EncoderArrays(**{name: given[name] for name in EncoderArrays._fields})


@functools.cache
def plain_program(n_in: int, features: int = FEATURES) -> bytes:
    """An encoder of another form, which cannot be compiled."""
    with torch.random.fork_rng():
        torch.manual_seed(0)
        linear = torch.nn.Linear(n_in, features)
        return to_torchscript(torch.nn.Sequential(linear, torch.nn.Tanh()))


SCALING = Scaling(
    x_mean=np.array([15.0, 0.0, 0.05]),
    x_scale=np.array([5.0, 0.3, 0.25]),
    u_mean=np.array([100.0, 0.0]),
    u_scale=np.array([400.0, 0.05]),
    step_scale=np.array([0.02, 0.05, 0.08]),
)


def slow(gain: float, decay: float = 1.0, **changes: Any) -> ObserverGains:
    """Gains of a slow disturbance on all channels, with `changes`."""
    gains = {"slow_gain": np.full(3, gain), "slow_decay": np.full(3, decay)}
    return replace(ObserverGains.none(), **gains | changes)


def make_model(**changes: Any) -> KoopmanModel:
    """A stable model with random weights; `compiled=False` removes the compiled encoder."""
    history, features = changes.pop("history", HISTORY), changes.pop("features", FEATURES)
    compiled = changes.pop("compiled", True)
    affine = changes.get("affine", True)
    residual = changes.get("residual", True)
    single = changes.pop("is_quadratic", None)
    encoder = program(history, features, is_quadratic=single)
    lifting = Lifting(encoder, input_size(history), features)
    if not compiled:
        lifting.compiled = None
    random = np.random.default_rng(0)
    n_z = 3 + features
    theta0 = random.normal(0.0, 0.02, (n_z, n_z + 2 + affine))
    if single is not None:
        theta0[:3, n_z - 6 : n_z - 3] += np.eye(3)
    if not residual:
        theta0[:, :n_z] += 0.95 * np.eye(n_z)
    steps = np.arange(1, 81)[:, None, None]
    given: dict[str, Any] = {
        "lifting": lifting,
        "scaling": SCALING if residual else without_steps(SCALING),
        "theta0": theta0,
        "history": history,
        "residual": residual,
        "affine": affine,
        "relift": True,
        "observer_gains": slow(0.05, 0.97),
        "horizon_covariance": steps * np.diag([0.01, 0.004, 0.001]),
        "mean_square_change": np.zeros((0, 3)),
        "uses_imu": True,
        "online": OnlineSettings("windowed", window=100, ridge=1.0),
    }
    return KoopmanModel(**given | changes)


def paper_model(**changes: Any) -> KoopmanModel:
    """
    The paper's form: no history, not affine, not residual, linear rollout in the lifted space.
    """
    form = {
        "history": 0, "residual": False, "affine": False, "relift": False,
        "observer_gains": ObserverGains.none(),
        "horizon_covariance": np.zeros((0, 3, 3)), "online": OnlineSettings("swls", window=60),
    }  # fmt: skip
    return make_model(**form | changes)


def without_steps(scaling: Scaling) -> Scaling:
    """Return the scaling with a step scale of one."""
    return Scaling(scaling.x_mean, scaling.x_scale, scaling.u_mean, scaling.u_scale, np.ones(3))


def sample(k: int, x: Iterable[float], u: Iterable[float], flags: int = 0) -> Sample:
    """Return the sample of tick k."""
    v_x, v_y, yaw_rate = map(float, x)
    torque, steering = map(float, u)
    stamp_ns = START_NS + k * TICK_NS
    return Sample(stamp_ns, (v_x, v_y, yaw_rate), (torque, steering), (0.0, 0.0), flags)


def inputs(n: int, seed: int = 0) -> Array:
    """Commands (n, 2), SI, that excite the vehicle: slow sines with noise."""
    random = np.random.default_rng(seed)
    t = np.arange(n)[:, None] * 0.025
    swings = np.sin(t * [1.1, 0.7]) + 0.5 * np.sin(t * [2.3, 3.1] + 1.0)
    result: Array = SCALING.u_mean + SCALING.u_scale * (swings + random.normal(0, 0.3, (n, 2)))
    return result


def slalom(n: int, seed: int = 0) -> Iterator[Sample]:
    """A smooth recording with a little noise, not generated by a model."""
    random = np.random.default_rng(seed)
    u = inputs(n, seed)
    for k in range(n):
        t = 0.025 * k
        x = np.array([15 + 3 * np.sin(0.4 * t), -0.2 * np.sin(0.9 * t), 0.3 * np.sin(0.9 * t)])
        flags = int(Flag.RESTART) if k == 0 else 0
        yield sample(k, x + random.normal(0, 1e-3, 3), u[k], flags)


def fold(predictor: Predictor, samples: Iterable[Sample]) -> list[Prediction | None]:
    """Step through `samples`."""
    return [predictor.step(item) for item in samples]
