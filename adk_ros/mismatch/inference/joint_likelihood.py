# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Likelihood of several recordings of one car: one vehicle, one set of effects.

Effects, build tolerances and weakly determined directions are common. The offsets of the IMU are
those of each recording, since they change from one start to the next. Noise, whitening and the
part that counts are those of each recording: no filter runs across a joint.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from adk_ros.mismatch.inference.hypothesis import ActiveEffect
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.library.criteria import SENSOR_OFFSET_PRIORS
from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.mismatch.surrogate.joined_problem import JoinedProblem, slices
from adk_ros.mismatch.surrogate.run_inputs import ActiveTerms
from adk_ros.numerics.arrays import BoolArray, FloatArray

_OFFSETS = np.array([INDEX[name] for name in SENSOR_OFFSET_PRIORS])
_FIRST_OFFSET = -len(SENSOR_OFFSET_PRIORS)


@dataclass(frozen=True)
class JointLikelihood(Likelihood):
    """
    Likelihood of recordings that follow each other in time.

    `parts`: the likelihood of each. The IMU offsets of the first recording are in the place where
    those of a single one are; those of the others follow the other nuisance parameters.
    """

    parts: tuple[Likelihood, ...] = ()

    @classmethod
    def joined(
        cls, problem: JoinedProblem, surrogate: SurrogateModel, parts: Sequence[Likelihood]
    ) -> JointLikelihood:
        """Return the joint likelihood of recordings, given that of each, in the same order."""
        first = parts[0]
        return cls(
            problem,
            surrogate.parameters,
            _weights(parts),
            first.filters,
            first.weak_directions,
            surrogate.fixed_terms(problem),
            np.mean([part.surrogate_error_share for part in parts], axis=0),
            np.mean([part.smooth_error_share for part in parts], axis=0),
            np.concatenate([part.systematic_error for part in parts], axis=1),
            unobservable=first.unobservable,
            parts=tuple(parts),
        )

    def restricted_to(self, kept: Collection[int]) -> JointLikelihood:
        """Return the likelihood of some of the recordings, by index, on the same grid."""
        parts = tuple(
            part
            if i in kept
            else replace(part, weights=np.zeros_like(part.weights), until_s=-np.inf)
            for i, part in enumerate(self.parts)
        )
        return replace(self, weights=_weights(parts), parts=parts)

    @property
    def n_nuisances(self) -> int:
        """Number of nuisance parameters, with the IMU offsets of further recordings."""
        return super().n_nuisances + len(_OFFSETS) * (len(self.parts) - 1)

    def nuisance_steps(self) -> FloatArray:
        """Return the difference steps of the nuisance parameters."""
        return self._with_offsets(super().nuisance_steps())

    def nuisance_bounds(self) -> FloatArray:
        """Return the symmetric bounds of the nuisance parameters."""
        return self._with_offsets(super().nuisance_bounds())

    def nuisance_deviations(self) -> FloatArray:
        """Return the prior standard deviations of the nuisance parameters."""
        return self._with_offsets(super().nuisance_deviations())

    def _with_offsets(self, values: FloatArray) -> FloatArray:
        """Return values per nuisance parameter with those of the further recordings' offsets."""
        end = super().n_nuisances - self.weak_directions.shape[0]
        return np.concatenate(
            [values, *[values[end + _FIRST_OFFSET : end]] * (len(self.parts) - 1)]
        )

    def simulation_inputs(
        self, nuisances: FloatArray, effects: Sequence[ActiveEffect]
    ) -> tuple[FloatArray, ActiveTerms]:
        """Return the parameters and terms of a simulation, with each recording's IMU offsets."""
        p, terms = super().simulation_inputs(nuisances, effects)
        single = super().n_nuisances
        end = single - self.weak_directions.shape[0]
        # The parameters hold the offsets of the first recording.
        own = nuisances[single:].reshape(-1, len(_OFFSETS))
        changes = own - nuisances[end + _FIRST_OFFSET : end]
        problem = self.problem
        assert isinstance(problem, JoinedProblem)
        for change, steps in zip(changes, problem.step_slices[1:], strict=True):
            if change.any():
                active = np.zeros((1, problem.steps))
                active[0, steps] = 1.0
                rows = np.ones(len(_OFFSETS), dtype=np.int64)
                activations = np.vstack([terms.activations[:1], active])
                terms = terms.merged_with(ActiveTerms(_OFFSETS, change, rows, activations))
        return p, terms

    def whiten(self, residuals: FloatArray) -> FloatArray:
        """Return residuals (6, bins) over their noise, each recording whitened separately."""
        bins = slices([part.problem.bins for part in self.parts])
        return np.concatenate(
            [part.whiten(residuals[:, at]) for part, at in zip(self.parts, bins, strict=True)],
            axis=1,
        )

    def distance_residuals(self, parameters: FloatArray) -> FloatArray:
        """Return the residuals of the distances travelled (w,) that count, over their noise."""
        return np.concatenate([part.distance_residuals(parameters) for part in self.parts])

    def held_out_bins(self) -> BoolArray:
        """Return the bins (b,) after the part of each recording that counts."""
        return np.concatenate([part.held_out_bins() for part in self.parts])

    def noise_loss_variance(self) -> float:
        """Return the variance that the errors of the estimated noise add to the loss."""
        return float(sum(part.noise_loss_variance() for part in self.parts))

    def surrogate_error_by_channel(self) -> FloatArray:
        """Return the number of residuals (6,) that the surrogate's own error accounts for."""
        return np.asarray(sum(part.surrogate_error_by_channel() for part in self.parts))


def _weights(parts: Sequence[Likelihood]) -> FloatArray:
    return np.concatenate([part.weights for part in parts], axis=1)
