# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One or several recordings of a car with a surrogate: their problem, laps, training part."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from adk_ros.errors import DataError
from adk_ros.mismatch.deployment.held_out import Evidence
from adk_ros.mismatch.deployment.prediction_starts import FIRST_START_S
from adk_ros.mismatch.inference.decision import Decision
from adk_ros.mismatch.inference.hypothesis import Hypothesis
from adk_ros.mismatch.inference.joint_likelihood import JointLikelihood
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.observability import (
    ObservableEffects,
    longest_moving_segment,
    observable_effects,
    with_pseudo_imu,
)
from adk_ros.mismatch.inference.result import RecordingSpan
from adk_ros.mismatch.library.criteria import HELD_OUT_SHARE, MIN_ACTIVE_S
from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.mismatch.recording.checks import check_recording
from adk_ros.mismatch.recording.direct_comparison import DirectComparison, compare_directly
from adk_ros.mismatch.recording.joined import check_different, distinct_names
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.mismatch.surrogate.joined_problem import JoinedProblem
from adk_ros.mismatch.surrogate.lap import Lap, find_lap
from adk_ros.mismatch.surrogate.residuals import ResidualProblem, prepare_residual_problem
from adk_ros.mismatch.surrogate.routes import find_routes
from adk_ros.numerics.arrays import FloatArray


def usable_recordings(recordings: Sequence[SensorLog]) -> list[SensorLog]:
    """
    Return the recordings with an IMU, computed from odometry where there is none.

    :raises DataError: a recording does not allow an analysis, two are the same, or only some have
        an IMU.
    """
    check_different(recordings)
    with_imu = [log.name for log in recordings if log.imu_s.size]
    without = [log.name for log in recordings if not log.imu_s.size]
    if with_imu and without:
        raise DataError(
            f"{with_imu[0]} has an IMU and {without[0]} has none: analyse them separately, or "
            "give recordings with the same channels"
        )
    if without:
        recordings = [with_pseudo_imu(longest_moving_segment(log)) for log in recordings]
    for log in recordings:
        check_recording(log, needs_steering=False)
    return list(recordings)


@dataclass(frozen=True)
class RecordedData:
    """
    Recordings and a surrogate; several recordings follow each other on one axis of time.

    `splits_s`: the end of each recording's training part on that axis; `recordings` is empty for
    a single one.
    """

    surrogate: SurrogateModel
    problem: ResidualProblem
    observable: ObservableEffects
    lap: Lap | None
    splits_s: tuple[float, ...]
    recordings: tuple[RecordingSpan, ...] = ()

    @property
    def single_lap(self) -> Lap | None:
        """The lap of the only route, None for several routes."""
        return self.lap if self.lap is not None and len(self.lap.routes) == 1 else None

    @classmethod
    def of(
        cls,
        surrogate: SurrogateModel,
        logs: Sequence[SensorLog],
        noise: Sequence[FloatArray],
        has_imu: bool,
        share_held_out: float = HELD_OUT_SHARE,
    ) -> RecordedData:
        """
        Prepare recordings in their order in time, with the noise (6,) of each.

        The last share of each recording is held out; with 0, nothing is.

        :raises DataError: the recordings have different channels.
        """
        observable = _common_channels(surrogate, logs, has_imu)
        shares = [1.0 - share_held_out if share_held_out else np.inf] * len(logs)
        if len(logs) == 1:
            (log,) = logs
            problem = prepare_residual_problem(log, noise[0])
            split_s = log.duration_s * shares[0]
            return cls(surrogate, problem, observable, find_lap(problem), (split_s,))
        joined = JoinedProblem.of(logs, noise)
        lap, route_of = find_routes(joined)
        laps = () if lap is None else lap.routes
        begins = [
            p.log.duration_s - log.duration_s for p, log in zip(joined.parts, logs, strict=True)
        ]
        spans = tuple(
            RecordingSpan(
                name,
                begin,
                begin + log.duration_s,
                route,
                None if route is None else laps[route].length,
            )
            for name, begin, log, route in zip(
                distinct_names(logs), begins, logs, route_of, strict=True
            )
        )
        splits = tuple(
            b + log.duration_s * s for b, log, s in zip(begins, logs, shares, strict=True)
        )
        return cls(surrogate, joined, observable, lap, splits, spans)

    @property
    def parts(self) -> tuple[ResidualProblem, ...]:
        """The residual problem of each recording."""
        return self.problem.parts if isinstance(self.problem, JoinedProblem) else (self.problem,)

    def training(self) -> Likelihood:
        """Return the likelihood of the training part of each recording."""
        return self._likelihood(self.splits_s)

    def whole(self) -> Likelihood:
        """Return the likelihood of all data."""
        return self._likelihood([np.inf] * len(self.parts))

    def _likelihood(self, until_s: Sequence[float]) -> Likelihood:
        surrogate = self.observable.adapted(self.surrogate)
        parts = [
            self.observable.masked(Likelihood.of(part, surrogate, until))
            for part, until in zip(self.parts, until_s, strict=True)
        ]
        if not isinstance(self.problem, JoinedProblem):
            return parts[0]
        return JointLikelihood.joined(self.problem, surrogate, parts)

    def held_out(self, h: Hypothesis) -> list[Evidence]:
        """
        Return the held-out part of each recording, as far as all effects of `h` act in it.

        A recording before an onset says nothing about the effect.
        """
        pairs = zip(self.parts, self.splits_s, strict=True)
        evidence = [self.evidence(part.log, split) for part, split in pairs]
        if len(evidence) == 1:
            return evidence
        onset_s = max((a.activation.onset_s or 0.0 for a in h.effects), default=0.0)
        after = [
            replace(item, from_s=max(item.from_s, onset_s))
            for item in evidence
            if item.log.duration_s > onset_s + MIN_ACTIVE_S
        ]
        return after or evidence

    def evidence(self, log: SensorLog, from_s: float = FIRST_START_S) -> Evidence:
        """Return a recording of these channels, from a time on, to predict."""
        observable = self.observable
        return Evidence(
            log,
            from_s,
            yaw_filter_s=observable.yaw_filter_s or None,
            v_x_is_given="v_x" in observable.not_predicted(),
        )

    def direct_comparisons(self, simulation: SensorLog | SurrogateModel) -> list[DirectComparison]:
        """
        Return what the simulation's bag and the longest recording show without the surrogate.

        Nothing without a simulation's bag.
        """
        if isinstance(simulation, SurrogateModel):
            return []
        radius = float(self.surrogate.parameters[INDEX["wheel_radius"]])
        longest = max(self.parts, key=lambda part: part.steps)
        return compare_directly(simulation, longest.log, radius, self.observable.unobservable)

    def with_onsets_at_starts(self, decision: Decision) -> Decision:
        """
        Return a decision whose onsets in a held-out part are at the start of the next recording.

        No data of the selection lie between the end of a training part and that start; a car
        changes between two recordings rather than at the end of one.
        """
        gaps = [
            (split, later.begin_s)
            for split, later in zip(self.splits_s, self.recordings[1:], strict=False)
        ]

        def moved(onset_s: float | None) -> float | None:
            found = (end for begin, end in gaps if onset_s is not None and begin <= onset_s < end)
            return next(found, onset_s)

        h = decision.hypothesis
        active = tuple(
            replace(a, activation=replace(a.activation, onset_s=moved(a.activation.onset_s)))
            for a in h.effects
        )
        effects = [replace(e, onset_s=moved(e.onset_s)) for e in decision.effects]
        return replace(decision, effects=effects, hypothesis=replace(h, effects=active))

    def not_predicted(self) -> list[str]:
        """Return the states whose prediction needs a channel that the recordings lack."""
        return self.observable.not_predicted()


def _common_channels(
    surrogate: SurrogateModel, logs: Sequence[SensorLog], has_imu: bool
) -> ObservableEffects:
    """Return which effects the recordings show; raise `DataError` where they differ."""
    mass, radius = (float(surrogate.parameters[INDEX[k]]) for k in ("mass", "wheel_radius"))
    each = [observable_effects(log, mass, radius, has_imu) for log in logs]
    for what, known in (
        ("a torque command", [one.torque for one in each]),
        ("an unfiltered yaw rate", [one.yaw_filter_s == 0.0 for one in each]),
        ("a lateral velocity", [one.v_y for one in each]),
        ("a changing steering angle", [one.steering for one in each]),
        ("straight driving, or bends with a steering angle", [one.known_bends for one in each]),
    ):
        if len(set(known)) > 1:
            raise DataError(
                f"{logs[known.index(True)].name} has {what} and {logs[known.index(False)].name} "
                "has none: analyse them separately, or give recordings with the same channels"
            )
    return replace(each[0], yaw_filter_s=float(np.mean([one.yaw_filter_s for one in each])))
