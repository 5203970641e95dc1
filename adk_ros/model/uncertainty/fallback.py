# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Naive predictors that take over where the model has not been shown to be better.

    y_h = m_h + sum_i w_ih (n_ih - m_h)

m: prediction of the model, n_i: of naive predictor i, h: horizon step. Training finds the weights
w for each channel, see `adk_ros.train.fallback_weights`. They change what is predicted, not the
model: its observer and its adaptation work on m. Where all w are zero, y is m.

With commands known, a weight W_h of IMU integration is also learned while driving, from monitored
rollouts (see `rollout_monitor`), for cars and conditions unlike those of the training: the weights
become (1 - W) w_i, and that of IMU integration W more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.numerics.numba_cache import strict_kernel
from adk_ros.signals.channels import STATE_NAMES
from adk_ros.signals.score import DISPLAY_NAMES, HORIZON_STEPS, NAIVE_PREDICTORS, TICK_S

KNOWN, HELD = 0, 1
"""Index of the weights: future commands known, and held constant as in published horizons."""
COMMANDS = ("known", "held")
_PERSISTENCE, _LINEAR_EXTRAPOLATION, _IMU_INTEGRATION = range(len(NAIVE_PREDICTORS))


class Takeover(NamedTuple):
    """Where a naive predictor takes over: scored horizons with the weight at each."""

    channel: str
    commands: str
    predictor: str
    horizons_s: tuple[float, ...]
    weights: tuple[float, ...]

    def as_json(self) -> dict[str, Any]:
        """Return it for the manifest of a model."""
        return self._asdict() | {
            "horizons_s": list(self.horizons_s),
            "weights": list(self.weights),
        }

    @property
    def text(self) -> str:
        """It as a line."""
        pairs = zip(self.weights, self.horizons_s, strict=True)
        weights = ", ".join(f"{weight:.2f} at {horizon:g} s" for weight, horizon in pairs)
        return f"{self.channel}, commands {self.commands}: {self.predictor}, weight {weights}"


@dataclass(frozen=True)
class Fallback:
    """
    The weights (2, 3, steps, 3) of the naive predictors, by kind of commands, predictor and step.

    First with future commands `KNOWN`, then `HELD`; predictors as in `NAIVE_PREDICTORS`. The sum
    over the predictors is from 0 (the model alone) to 1. Later steps of a longer horizon have the
    last weights. Without a step, the model is alone.
    """

    weights: FloatArray

    @staticmethod
    def none() -> Fallback:
        """Return one that leaves the model alone."""
        return Fallback(np.zeros((len(COMMANDS), len(NAIVE_PREDICTORS), 0, len(STATE_NAMES))))

    @staticmethod
    def alone(has_imu: bool) -> Fallback:
        """
        Return one that leaves nothing to the model, for a recording without its inputs.

        IMU integration predicts v_x, without an IMU persistence; v_y and yaw rate persist.
        """
        weights = np.zeros((len(COMMANDS), len(NAIVE_PREDICTORS), 1, len(STATE_NAMES)))
        weights[:, _IMU_INTEGRATION if has_imu else _PERSISTENCE, :, 0] = 1.0
        weights[:, _PERSISTENCE, :, 1:] = 1.0
        return Fallback(weights)

    @property
    def is_active(self) -> bool:
        """Whether a naive predictor takes over anywhere."""
        return bool(self.weights.any())

    def takeovers(self) -> list[Takeover]:
        """Return where naive predictors take over, by channel, kind of commands and predictor."""
        result = []
        scored = [step for step in HORIZON_STEPS if step <= self.weights.shape[2]]
        for c, channel in enumerate(STATE_NAMES):
            for by_predictor, commands in zip(self.weights, COMMANDS, strict=True):
                for table, name in zip(by_predictor, NAIVE_PREDICTORS, strict=True):
                    used = [step for step in scored if table[step - 1, c] > 0.0]
                    if used:
                        result.append(
                            Takeover(
                                channel,
                                commands,
                                DISPLAY_NAMES.get(name, name),
                                tuple(round(step * TICK_S, 3) for step in used),
                                tuple(float(table[step - 1, c]) for step in used),
                            )
                        )
        return result


def summary(takeovers: Sequence[Takeover]) -> str:
    """Return in one line which naive predictors take over, without weights; empty if none does."""
    by_place: dict[tuple[str, str], list[float]] = {}
    for item in takeovers:
        by_place.setdefault((item.channel, item.predictor), []).extend(item.horizons_s)
    parts = [
        f"{channel} {predictor} "
        + (f"{min(at):g} to {max(at):g} s" if min(at) < max(at) else f"{at[0]:g} s")
        for (channel, predictor), at in by_place.items()
    ]
    return ", ".join(parts)


class FallbackArrays(NamedTuple):
    """
    What kernels see of a fallback and of the samples that naive predictors start from, SI.

    `weights`: present ones, by kind of commands, predictor, step and channel; `trained`: those of
    `Fallback`. Without a step if nothing is ever mixed. `start` (4, 3): the last measured state;
    its change over a tick; a_x and a_y; the present state by IMU integration since that
    measurement. NaN where unknown. `of_model` (3,): the model's prediction for the next tick.
    `coasted` (1,): ticks since that measurement.
    """

    weights: FloatArray
    start: FloatArray
    of_model: FloatArray
    trained: FloatArray
    coasted: IntArray


def fallback_arrays(fallback: Fallback, monitored_steps: int) -> FallbackArrays:
    """
    Return the arrays of a predictor that has seen no sample.

    :param monitored_steps: of the rollouts that weights are learned from, 0 if they are not.
    """
    used = fallback.weights if fallback.is_active else Fallback.none().weights
    known = used.shape[2]
    if monitored_steps:
        index = np.minimum(np.arange(max(monitored_steps, known)), max(known - 1, 0))
        empty = np.zeros((len(COMMANDS), len(NAIVE_PREDICTORS), index.size, len(STATE_NAMES)))
        used = used[:, :, index] if known else empty
    return FallbackArrays(
        np.array(used, dtype=np.float64, order="C"),
        np.full((4, 3), np.nan),
        np.full(3, np.nan),
        np.array(used, dtype=np.float64, order="C"),
        np.zeros(1, np.int64),
    )


def take_sample(
    state: FloatArray, a: tuple[float, float], is_continuation: bool, fallback: FallbackArrays
) -> None:
    """
    Take the measured state (3,) and the specific force `a` of a tick, SI.

    `is_continuation`: the state follows the last one; otherwise that one's change is kept.
    """
    start, ticks = fallback.start, fallback.coasted[0] + 1
    if is_continuation:
        start[1] = (state - start[0]) / ticks
    start[0] = start[3] = state
    start[2, :2] = a
    fallback.coasted[0] = 0


def coast(a: tuple[float, float], fallback: FallbackArrays) -> None:
    """
    Take the specific force `a` of a tick without a measured state, SI.

    What persists or goes on in a line does so from the last measurement; the IMU is integrated.
    """
    start = fallback.start
    integrate_imu(start, start[3:])
    start[2, :2] = a
    fallback.coasted[0] += 1


@strict_kernel
def integrate_imu(start: FloatArray, out: FloatArray) -> None:
    """
    Write the states (h, 3), SI, from now on at the present specific force and yaw rate.

    NaN where they are unknown; `start` (4, 3) as in `FallbackArrays`.
    """
    v_x, v_y, rate = start[3, 0], start[3, 1], start[3, 2]
    a_x, a_y = start[2, 0], start[2, 1]
    angle = rate * TICK_S
    cos, sin = np.cos(angle), np.sin(angle)
    into, across = TICK_S, 0.0
    if abs(angle) >= 1e-9:
        into, across = sin / angle * TICK_S, (1.0 - cos) / angle * TICK_S
    for i in range(out.shape[0]):
        v_x, v_y = (
            cos * v_x + sin * v_y + into * a_x + across * a_y,
            -sin * v_x + cos * v_y - across * a_x + into * a_y,
        )
        out[i, 0], out[i, 1], out[i, 2] = v_x, v_y, rate


@strict_kernel
def learn_weight(h: int, c: int, weight: float, fallback: FallbackArrays) -> None:
    """Give IMU integration a weight learned for a step and a channel, with commands known."""
    for p in range(fallback.weights.shape[1]):
        fallback.weights[KNOWN, p, h, c] = (1.0 - weight) * fallback.trained[KNOWN, p, h, c]
    fallback.weights[KNOWN, _IMU_INTEGRATION, h, c] += weight


@strict_kernel
def weighted_naive(
    fallback: FallbackArrays, commands: int, as_trained: bool, out: FloatArray
) -> None:
    """
    Write the weight of all naive predictors and the weighted sum of their states: out (h, 2, 3).

    SI; by the equations of `adk_ros.signals.score`, from the last measurement on. A predictor
    counts only where it is known. Without an IMU the weights are as trained: what was learned is
    that of its integration. Ticks since the measurement count as steps, under known commands; in a
    horizon that holds the commands from now on, weights of both kinds count, by the share of steps
    of either.
    """
    start, passed = fallback.start, fallback.coasted[0]
    of_imu = np.empty((out.shape[0], 3))
    integrate_imu(start, of_imu)
    knows_imu = np.isfinite(start[2, 0] + start[2, 1] + start[3, 0] + start[3, 1])
    weights = fallback.trained if as_trained or not knows_imu else fallback.weights
    last = weights.shape[2] - 1
    for i in range(out.shape[0]):
        since = min(i + passed, last)
        # The command of the first step is known; without a tick before, it is a held one's too.
        share = i / (i + passed) if passed > 0 else 1.0
        for c in range(3):
            out[i, 0, c] = out[i, 1, c] = 0.0
            for p in range(weights.shape[1]):
                weight = weights[KNOWN, p, since, c]
                if commands != KNOWN:
                    weight += share * (weights[commands, p, since, c] - weight)
                if not weight > 0.0:
                    continue
                state = start[0, c]
                if p == _LINEAR_EXTRAPOLATION:
                    state += (i + 1 + passed) * start[1, c]
                elif p == _IMU_INTEGRATION:
                    state = of_imu[i, c]
                if np.isfinite(state):
                    out[i, 0, c] += weight
                    out[i, 1, c] += weight * state


@strict_kernel
def take_over(horizon: FloatArray, commands: int, fallback: FallbackArrays) -> None:
    """Let the naive predictors take over in `horizon` (h, 3), SI, by their weights."""
    if fallback.weights.shape[2] == 0:
        return
    naive = np.empty((horizon.shape[0], 2, 3))
    weighted_naive(fallback, commands, False, naive)
    for i in range(horizon.shape[0]):
        for c in range(3):
            if naive[i, 0, c] > 0.0:
                horizon[i, c] += naive[i, 1, c] - naive[i, 0, c] * horizon[i, c]


@strict_kernel
def take_over_published(horizon: FloatArray, fallback: FallbackArrays) -> None:
    """Run `take_over` on a horizon to be published; keep the model's prediction of one tick."""
    fallback.of_model[:] = horizon[0]
    take_over(horizon, HELD, fallback)
