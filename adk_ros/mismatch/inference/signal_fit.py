# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Signals in physical units, measured and predicted, and the fit of the predictions.

The fit of a signal y with its prediction y_hat is

    fit = 100 (1 - |y - y_hat| / |y - mean(y)|)

in percent: 100 is perfect, 0 is as good as the mean, below it is worse (normalised root mean
square error, L. Ljung, System Identification, 2nd ed., section 16.4; `compare` of MATLAB).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adk_ros.numerics.arrays import FloatArray

SIGNALS = ("v_x", "v_y", "yaw_rate", "a_x", "a_y")
SIGNAL_UNITS = ("m/s", "m/s", "rad/s", "m/s^2", "m/s^2")


@dataclass(frozen=True)
class PredictedSignals:
    """
    Signals (5, n) at `time_s` (n,), by `SIGNALS`, SI; NaN where a signal allows no statement.

    `noise` (5,): standard deviation of a measured value due to sensor noise. `source`: which data.
    """

    source: str
    time_s: FloatArray
    measured: FloatArray
    simulation: FloatArray
    corrected: FloatArray
    noise: FloatArray

    def fits(self) -> dict[str, tuple[float, float, float]]:
        """Return the fit of simulation, corrected model and a perfect model by signal, %."""
        out = {}
        for i, name in enumerate(SIGNALS):
            y = self.measured[i]
            spread = float(np.sqrt(np.nanmean((y - np.nanmean(y)) ** 2))) if _known(y) else 0.0
            perfect = 100.0 * (1.0 - self.noise[i] / spread) if spread > 0.0 else np.nan
            out[name] = (
                fit_percent(y, self.simulation[i]),
                fit_percent(y, self.corrected[i]),
                perfect,
            )
        return out


def fit_percent(measured: FloatArray, predicted: FloatArray) -> float:
    """Return the fit of a prediction (n,), %; NaN where there is nothing to compare."""
    both = np.isfinite(measured) & np.isfinite(predicted)
    y, y_hat = measured[both], predicted[both]
    if y.size < 2 or float(np.ptp(y)) == 0.0:
        return float("nan")
    return float(100.0 * (1.0 - np.linalg.norm(y - y_hat) / np.linalg.norm(y - y.mean())))


def _known(values: FloatArray) -> bool:
    return bool(np.isfinite(values).any())
