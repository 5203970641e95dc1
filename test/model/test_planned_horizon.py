# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The horizon under a plan: what is followed, what is held, and why."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
from helpers.model import make_model, sample, slalom

from adk_ros.model import planned_horizon
from adk_ros.model.planned_horizon import PlannedHorizon, PlanStatus
from adk_ros.model.prediction import Prediction
from adk_ros.model.predictor import Predictor
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.channels import TICK_NS, Flag, Sample
from adk_ros.signals.command_plan import CommandPlan

STEPS = 40


class Car:
    """A predictor and its planned horizon on a drive of 300 samples."""

    def __init__(self, timeout_s: float = 0.5) -> None:
        model = make_model()
        self.predictor = Predictor(model, horizon_steps=STEPS)
        self.planned = PlannedHorizon(model, STEPS, timeout_s)
        self.samples = list(slalom(300))

    def plan(self, k: int, commands: FloatArray, *, first: int = 0) -> None:
        """Plan `commands` (n, 2) of ticks `first` and on after tick k."""
        stamp = self.samples[k].stamp_ns
        times = stamp + TICK_NS * (first + np.arange(len(commands), dtype=np.int64))
        self.planned.take(CommandPlan(stamp, times, commands))

    def true(self, k: int, n: int = STEPS) -> FloatArray:
        """The commands (n, 2) of ticks k and on."""
        return np.array([s.u for s in self.samples[k : k + n]])

    def step(self, k: int, given: Sample | None = None) -> tuple[Prediction, Prediction]:
        """Take sample k; return the prediction under held commands, and under the plan."""
        taken = given or self.samples[k]
        held = self.predictor.step(taken)
        assert held is not None
        return held, self.planned.apply(self.predictor, held, taken)

    def drive(self, until: int) -> None:
        for taken in self.samples[:until]:
            self.predictor.step(taken)

    def status(self) -> Sequence[PlanStatus]:
        return self.planned.status


def test_the_horizon_is_that_of_known_commands() -> None:
    car = Car()
    car.drive(100)
    car.plan(100, car.true(100, 60))
    held, planned = car.step(100)
    np.testing.assert_array_equal(planned.horizon, car.predictor.rollout(car.true(100)))
    assert np.abs(planned.horizon[1:] - held.horizon[1:]).max() > 1e-3
    np.testing.assert_array_equal(planned.x, held.x)
    assert planned.planned_steps == (STEPS, STEPS)
    assert held.planned_steps == (0, 0)
    assert planned.horizon_covariance.shape == (STEPS, 3, 3)
    assert car.status() == [PlanStatus.FOLLOWED] * 2


def test_after_its_last_point_a_plan_is_held() -> None:
    car = Car()
    car.drive(200)
    car.plan(200, car.true(200, 11))
    _, planned = car.step(200)
    commands = np.vstack([car.true(200, 11), np.repeat(car.true(210, 1), STEPS - 11, axis=0)])
    rollout = car.predictor.rollout(commands)
    np.testing.assert_array_equal(planned.horizon[:11], rollout[:11])
    # What the held command changes is worth as much as in a published horizon.
    k = car.predictor.held_input_shrinkage[1 : STEPS - 10]
    assert (k < 1.0).any()
    np.testing.assert_allclose(
        planned.horizon[11:] - rollout[10], k * (rollout[11:] - rollout[10])
    )
    np.testing.assert_array_equal(car.planned.commands, commands)
    assert planned.planned_steps == (11, 11)


@pytest.mark.parametrize(("points", "after_ns"), [(11, 1), (11, TICK_NS - 1), (1, 7)])
def test_the_last_point_of_a_plan_may_lie_between_two_samples(points: int, after_ns: int) -> None:
    """It is in force from the next sample on; the stamps of a planner are on no grid."""
    car = Car()
    car.drive(100)
    stamp = car.samples[100].stamp_ns
    times = stamp + after_ns + TICK_NS * np.arange(points, dtype=np.int64)
    true = car.true(100)
    car.planned.take(CommandPlan(stamp, times, true[:points]))
    _, planned = car.step(100)
    in_force = np.minimum(np.maximum(np.arange(STEPS) - 1, 0), points - 1)
    np.testing.assert_array_equal(car.planned.commands, true[in_force])
    rollout = car.predictor.rollout(true[in_force])
    np.testing.assert_array_equal(planned.horizon[: points + 1], rollout[: points + 1])
    assert planned.planned_steps == (points + 1,) * 2
    assert car.status() == [PlanStatus.FOLLOWED] * 2


def test_a_plan_that_ends_at_the_sample_is_out_of_reach() -> None:
    car = Car()
    car.drive(100)
    stamp = car.samples[100].stamp_ns
    car.planned.take(CommandPlan(stamp, np.array([stamp]), car.true(100, 1)))
    held, planned = car.step(100)
    assert planned is held
    assert car.status() == [PlanStatus.OUT_OF_REACH] * 2


def test_before_its_first_point_the_present_command_is_held() -> None:
    car = Car()
    car.drive(100)
    car.plan(100, car.true(105, 60), first=5)
    _, planned = car.step(100)
    commands = car.true(100)
    commands[:5] = commands[0]
    np.testing.assert_array_equal(planned.horizon, car.predictor.rollout(commands))


@pytest.mark.parametrize(("missing", "own"), [(0, [1, 2]), (1, [0])])
def test_a_plan_of_one_command_holds_the_other(missing: int, own: list[int]) -> None:
    """States that the missing command moves stay those published, plus what the plan changes."""
    car = Car()
    car.drive(200)
    commands = car.true(200, 60)
    commands[:, missing] = math.nan
    car.plan(200, commands)
    held, planned = car.step(200)
    followed = car.true(200)
    followed[:, missing] = followed[0, missing]
    np.testing.assert_array_equal(car.planned.commands, followed)
    rollout = car.predictor.rollout(followed)
    constant = car.predictor.rollout(np.repeat(followed[:1], STEPS, axis=0))
    np.testing.assert_array_equal(planned.horizon[:, own], rollout[:, own])
    others = [c for c in range(3) if c not in own]
    published = held.horizon + rollout - constant
    np.testing.assert_allclose(planned.horizon[:, others], published[:, others], atol=1e-12)
    assert np.abs(planned.horizon - rollout)[:, others].max() > 1e-4
    # The errors of a command that nobody knows stay, in all channels.
    np.testing.assert_array_equal(planned.horizon_covariance, held.horizon_covariance)
    reach, status = [STEPS, STEPS], [PlanStatus.FOLLOWED] * 2
    reach[missing], status[missing] = 0, PlanStatus.NOT_PLANNED
    assert planned.planned_steps == tuple(reach)
    assert car.status() == status


def test_no_plan_changes_nothing() -> None:
    car = Car()
    car.drive(100)
    held, planned = car.step(100)
    assert planned is held
    assert car.status() == [PlanStatus.NONE] * 2


@pytest.mark.parametrize(
    ("commands", "first", "reason"),
    [(20, -60, PlanStatus.STALE), (60, 100, PlanStatus.OUT_OF_REACH)],
)
def test_a_plan_that_says_nothing_of_the_horizon(
    commands: int, first: int, reason: PlanStatus
) -> None:
    car = Car()
    car.drive(130)
    if reason is PlanStatus.STALE:
        car.plan(100, car.true(100, commands + 60))
    else:
        car.plan(130, car.true(130, commands), first=first)
    held, planned = car.step(130)
    assert planned is held
    assert car.status() == [reason] * 2


def test_a_plan_that_is_not_carried_out_is_not_followed() -> None:
    car = Car(timeout_s=10.0)
    car.drive(100)
    other = car.true(100, 200)
    other[:, 1] += 0.3 * np.sin(0.2 * np.arange(200))
    car.plan(100, other)
    seen = []
    for k in range(100, 160):
        _, planned = car.step(k)
        seen.append(planned.planned_steps)
    assert seen[0] == (STEPS, STEPS)
    assert car.status() == [PlanStatus.FOLLOWED, PlanStatus.CONTRADICTED]
    assert seen[-1] == (STEPS, 0)
    # It is again, once the plan is what happens.
    car.plan(160, car.true(160, 140))
    for k in range(160, 250):
        car.step(k)
    assert car.status() == [PlanStatus.FOLLOWED] * 2


def test_a_fresh_plan_is_followed_after_manual_driving() -> None:
    """What the stale plan before it says of the time since is no evidence against it."""
    car = Car()
    car.drive(100)
    other = car.true(100, 200)
    other[:, 1] += 0.3 * np.sin(0.2 * np.arange(200))
    car.plan(100, other)
    for k in range(100, 160):
        car.step(k)
    assert car.status() == [PlanStatus.STALE] * 2
    for k in range(160, 200):
        car.plan(k, car.true(k, 60))
        _, planned = car.step(k)
        assert car.status() == [PlanStatus.FOLLOWED] * 2
        assert planned.planned_steps == (STEPS, STEPS)


def test_a_plan_that_has_ended_is_none() -> None:
    car = Car()
    car.drive(100)
    car.plan(100, car.true(100, 61))
    seen = []
    for k in range(100, 190):
        car.step(k)
        seen.append(car.status()[0])
    # It is made at tick 100, ends at tick 160, and the timeout is 20 ticks.
    assert seen[:20] == [PlanStatus.FOLLOWED] * 20
    assert seen[21:80] == [PlanStatus.STALE] * 59
    assert seen[81:] == [PlanStatus.NONE] * 9


def test_a_planner_whose_clock_is_behind_is_reported_until_it_stops() -> None:
    car = Car()
    car.drive(150)
    seen = []
    for k in range(150, 250):
        if k < 200 and k % 10 == 0:
            car.plan(k - 100, car.true(k - 100, 31))
        car.step(k)
        seen.append(car.status()[1])
    # The last plan comes at tick 190, for 30 ticks.
    assert seen[:91] == [PlanStatus.STALE] * 91
    assert seen[91:] == [PlanStatus.NONE] * 9


@pytest.mark.parametrize(
    ("flag", "status"),
    [
        (Flag.ODOMETRY_STALE, PlanStatus.CONTRADICTED),
        (Flag.IMU_STALE, PlanStatus.CONTRADICTED),
        (Flag.FROZEN, PlanStatus.CONTRADICTED),
        (Flag.REJECTED, PlanStatus.CONTRADICTED),
        (Flag.COMMAND_STALE, PlanStatus.FOLLOWED),
    ],
)
def test_commands_are_compared_whatever_the_state_is_known_from(
    flag: Flag, status: PlanStatus
) -> None:
    car = Car(timeout_s=10.0)
    car.drive(100)
    other = car.true(100, 200)
    other[:, 1] += 0.3 * np.sin(0.2 * np.arange(200))
    car.plan(100, other)
    for k in range(100, 160):
        car.step(k, car.samples[k]._replace(flags=int(flag)))
    assert car.status() == [PlanStatus.FOLLOWED, status]


def test_a_constant_offset_of_the_actuator_contradicts_no_plan() -> None:
    car = Car(timeout_s=10.0)
    car.drive(100)
    offset = 0.05 * car.predictor.model.scaling.u_scale
    car.plan(100, car.true(100, 200) + offset)
    for k in range(100, 160):
        car.step(k)
    assert car.status() == [PlanStatus.FOLLOWED] * 2


def test_a_plan_that_leads_to_no_drivable_state_is_not_followed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    car = Car()
    car.drive(100)
    commands = car.true(100, 60)
    commands[:, 0] = math.nan
    car.plan(100, commands)
    monkeypatch.setattr(planned_horizon, "is_drivable", lambda *_: False)
    held, planned = car.step(100)
    assert planned is held
    assert car.status() == [PlanStatus.NOT_PLANNED, PlanStatus.NOT_DRIVABLE]


def test_an_absurd_plan_leads_to_a_finite_horizon() -> None:
    car = Car()
    car.drive(100)
    car.plan(100, np.repeat([[1e6, 1.5]], 60, axis=0))
    _, planned = car.step(100)
    assert np.isfinite(planned.horizon).all()


def test_covariances_of_planned_and_held_horizons_differ() -> None:
    car = Car(timeout_s=10.0)
    car.drive(60)
    car.plan(60, car.true(60, 240))
    for k in range(60, 240):
        held, planned = car.step(k)
    assert (planned.horizon_covariance != held.horizon_covariance).any()
    assert (np.linalg.eigvalsh(planned.horizon_covariance) > 0.0).all()


def test_beyond_a_plan_the_covariance_is_no_smaller_than_that_of_a_held_horizon() -> None:
    whole, short = Car(), Car()
    for car, points in ((whole, 60), (short, 12)):
        car.drive(100)
        car.plan(100, car.true(100, points))
    held, planned = short.step(100)
    _, exact = whole.step(100)
    covariance, known = planned.horizon_covariance, 12
    np.testing.assert_array_equal(covariance[:known], exact.horizon_covariance[:known])
    beyond = held.horizon_covariance[1 : STEPS - known + 1]
    assert (np.linalg.eigvalsh(covariance[known:] - beyond) > 0.0).all()


def test_only_steps_that_are_planned_for_both_commands_teach_their_errors() -> None:
    """A plan of 0.3 s, and one of the steering alone, say nothing of an exact plan of a second."""
    known = 12
    both, steering, none = Car(timeout_s=10.0), Car(timeout_s=10.0), Car(timeout_s=10.0)
    for k in range(60, 240):
        for car in (both, steering, none):
            if k == 60:
                car.drive(60)
            if car is not none:
                commands = car.true(k, known if car is both else 60)
                if car is steering:
                    commands[:, 0] = math.nan
                car.plan(k, commands)
            car.step(k)
    found = []
    for car in (both, steering, none):
        car.plan(240, car.true(240, 60))
        found.append(car.step(240)[1].horizon_covariance)
    assert (found[0][1:known] != found[2][1:known]).all(axis=0).any()
    np.testing.assert_array_equal(found[0][known:], found[2][known:])
    np.testing.assert_array_equal(found[1], found[2])


def test_errors_of_plans_widen_their_covariance() -> None:
    exact, wrong = Car(timeout_s=10.0), Car(timeout_s=10.0)
    wide = []
    for car, offset in ((exact, 0.0), (wrong, 0.09)):
        car.drive(60)
        car.plan(60, car.true(60, 240) + offset * car.predictor.model.scaling.u_scale)
        for k in range(60, 260):
            _, planned = car.step(k)
        assert planned.planned_steps == (STEPS, STEPS)
        wide.append(planned.horizon_covariance[-1, 2, 2])
    assert wide[1] > wide[0]


def test_reset_forgets_the_plan() -> None:
    car = Car()
    car.drive(100)
    car.plan(100, car.true(100, 60))
    car.planned.reset()
    held, planned = car.step(100)
    assert planned is held


def test_a_coasted_sample_follows_the_plan() -> None:
    car = Car()
    car.drive(100)
    car.plan(100, car.true(100, 60))
    taken = sample(100, [math.nan] * 3, car.samples[100].u, int(Flag.COASTING))
    _, planned = car.step(100, taken)
    assert planned.planned_steps == (STEPS, STEPS)
    assert np.isfinite(planned.horizon).all()
    car.planned.interrupt()
    assert car.status() == [PlanStatus.FOLLOWED] * 2


def test_a_plan_that_begins_later_than_it_is_compared_is_not_followed() -> None:
    """Its stamps are ahead of the sensors': what it says of the next 0.25 s is never known."""
    car = Car()
    car.drive(100)
    car.plan(100, car.true(100, 60), first=11)
    held, planned = car.step(100)
    assert planned is held
    assert car.status() == [PlanStatus.NOT_BEGUN] * 2
    car.plan(101, car.true(101, 60), first=10)
    car.step(101)
    assert car.status() == [PlanStatus.FOLLOWED] * 2


@pytest.mark.parametrize(("timeout_s", "stays"), [(0.5, False), (10.0, True)])
def test_a_plan_of_this_time_survives_a_restart(timeout_s: float, stays: bool) -> None:
    car = Car(timeout_s)
    car.drive(100)
    car.plan(100, car.true(100, 60))
    car.planned.restart(car.samples[140].stamp_ns)
    for k in range(140, 160):
        car.predictor.step(car.samples[k])
    car.step(160)
    assert (car.status() != [PlanStatus.NONE] * 2) is stays
