# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`adk_ros.simulate`: drive a scenario with the built-in simulator."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from adk_ros.api.output import bag_files, check_output, remove_earlier_bag
from adk_ros.api.progress import Progress, in_stage
from adk_ros.api.tables import as_html, with_units
from adk_ros.signals.channels import INPUT_NAMES, STATE_NAMES, TICK_NS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from adk_ros.plant.scenario.sensor_simulation import SimulatedDrive


@dataclass(frozen=True)
class SimulationResult:
    """
    A simulated drive.

    `drive`: true states and sensor readings. `out`: the bag written, if any. `warnings`: one line
    each, such as effects of the model that do not apply on this road.
    """

    drive: SimulatedDrive
    out: Path | None
    warnings: list[str]

    @property
    def duration_s(self) -> float:
        """Simulated time in s."""
        return round((len(self.drive.stamp_ns) - 1) * TICK_NS * 1e-9, 3)

    @cached_property
    def frame(self) -> pd.DataFrame:
        """
        The true motion, without sensor errors: one row per 25 ms, SI units.

        Index `time_s`: s from the start. Columns `v_x`, `v_y`, `yaw_rate`; `a_x`, `a_y` (specific
        force); `torque`, `delta`: the command in force.
        """
        drive = self.drive
        time_s = np.asarray((drive.stamp_ns - drive.stamp_ns[0]) * 1e-9, dtype=np.float64)
        columns: dict[str, Any] = dict(zip(STATE_NAMES, drive.x.T, strict=True))
        columns |= dict(zip(("a_x", "a_y"), drive.a.T, strict=True))
        columns |= dict(zip(INPUT_NAMES, drive.u.T, strict=True))
        index = pd.Index(time_s, name="time_s")
        return with_units(pd.DataFrame(columns, index=index), drive.name)

    def figure(self) -> Figure:
        """Draw the true states against time."""
        from adk_ros.api.figures import state_figure

        time_s = self.frame.index.to_numpy()
        return state_figure(time_s, {"true": self.drive.x}, f"Scenario {self.drive.name}")

    def _repr_html_(self) -> str:
        title = f"Simulated drive {self.drive.name}: {self.duration_s:.1f} s"
        return as_html(title, self.frame)


def simulate(
    scenario: Path | str,
    out: Path | str | None = None,
    *,
    model: Path | str | None = None,
    seed: int | None = None,
    duration_s: float | None = None,
    storage: str = "mcap",
    compression: str | None = "zstd",
    force: bool = False,
    progress: Progress | None = None,
) -> SimulationResult:
    """
    Drive a scenario with the built-in simulator and write what its sensors send as a bag.

    :param scenario: name of a packaged scenario, or a YAML file.
    :param out: bag to write; default: none.
    :param model: vehicle to drive instead of the scenario's: simulation.yaml or corrected.yaml of
        an earlier `explain`.
    :param seed: seed of route, driver and noise (default: the scenario's).
    :param duration_s: duration in s (default: the scenario's).
    :param storage: "mcap" or "sqlite3". :param compression: "zstd" or None.
    :param force: replace an earlier bag at `out`.
    :raises UsageError: an argument is invalid, or `out` exists.
    :raises DataError: the vehicle cannot drive the scenario.

    Example::

        drive = adk_ros.simulate("handling", duration_s=30.0)
        drive.frame["v_x"].plot()
    """
    from adk_ros.bags.writer import check_storage
    from adk_ros.mismatch.deployment.scenario_drive import (
        position_dependent_terms,
        simulate_scenario,
    )
    from adk_ros.mismatch.deployment.surrogate_file import load_surrogate
    from adk_ros.offline.export import write_bag
    from adk_ros.plant.scenario.scenario_file import load_scenario
    from adk_ros.plant.scenario.simulate import simulate as run

    target = None if out is None else Path(out)
    if target is not None:
        given = [Path(each) for each in (scenario, model) if isinstance(each, str | Path)]
        check_output(target, force, bag_files(target), *given)
        check_storage(storage, compression)
    loaded = load_scenario(scenario)
    report = in_stage(progress, "simulating")
    warnings = []
    if model is None:
        drive = run(loaded, seed, duration_s, report)
    else:
        surrogate = load_surrogate(Path(model))
        drive = simulate_scenario(surrogate, loaded, seed, duration_s, report)
        if omitted := position_dependent_terms(surrogate.content):
            warnings.append(
                f"effects at places of the recording's road are left out: {', '.join(omitted)}"
            )
    if target is not None:
        remove_earlier_bag(target)
        write_bag(drive, target, storage, compression, in_stage(progress, "writing"))
    return SimulationResult(drive, target, warnings)
