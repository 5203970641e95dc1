# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Residuals of several recordings of one car, one after the other on one axis of time.

Each recording is a separate residual problem: the model starts at its first measurement, and no
smoothing, filter or distance runs across a joint. Steps and bins are numbered through.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from adk_ros.mismatch.recording.joined import concatenated, shifted
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.surrogate.residuals import (
    BIN_S,
    ResidualProblem,
    prepare_residual_problem,
)
from adk_ros.mismatch.surrogate.run_inputs import ActiveTerms
from adk_ros.numerics.arrays import FloatArray


@dataclass(frozen=True)
class JoinedProblem(ResidualProblem):
    """Residual problems `parts` of recordings that follow each other in time."""

    parts: tuple[ResidualProblem, ...]

    @classmethod
    def of(cls, logs: Sequence[SensorLog], sigmas: Sequence[FloatArray]) -> JoinedProblem:
        """Return the problem of recordings in the order given; `sigmas`: (6,) noise of each."""
        parts: list[ResidualProblem] = []
        for log, sigma in zip(logs, sigmas, strict=True):
            part = prepare_residual_problem(log, sigma)
            if parts:
                # The bins of the next recording begin where those of the last one end.
                end_s = parts[-1].start_s + BIN_S * parts[-1].bins
                part = prepare_residual_problem(shifted(log, end_s - part.start_s), sigma)
            parts.append(part)

        def joined(of: Callable[[ResidualProblem], FloatArray], axis: int = 0) -> FloatArray:
            return np.concatenate([of(part) for part in parts], axis=axis)

        first_bins = np.cumsum([0, *(part.bins for part in parts)])
        return cls(
            log=concatenated([part.log for part in parts]),
            start_s=parts[0].start_s,
            middle_s=joined(lambda p: p.middle_s),
            commands=parts[0].commands,
            command_start_s=parts[0].command_start_s,
            prescribed_v_x=joined(lambda p: p.prescribed_v_x),
            smoothed_odometry=joined(lambda p: p.smoothed_odometry),
            pose=joined(lambda p: p.pose),
            bins=int(first_bins[-1]),
            imu_bin=np.concatenate(
                [p.imu_bin + b for p, b in zip(parts, first_bins[:-1], strict=True)]
            ),
            odometry_bin=np.concatenate(
                [p.odometry_bin + b for p, b in zip(parts, first_bins[:-1], strict=True)]
            ),
            counts=joined(lambda p: p.counts, axis=1),
            sigma=np.sqrt(np.mean([p.sigma**2 for p in parts], axis=0)),
            distances=joined(lambda p: p.distances),
            distance_sigma=max(p.distance_sigma for p in parts),
            parts=tuple(parts),
        )

    @property
    def step_slices(self) -> list[slice]:
        """The steps of each recording."""
        return slices([part.steps for part in self.parts])

    @property
    def bin_slices(self) -> list[slice]:
        """The bins of each recording."""
        return slices([part.bins for part in self.parts])

    @property
    def bin_noise(self) -> FloatArray:
        """Noise of a bin's mean (6,), by channel: root mean square over the recordings."""
        return np.asarray(np.sqrt(np.mean([p.bin_noise**2 for p in self.parts], axis=0)))

    @property
    def bin_s(self) -> FloatArray:
        """Middles of the bins, s."""
        return np.concatenate([part.bin_s for part in self.parts])

    def binned(self, values: FloatArray) -> FloatArray:
        """Return the mean of a signal (n,) on the grid in each bin (b,)."""
        pairs = zip(self.parts, self.step_slices, strict=True)
        return np.concatenate([part.binned(values[at]) for part, at in pairs])

    def mean_commands(self) -> tuple[FloatArray, FloatArray]:
        """Return the mean torque and road-wheel angle of each step (n,), N·m and rad."""
        torque, angle = zip(*(part.mean_commands() for part in self.parts), strict=True)
        return np.concatenate(torque), np.concatenate(angle)

    def run(
        self,
        parameters: FloatArray,
        terms: ActiveTerms | None = None,
        gain: float = 1.0,
        extra: FloatArray | None = None,
    ) -> FloatArray:
        """Run the surrogate model along each recording; return the outputs (OUTPUTS, n)."""
        terms = terms or self.no_terms()
        return np.concatenate(
            [
                part.run(parameters, terms.between(at), gain, None if extra is None else extra[at])
                for part, at in zip(self.parts, self.step_slices, strict=True)
            ],
            axis=1,
        )

    def residuals(
        self,
        parameters: FloatArray,
        terms: ActiveTerms | None = None,
        out: FloatArray | None = None,
        gain: float = 1.0,
    ) -> FloatArray:
        """Return (6, bins): mean of measured minus simulated per bin, zero for an empty bin."""
        terms = terms or self.no_terms()
        return np.concatenate(
            [
                part.residuals(
                    parameters, terms.between(at), None if out is None else out[:, at], gain
                )
                for part, at in zip(self.parts, self.step_slices, strict=True)
            ],
            axis=1,
        )

    def weights(self) -> FloatArray:
        """Return (6, bins): inverse noise of each bin's mean, zero for an empty bin."""
        return np.concatenate([part.weights() for part in self.parts], axis=1)

    def distance_residuals(self, parameters: FloatArray) -> FloatArray:
        """Return (w,): distance by pose minus distance by velocity, over the noise."""
        return np.concatenate([part.distance_residuals(parameters) for part in self.parts])


def slices(counts: Sequence[int]) -> list[slice]:
    """Return the slices of consecutive parts with these lengths."""
    ends = np.cumsum([0, *counts])
    return [slice(int(a), int(b)) for a, b in pairwise(ends)]
