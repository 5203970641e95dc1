# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
How a model predicts beyond what it was trained on: faster, slipperier, heavier, in reverse.

Open-loop slaloms on a flat road, as in the paper, at speeds of 100 to 160 km/h; those in which the
car spins are steered less until it does not. A spin is a sideslip angle above a bound that depends
on friction alone, so that fast drives need not be gentler. Stop and go and reversing are
kinematic, without slip: no plant reverses. Errors are compared with the best naive predictor's,
under known and under held commands.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from adk_ros.bench.runtime.synthetic_feed import bench_model
from adk_ros.errors import DataError, UsageError
from adk_ros.model import artefact
from adk_ros.model.evaluation import rollout_record
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.training_range import TrainingRange
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import GRAVITY
from adk_ros.plant.scenario.scenario_file import Scenario, load_scenario
from adk_ros.plant.scenario.sensors import Imu, Odometry
from adk_ros.plant.scenario.simulate import simulate
from adk_ros.signals.channels import TICK_NS, Record
from adk_ros.signals.score import HORIZON_STEPS, best_naive, naive_predictions, score

MAX_RATIO = 1.02
"""Largest admissible ratio to the best naive predictor."""
SPEEDS_KMH = (100.0, 110.0, 123.0, 130.0, 137.0, 145.0, 160.0)
VARIANTS: dict[str, dict[str, Any]] = {
    "friction 0.6": {},
    "friction 0.3": {"mu": 0.3},
    "friction 1": {"mu": 1.0},
    "+40 % load": {"vehicle_changes": {"mass": 2898.0}},
}
STOP_AND_GO, REVERSING = "stop and go", "reversing"
_AHEAD = max(HORIZON_STEPS)
_SETTLED = 600
"""Rows, 15 s, before the first that counts: the slalom starts slowly."""
_STRIDE = 4
_STEER_LESS, _MAX_TRIES = 0.8, 9
"""Factor on the amplitude from one try to the next, by choice, and most tries."""
_SIDESLIP_BOUND = 0.02
"""
s²/m; atan(0.02 mu g), the bound of stability control on the sideslip angle (Rajamani, Vehicle
Dynamics and Control, 2012, chapter 8): 3.4° at a friction of 0.3, 6.7° at 0.6, 11° at 1.
"""
_KINEMATIC_S = 60.0
_WHEELBASE, _TO_REAR, _MASS, _RADIUS = 2.67, 1.355, 2070.0, 0.325
"""Of the car of the slaloms; m, m, kg, m."""

Progress = Callable[[int, int], None]


class PeakMotion(NamedTuple):
    """Largest steering angle, rad, sideslip angle, rad, and lateral acceleration, m/s²."""

    steering: float
    sideslip: float
    lateral_accel: float


@dataclass(frozen=True)
class RangeCase:
    """
    Ratios on one drive by scored horizon and state (5, 3), with known and with held commands.

    `beyond`: share of the starts outside the range that the model was trained on. `peak`: of the
    rows that count; a slalom is steered less than the packaged one where the car would spin.
    """

    variant: str
    speed_kmh: float
    known: FloatArray
    held: FloatArray
    beyond: float
    peak: PeakMotion

    @property
    def above(self) -> int:
        """Number of the 30 ratios above `MAX_RATIO`."""
        return int((self.known > MAX_RATIO).sum() + (self.held > MAX_RATIO).sum())

    def as_dict(self) -> dict[str, Any]:
        """Return it for JSON."""
        return {
            "variant": self.variant, "speed_kmh": self.speed_kmh, "beyond": self.beyond,
            "known": self.known.tolist(), "held": self.held.tolist(), "above": self.above,
            "peak": self.peak._asdict(),
        }  # fmt: skip


def check_speeds(speeds_kmh: Sequence[float]) -> None:
    """:raises UsageError: a speed that the plant's driver does not reach or hold."""
    for speed in speeds_kmh:
        if not 60.0 <= speed <= 200.0:
            raise UsageError(f"--speed {speed:g} is out of range: choose 60 to 200 km/h")


def bench_range(
    model_path: Path | None,
    speeds_kmh: Sequence[float] = SPEEDS_KMH,
    seed: int = 31,
    progress: Progress | None = None,
) -> list[RangeCase]:
    """
    Return a case for each variant and speed, then stop and go and reversing.

    :raises UsageError: as `check_speeds`, or the model is refused.
    """
    check_speeds(speeds_kmh)
    model = bench_model(model_path)
    trained = None
    if model_path is not None:
        trained = TrainingRange.from_json(
            artefact.load(model_path).manifest["training"].get("range")
        )
    cases = []
    total = len(VARIANTS) * len(speeds_kmh) + 2
    for record, variant, speed in _drives(speeds_kmh, seed):
        cases.append(measure(model, trained, record, variant, speed))
        if progress is not None:
            progress(len(cases), total)
    return cases


def measure(
    model: KoopmanModel,
    trained: TrainingRange | None,
    record: Record,
    variant: str,
    speed_kmh: float,
) -> RangeCase:
    """Return the ratios of a model on a record, from `_SETTLED` rows on."""
    scored = np.arange(len(record)) >= _SETTLED
    found = rollout_record(model, record, None, scored, _AHEAD, _STRIDE)
    rows = found.rows
    naive = best_naive(
        {
            name: score(record, rows, x)
            for name, x in naive_predictions(record, rows, _AHEAD).items()
        }
    )
    known, held = (
        score(record, rows, x).rmse / naive
        for x in (found.predicted, found.held_input_predictions)
    )
    share = trained.share_beyond([(record, rows)]) if trained is not None else {}
    beyond = max(share.values(), default=0.0)
    peak = peak_motion(record.rows(slice(_SETTLED, None)))
    return RangeCase(variant, speed_kmh, known, held, beyond, peak)


def peak_motion(record: Record) -> PeakMotion:
    """Return how hard a drive on a flat road is, from its true states."""
    v_x, v_y, rate = record.x_ref.T
    accel = np.gradient(v_y, TICK_NS * 1e-9) + v_x * rate
    peaks = np.abs(record.u[:, 1]), sideslip(record.x_ref), np.abs(accel)
    return PeakMotion(*(float(values.max()) for values in peaks))


def sideslip(x: FloatArray) -> FloatArray:
    """Return the size of the sideslip angle (n,), rad, of states x (n, 3); 0 at standstill."""
    return np.asarray(np.arctan2(np.abs(x[:, 1]), np.abs(x[:, 0])))


def spins(x: FloatArray, friction: float) -> bool:
    """Return whether the car spins in a drive of states x (n, 3), or they are not finite."""
    return not float(sideslip(x).max()) < np.arctan(_SIDESLIP_BOUND * friction * GRAVITY)


def _drives(speeds_kmh: Sequence[float], seed: int) -> Iterator[tuple[Record, str, float]]:
    for variant, changes in VARIANTS.items():
        for speed in speeds_kmh:
            driven = slalom(speed, seed, changes)
            yield _with_noise(driven, seed), f"slalom, {variant}", speed
    for name, speed in ((STOP_AND_GO, 4.0), (REVERSING, -2.5)):
        yield _with_noise(kinematic(speed, seed, stops=speed > 0.0), seed), name, 3.6 * speed


def slalom(speed_kmh: float, seed: int, changes: dict[str, Any]) -> Record:
    """
    Return the truth of the paper's slalom at another speed, on the road.

    :raises DataError: the car spins at that speed however little it steers.
    """
    base = load_scenario("slalom")
    top = speed_kmh / 3.6
    content = base.model_dump() | changes
    content["speed"]["top"] = top
    # From a start at speed, the fast part at 15 to 50 s is driven at the speed in question.
    content["start_speed"] = 0.9 * top
    for _ in range(_MAX_TRIES):
        driven = simulate(Scenario(**content), seed=seed)
        if not spins(driven.x, content["mu"]):
            return driven.truth()
        content["steering"]["amplitude"] *= _STEER_LESS
    raise DataError(f"the car spins in a slalom at {speed_kmh:g} km/h, however little it steers")


def kinematic(speed: float, seed: int, stops: bool) -> Record:
    """Return a minute of driving without slip, m/s; with `stops` the car stands half of it."""
    n = round(_KINEMATIC_S * 1e9) // TICK_NS
    t = np.arange(n) * TICK_NS * 1e-9
    phase = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, 2)
    wave = np.sin(0.4 * t + phase[0])
    # Squared, the speed comes to zero without a jump of the acceleration's sign.
    v_x = speed * (np.maximum(wave, 0.0) ** 2 if stops else 1.0 + 0.3 * wave)
    delta = 0.15 * np.sin(0.7 * t + phase[1])
    rate = v_x * np.tan(delta) / _WHEELBASE
    x = np.column_stack([v_x, _TO_REAR * rate, rate])
    change = np.gradient(x, TICK_NS * 1e-9, axis=0)
    a = np.column_stack([change[:, 0] - x[:, 1] * rate, change[:, 1] + v_x * rate])
    u = np.column_stack([_MASS * a[:, 0] * _RADIUS, delta])
    zeros = np.zeros(n, dtype=np.int64)
    stamp_ns = TICK_NS * np.arange(1, n + 1, dtype=np.int64)
    return Record(stamp_ns, x, u, a, zeros, x.copy(), zeros.copy(), REVERSING)


def _with_noise(record: Record, seed: int) -> Record:
    """Return the record with the noise of the usual simulated sensors."""
    rng = np.random.default_rng(seed)
    odometry = Odometry()
    scale = np.array([odometry.velocity_noise] * 2 + [odometry.yaw_rate_noise])
    x = record.x + scale * rng.normal(size=record.x.shape)
    a = record.a + Imu().accel_noise * rng.normal(size=record.a.shape)
    return replace(record, x=x, a=a)
