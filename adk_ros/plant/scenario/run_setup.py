# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Set-up of a simulation run: duration, command times, excitation, wind and random seeds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adk_ros.errors import UsageError
from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.plant.environment.wind import wind_series
from adk_ros.plant.scenario.driver import excitation_signals
from adk_ros.plant.scenario.scenario_file import Scenario
from adk_ros.plant.scenario.swept_sine import steering_angles
from adk_ros.plant.vehicle.seven_dof import STEP
from adk_ros.signals.channels import TICK_NS


@dataclass(frozen=True)
class RunSetup:
    """
    Set-up of a run. Command k is given at step `phase + (k - 1) every`, the first at step 0.

    `added` (count, 5): see `excitation_signals`; `angles` (count,): open-loop steering, empty if
    the driver steers; `wind` (ticks + 1, 2); `rngs`: random generators of excitation, IMU,
    odometry, command and wind.
    """

    seed: int
    seconds: float
    steps: int
    every: int
    phase: int
    added: FloatArray
    angles: FloatArray
    wind: FloatArray
    rngs: list[np.random.Generator]

    @property
    def count(self) -> int:
        """Number of commands."""
        return int(self.added.shape[0])

    def command_steps(self) -> IntArray:
        """Return the integration step (count,) of each command's stamp."""
        return np.asarray(self.phase + self.every * np.arange(-1, self.count - 1), dtype=np.int64)


def set_up_run(scenario: Scenario, seed: int | None, duration_s: float | None) -> RunSetup:
    """
    Return the set-up of a run; `seed` and `duration_s` override those of the scenario.

    :raises UsageError: either is out of range.
    """
    seed = scenario.seed if seed is None else seed
    if seed < 0:
        raise UsageError(f"scenario {scenario.name}: seed must not be negative, got {seed}")
    seconds = scenario.duration_s if duration_s is None else duration_s
    if not 0.1 < seconds <= 36000.0:
        raise UsageError(f"scenario {scenario.name}: duration must be 0.1 to 36000 s: {seconds}")
    command = scenario.sensors.command
    # Separate random generators: the settings of one sensor do not change the noise of another.
    rngs = [np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(5)]
    steps = round(seconds / STEP)
    every = round(1.0 / (command.rate_hz * STEP))
    phase = round(command.phase_s / STEP) % every
    count = 1 + len(range(phase, steps + 1, every))
    period_s = every * STEP
    added = excitation_signals(
        rngs[0], count, period_s, scenario.excitation, scenario.speed, scenario.start_speed
    )
    angles = np.empty(0)
    if scenario.steering is not None:
        angles = steering_angles(scenario.steering, period_s * np.arange(count, dtype=np.float64))
    ticks = steps // round(TICK_NS * 1e-9 / STEP)
    wind = wind_series(rngs[4], scenario.wind, ticks)
    return RunSetup(seed, seconds, steps, every, phase, added, angles, wind, rngs)
