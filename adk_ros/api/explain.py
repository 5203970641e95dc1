# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`adk_ros.explain`: which physics a simulation lacks compared with a recording."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from adk_ros.api.output import check_output
from adk_ros.api.progress import Progress, in_stage
from adk_ros.api.recording import read_log
from adk_ros.api.recording_paths import different_recordings
from adk_ros.api.tables import UNITS, as_html
from adk_ros.bags.recording import RecordingOptions
from adk_ros.errors import UsageError
from adk_ros.files.output_folder import check_output_folder

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from adk_ros.files.pages.provenance import Provenance
    from adk_ros.mismatch.inference.result import MismatchResult
    from adk_ros.mismatch.recording.nominal_vehicle import NominalVehicle
    from adk_ros.mismatch.recording.sensor_log import SensorLog
    from adk_ros.mismatch.surrogate.identification import SurrogateModel

RESULT_FILES = ("mismatch.json",)
"""Identifies an earlier result in a folder."""


@dataclass(frozen=True)
class MismatchExplanation:
    """
    The differences between a simulation and a recording.

    `result`: the full result with residuals, losses and models. `warnings`: what looks wrong in
    the bags, one line each. `provenance`: input files with hashes, command, version, date.
    `extrinsics`: the pose of the IMU, in a line for each bag that gave it in `/tf_static`.
    """

    result: MismatchResult
    warnings: list[str]
    provenance: Provenance | None = None
    extrinsics: Sequence[str] = ()

    @property
    def verdict(self) -> str:
        """`none` (nothing material is missing), `explained` or `unknown`."""
        return self.result.verdict

    @cached_property
    def summary(self) -> str:
        """The result in a sentence."""
        from adk_ros.mismatch.report.agreement_table import agreement_text

        text: str = self.as_dict()["sentence"]
        return f"{text} {agreement_text(self.result.agreement)}".rstrip()

    @property
    def answers(self) -> list[str]:
        """Answers to the effects that were asked for, one paragraph each."""
        from adk_ros.mismatch.report.asked_text import asked_text

        return [asked_text(each) for each in self.result.asked]

    @property
    def notes(self) -> list[str]:
        """Assumptions and limits of this analysis, one line each."""
        return [*self.result.notes, *(item.text for item in self.result.missing_channels)]

    @cached_property
    def effects(self) -> pd.DataFrame:
        """
        The identified effects, one row per parameter.

        Index (effect, parameter). Columns: `value` with its 90 % interval `low` to `high`, in
        `unit`, relative to the simulation; `confidence`, the posterior probability of the effect
        against the alternatives tried; `where`, when or at which place it acts; `alternatives`,
        effects that this recording cannot distinguish from it; `category`, physics or calibration.
        Empty if nothing is missing.
        """
        columns = ["value", "low", "high", "unit", "confidence", "where", "alternatives"]
        columns += ["category"]
        keys, rows = [], []
        for effect in self.as_dict()["effects"]:
            for name, interval in effect["parameters"].items():
                keys.append((effect["name"], name))
                rows.append(
                    [
                        *(interval[column] for column in columns[:4]),
                        effect["confidence"],
                        effect["where"]["text"],
                        ", ".join(effect["alternatives"]),
                        effect["category"],
                    ]
                )
        index = pd.MultiIndex.from_tuples(keys, names=["effect", "parameter"])
        return pd.DataFrame(rows, columns=columns, index=index)

    @cached_property
    def errors(self) -> pd.DataFrame:
        """
        RMSE of open-loop predictions over `result.horizon_s`, on data not used for fitting.

        Index: channel. Columns: `simulation`, `corrected` (the simulation with the identified
        effects) and `unit`. NaN where the recording does not allow a statement.
        """
        fit = self.as_dict()["fit"]
        frame = pd.DataFrame({"simulation": fit["before"], "corrected": fit["after"]}, dtype=float)
        frame.index.name = "channel"
        frame["unit"] = [UNITS[str(channel)] for channel in frame.index]
        return frame

    @property
    def figures(self) -> dict[str, Figure]:
        """
        Figures by name.

        `residuals`: residuals over time in multiples of their noise, of the simulation and of the
        corrected model. `errors`: the errors of `errors` as bars. The report has more.
        """
        from adk_ros.api.figures import improvement_figure, residual_figure
        from adk_ros.mismatch.recording.sensor_log import CHANNELS

        series = self.result.series
        noise = series.noise[:, None]
        return {
            "residuals": residual_figure(
                series.time_s,
                series.before / noise,
                series.after / noise,
                tuple(CHANNELS),
                "Residual / noise",
            ),
            "errors": improvement_figure(
                self.errors, f"Error of predictions over {self.result.horizon_s:g} s"
            ),
        }

    def as_dict(self) -> dict[str, Any]:
        """Return the content of mismatch.json."""
        from adk_ros.mismatch.report.result_files import as_dict

        return as_dict(self.result)

    def write(self, folder: Path | str, force: bool = False) -> None:
        """
        Write report.html with its figures, mismatch.json, simulation.yaml and corrected.yaml.

        :param force: replace an earlier result in the folder.
        :raises UsageError: the folder exists or cannot be written.
        """
        from adk_ros.mismatch.report.result_files import write_report

        check_output(Path(folder), force, RESULT_FILES)
        write_report(self.result, Path(folder), provenance=self.provenance)

    def _repr_html_(self) -> str:
        return as_html(self.summary, self.effects, self.errors)


def explain(
    simulation: Path | str,
    recording: Path | str | Sequence[Path | str],
    vehicle: Path | str | None = None,
    out: Path | str | None = None,
    *,
    held_out: Sequence[Path | str] = (),
    ask: Sequence[str] = (),
    without_imu: bool = False,
    options: RecordingOptions | None = None,
    simulation_options: RecordingOptions | None = None,
    force: bool = False,
    progress: Progress | None = None,
) -> MismatchExplanation:
    """
    Find which physics a simulation lacks compared with a recording: 0.5 to 3 min, one core.

    :param simulation: bag of the simulator; or the YAML file of the simulated vehicle; or the
        simulation.yaml of an earlier report.
    :param recording: bag of the real car; or several, in their order in time, to be analysed
        jointly and compared (`result.agreement`).
    :param vehicle: nominal vehicle of the simulation, YAML or a packaged name; only with a bag of
        the simulator. Default: mass estimated from the bag, wheel radius 0.325 m.
    :param out: folder for the report; default: none, see `MismatchExplanation.write`.
    :param held_out: further bags of the same car, which measure the improvement, can withdraw
        claims and decide what is exported. Default: the last quarter of each recording, which is
        then left out of every selection.
    :param ask: effects of the catalogue, to be answered why they are claimed or not.
    :param without_imu: accept a recording without an IMU and use odometry only.
    :param options: how to read the bags, see `recording_options`.
    :param simulation_options: how to read the simulator's bag, where calibrations of the real
        car's sensors in `options` do not hold for it. Default: `options`.
    :param force: replace an earlier result in `out`.
    :raises UsageError: an argument is invalid, or `out` exists.
    :raises DataError: a recording is unusable.

    Example::

        result = adk_ros.explain("bags/handling", "real", vehicle="imdv")
        print(result.summary)
        result.effects
    """
    from adk_ros.api.provenance import RunTimer
    from adk_ros.mismatch.analysis import identify_mismatch
    from adk_ros.mismatch.inputs import vehicle_scale
    from adk_ros.mismatch.recording.sensor_log import SensorLog

    timer = RunTimer()
    check_asked(ask)
    simulation = Path(simulation)
    recordings = different_recordings(recording)
    if out is not None:
        check_output(Path(out), force, RESULT_FILES, simulation, *recordings)
        check_output_folder(Path(out))
    if simulation.resolve() in [bag.resolve() for bag in recordings]:
        raise UsageError(f"{simulation}: simulation and recording are the same bag")
    options = options or RecordingOptions()
    simulated_with = simulation_options or options
    inputs = _read_inputs(
        simulation, recordings, vehicle, without_imu, options, simulated_with, progress
    )
    simulated, recorded, nominal = inputs
    others = _read_held_out(
        [Path(path) for path in held_out],
        recordings,
        options,
        progress,
        vehicle_scale(simulated, nominal),
    )
    logs = [*recorded, *others]
    if isinstance(simulated, SensorLog):
        logs.append(simulated)
    warnings = [line for log in logs for line in log.warnings]
    extrinsics = [log.extrinsics for log in logs if log.extrinsics]

    def comparing(done: float, total: float, detail: str) -> None:
        in_stage(progress, "comparing")(done, total, detail)

    explanation = MismatchExplanation(
        identify_mismatch(simulated, recorded, nominal, comparing, others, ask),
        warnings,
        extrinsics=extrinsics,
    )
    sources = [("simulation", simulation), *(("recording", bag) for bag in recordings)]
    sources += [("held-out recording", Path(path)) for path in held_out]
    if vehicle is not None and Path(vehicle).is_file():
        sources.append(("vehicle", Path(vehicle)))
    explanation = replace(explanation, provenance=timer.provenance(sources))
    if out is not None:
        explanation.write(out, force)
    return explanation


def check_asked(names: Sequence[str]) -> None:
    """
    Check the names of effects to ask for.

    :raises UsageError: a name is not in the catalogue; the message lists close names.
    """
    from adk_ros.mismatch.library.catalogue import EFFECTS

    for name in names:
        if name in EFFECTS:
            continue
        close = difflib.get_close_matches(name.replace("-", "_"), EFFECTS, n=3, cutoff=0.4)
        close += [each for each in EFFECTS if name in each and each not in close]
        listed = f": {', '.join(close)}?" if close else ""
        raise UsageError(
            f"--ask {name}: no such effect{listed} (all names: doc/reference/effects.md)"
        )


def _read_held_out(
    bags: Sequence[Path],
    recordings: Sequence[Path],
    options: RecordingOptions,
    progress: Progress | None,
    length_scale: float,
) -> list[SensorLog]:
    """Return the held-out recordings; only their odometry and commands are used."""
    from adk_ros.mismatch.deployment.held_out import check_held_out

    logs = []
    for bag in bags:
        if bag.resolve() in [recording.resolve() for recording in recordings]:
            raise UsageError(f"{bag}: the recording itself is not held out: give another bag")
        log = read_log(bag, options, progress, needs_imu=False)
        check_held_out(replace(log, length_scale=length_scale))
        logs.append(log)
    return logs


def _read_inputs(
    simulation: Path,
    recordings: Sequence[Path],
    vehicle: Path | str | None,
    without_imu: bool,
    options: RecordingOptions,
    simulated_with: RecordingOptions,
    progress: Progress | None,
) -> tuple[SensorLog | SurrogateModel, list[SensorLog], NominalVehicle | None]:
    """Return the simulation, the recordings and the nominal vehicle."""
    from adk_ros.mismatch.deployment.simulator_input import (
        is_simulator_file,
        load_simulator,
        simulate_matched_drive,
    )
    from adk_ros.mismatch.recording.nominal_vehicle import (
        load_nominal_vehicle,
        nominal_vehicle_of,
    )
    from adk_ros.plant.vehicle.vehicle_parameters import Vehicle

    simulator = load_simulator(simulation) if is_simulator_file(simulation) else None
    if simulator is not None and vehicle is not None:
        raise UsageError(
            f"{simulation} already describes the vehicle: use --vehicle only with a bag of the "
            "simulator"
        )
    nominal = None if vehicle is None else load_nominal_vehicle(vehicle)
    # If the simulation is a bag with an IMU, a recording without one probably misses a topic.
    needs_imu = simulator is None and not without_imu
    radius = 0.0 if nominal is None else nominal.wheel_radius

    recorded = [
        read_log(
            bag,
            options,
            progress,
            needs_imu=needs_imu,
            needs_command=False,
            wheel_radius=radius,
        )
        for bag in recordings
    ]
    if isinstance(simulator, Vehicle):
        driven = simulate_matched_drive(simulator, recorded[0], simulation.name)
        return driven, recorded, nominal_vehicle_of(simulator, is_simulated=True)
    if simulator is not None:
        return simulator, recorded, nominal
    return read_log(simulation, simulated_with, progress, wheel_radius=radius), recorded, nominal
