# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Corroboration: whether measured channels show what is claimed, in data that it was not fitted to.

A simulation of the right car leaves noise once the missing physics is named. Where much is left,
as with a generic simulation of a real car, effects and formulas fit what they do not explain. Then
each claim must lower the loss on held-out data in two measured channels: a force shows in an
acceleration and in a velocity, a moment in the gyro and in odometry, and a fault of the model in
one alone. A copy of a channel is no second measurement.
"""

from __future__ import annotations

import numpy as np
from scipy.stats import wilcoxon

from adk_ros.mismatch.inference.block_scores import block_duration
from adk_ros.mismatch.inference.feature_effect import FeatureEffect
from adk_ros.mismatch.inference.fit_budget import ABLATION
from adk_ros.mismatch.inference.hypothesis import ActiveEffect, Hypothesis
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.library.criteria import (
    CORROBORATION_LEVEL,
    MAX_NORMALISED_LOSS,
    MIN_CORROBORATING_BLOCKS,
    MIN_CORROBORATING_CHANNELS,
)
from adk_ros.mismatch.library.sensitivity import decided
from adk_ros.mismatch.recording.sensor_log import CHANNELS, SensorLog
from adk_ros.mismatch.surrogate.residuals import BIN_S
from adk_ros.numerics.arrays import BoolArray, FloatArray
from adk_ros.numerics.levenberg_marquardt import huber_values

_A_Y, _GYRO, _YAW_RATE = (CHANNELS.index(x) for x in ("imu_a_y", "imu_yaw_rate", "yaw_rate"))
_COPY_TOLERANCE = 0.01
"""RMS difference over RMS below which two channels are one measurement: an interpolation of the
other. Two sensors differ by the noise of both: with 0.003 rad/s at a yaw rate of 0.2 rad/s 2 %.
"""


def is_corroborated(
    h: Hypothesis, training: Likelihood, whole: Likelihood, expected: float
) -> bool:
    """
    Whether at least two measured channels show each effect and formula of a hypothesis.

    One where no IMU counts: nothing else measures a force or a moment a second time.
    True where the loss after them is less than `MAX_NORMALISED_LOSS` times that of a perfect
    model, `expected`, and no channel is missing: that is evidence in itself. `training`:
    likelihood of the part before the held-out one, `whole`: of all data.
    """
    fits = decided(
        lambda ratio: h.loss < ratio * max(expected, 1.0), MAX_NORMALISED_LOSS=MAX_NORMALISED_LOSS
    )
    if not whole.unobservable and fits:
        return True
    causes = dict.fromkeys(_cause(active) for active in h.effects)
    for cause in causes:
        others = [active for active in h.effects if _cause(active) != cause]
        without = training.fit(others, nuisances=h.nuisances, budget=ABLATION)
        shown = corroborating_channels(training, whole, h, without)
        if _too_few(len(shown), _has_imu(whole)):
            return False
    return True


def _too_few(shown: int, has_imu: bool) -> bool:
    """Whether too few channels show a cause: without an IMU, one is enough."""
    if not has_imu:
        return shown < 1
    return bool(
        decided(lambda least: shown < least, MIN_CORROBORATING_CHANNELS=MIN_CORROBORATING_CHANNELS)
    )


def _has_imu(likelihood: Likelihood) -> bool:
    """Whether any channel of an IMU has weight."""
    counts: BoolArray = np.asarray((likelihood.weights > 0.0).any(axis=1))
    return any(x for name, x in zip(CHANNELS, counts, strict=True) if name.startswith("imu_"))


def _cause(active: ActiveEffect) -> str:
    """Return what an effect stands for: a feature in two equations is one cause."""
    effect = active.effect
    return effect.feature if isinstance(effect, FeatureEffect) else effect.name


def corroborating_channels(
    training: Likelihood, whole: Likelihood, h: Hypothesis, without: Hypothesis
) -> list[str]:
    """
    Return the channels in which `h` has less loss than `without` on held-out data.

    Wilcoxon's signed-rank test over blocks of driving that counts: a term that acts hard in one
    bend and little in another gains very different amounts, of which a mean and its deviation say
    little. Over all data where too few blocks are held out for a significant result.
    """
    size = round(block_duration(whole.problem.log.length_scale) / BIN_S)
    counted: BoolArray = np.asarray((whole.weights > 0.0).any(axis=0))
    bins = training.held_out_bins() & counted
    if np.count_nonzero(bins) < MIN_CORROBORATING_BLOCKS * size:
        bins = counted
    gains = _losses(whole, without, bins) - _losses(whole, h, bins)
    blocks = gains.shape[1] // size
    if blocks < MIN_CORROBORATING_BLOCKS:
        return []
    sums = gains[:, : blocks * size].reshape(len(CHANNELS), blocks, size).sum(axis=2)
    shown = np.array([_is_positive(row) for row in sums], dtype=bool)
    rate, a_y = _copies(whole.problem.log)
    shown[_GYRO] &= not (rate and shown[_YAW_RATE])
    shown[_A_Y] &= not (a_y and (shown[_GYRO] or shown[_YAW_RATE]))
    return [name for name, yes in zip(CHANNELS, shown, strict=True) if yes]


def _is_positive(gains: FloatArray) -> bool:
    """Whether the gains of blocks (n,) are positive, beyond chance."""
    if not np.any(gains):
        return False
    return bool(wilcoxon(gains, alternative="greater").pvalue < CORROBORATION_LEVEL)


def _losses(likelihood: Likelihood, h: Hypothesis, bins: BoolArray) -> FloatArray:
    """Return the loss (6, b) of a hypothesis in some bins."""
    p, terms = likelihood.simulation_inputs(h.nuisances, h.effects)
    return huber_values(likelihood.whiten(likelihood.channel_residuals(p, terms)))[:, bins]


def _copies(log: SensorLog) -> tuple[bool, bool]:
    """Return whether the gyro is odometry's yaw rate, and a_y speed times yaw rate."""
    a_y, gyro = (np.interp(log.odometry_s, log.imu_s, log.imu[:, i]) for i in (1, 2))
    pairs = ((gyro, log.odometry[:, 2]), (a_y, log.odometry[:, 0] * log.odometry[:, 2]))
    copied = [np.std(x - y) < _COPY_TOLERANCE * np.std(y) for x, y in pairs]
    return bool(copied[0]), bool(copied[1])
