# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The part of a surrogate's YAML file that says how well it fits its simulation."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from adk_ros.files.yaml_file import FileModel
from adk_ros.mismatch.library.surrogate_parameters import INDEX, SIZE
from adk_ros.mismatch.recording.sensor_log import CHANNELS
from adk_ros.mismatch.surrogate.acceleration_envelope import AccelerationEnvelope
from adk_ros.mismatch.surrogate.error_autocovariance import MAX_LAG, ErrorAutocovariance
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.channels import STATE_NAMES

State = Literal["v_x", "v_y", "yaw_rate"]
Channel = Literal["imu_a_x", "imu_a_y", "imu_yaw_rate", "v_x", "v_y", "yaw_rate"]
_MAX_WEAK_DIRECTIONS = 32
_MAX_CLIP_LIMITS = 16
_MAX_VERTICES = 1000
_HORIZONS = 3


class AutocovarianceEntry(FileModel):
    """
    Autocovariance of one channel's residuals on the simulation.

    `values` has a row for each of the clip `limits`, with lags of 0 to 30 bins of 40 ms.
    """

    limits: list[float] = Field(min_length=1, max_length=_MAX_CLIP_LIMITS)
    values: list[list[float]]

    @model_validator(mode="after")
    def _complete(self) -> AutocovarianceEntry:
        pairs = zip(self.limits, self.limits[1:], strict=False)
        if self.limits[0] <= 0.0 or any(a >= b for a, b in pairs):
            raise ValueError("limits must be positive and ascending")
        if len(self.values) != len(self.limits):
            raise ValueError("each limit needs a row of values")
        if any(len(row) != MAX_LAG + 1 or row[0] < 0.0 for row in self.values):
            raise ValueError(f"a row has {MAX_LAG + 1} values, the first a variance")
        return self


class IdentificationEntry(FileModel):
    """
    How well the surrogate fits its simulation.

    `error`: RMS residual of 40 ms bins, SI. `weak_directions`: parameter changes of one standard
    deviation that the simulation hardly determines. `open_loop_error`: RMSE of predictions of the
    simulation 0.25, 1 and 2 s ahead, SI. `envelope`: vertices (a_x, a_y) of the hull of the
    simulated accelerations, m/s².
    """

    error: dict[Channel, float]
    autocovariance: dict[Channel, AutocovarianceEntry]
    weak_directions: list[dict[str, float]] = Field(
        default_factory=list, max_length=_MAX_WEAK_DIRECTIONS
    )
    open_loop_error: dict[State, list[float]] | None = None
    envelope: list[list[float]] | None = Field(default=None, max_length=_MAX_VERTICES)

    @model_validator(mode="after")
    def _complete(self) -> IdentificationEntry:
        if set(self.error) != set(CHANNELS) or set(self.autocovariance) != set(CHANNELS):
            raise ValueError(f"error and autocovariance need {', '.join(CHANNELS)}")
        if len({len(entry.limits) for entry in self.autocovariance.values()}) != 1:
            raise ValueError("all channels need the same number of limits")
        open_loop = self.open_loop_error
        if open_loop is not None and (
            set(open_loop) != set(STATE_NAMES)
            or any(len(row) != _HORIZONS or min(row) < 0.0 for row in open_loop.values())
        ):
            raise ValueError(f"open_loop_error needs {_HORIZONS} errors of each state")
        pairs = all(len(vertex) == 2 for vertex in self.envelope or [])
        if self.envelope is not None and (not pairs or self.acceleration_envelope() is None):
            raise ValueError("envelope needs vertices [a_x, a_y] that span an area")
        for name in (name for row in self.weak_directions for name in row):
            if name not in INDEX:
                raise ValueError(f"parameter '{name}' is unknown")
        return self

    def errors(self) -> FloatArray:
        """Return the error (6,) by channel."""
        by_name = {str(name): value for name, value in self.error.items()}
        return np.array([by_name[name] for name in CHANNELS])

    def error_autocovariance(self) -> ErrorAutocovariance:
        """Return the autocovariance of the error."""
        by_name = {str(name): entry for name, entry in self.autocovariance.items()}
        entries = [by_name[name] for name in CHANNELS]
        return ErrorAutocovariance(
            np.array([entry.limits for entry in entries]),
            np.array([entry.values for entry in entries]),
        )

    def open_loop_errors(self) -> FloatArray | None:
        """Return the open-loop error (horizons, 3), if the file holds it."""
        if self.open_loop_error is None:
            return None
        by_name = {str(name): row for name, row in self.open_loop_error.items()}
        return np.asarray(np.transpose([by_name[name] for name in STATE_NAMES]))

    def directions(self) -> FloatArray:
        """Return the weak directions (k, SIZE)."""
        out = np.zeros((len(self.weak_directions), SIZE))
        for row, entry in zip(out, self.weak_directions, strict=True):
            for name, value in entry.items():
                row[INDEX[name]] = value
        return out

    def acceleration_envelope(self) -> AccelerationEnvelope | None:
        """Return the hull of the simulated accelerations, if the file holds it."""
        if self.envelope is None:
            return None
        return AccelerationEnvelope.of(np.array(self.envelope))
