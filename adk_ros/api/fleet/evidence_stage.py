# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Stage `evidence`: what one recording says about every effect of the catalogue at once."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from adk_ros.api.fleet.index_stage import file_hash
from adk_ros.bags.recording import RecordingOptions
from adk_ros.errors import DataError
from adk_ros.files.code_digest import code_digest
from adk_ros.fleet.stage import hash_of

if TYPE_CHECKING:
    from adk_ros.fleet.inference.evidence import Row
    from adk_ros.fleet.inference.fleet_simulation import FleetSimulation
    from adk_ros.mismatch.recording.sensor_log import SensorLog

_BYTES = "base64:"
"""Begin of a text that holds bytes; no other text of a row begins with it."""


@dataclass(frozen=True)
class EvidenceStage:
    """
    The likelihood of a recording as a quadratic form of all effects (`fleet.inference.evidence`).

    `simulation`: file of `FleetSimulation.save`; `point`: file with the fleet's estimate at which
    to linearise (`write_point`), "" for no effect. Rows: kind `recording` with the loss over that
    of a perfect model as value, and `place` for each cell of the map; details hold the evidence.
    `options`: topics and sensor configuration. `logs`: folder in which decoded recordings are kept
    for further passes, "" for none; `content`: hash of the recording's content.
    """

    simulation: str
    point: str = ""
    without_imu: bool = False
    options: RecordingOptions = field(default_factory=RecordingOptions)
    logs: str = ""
    content: str = ""
    name: str = "evidence"

    @property
    def model_hash(self) -> str:
        """Hash of the identified simulation."""
        return file_hash(self.simulation)

    @property
    def inputs_hash(self) -> str:
        """Hash of the simulation, of topics and sensor configuration."""
        return self.inputs_of_model(self.model_hash)

    def inputs_of_model(self, model_hash: str) -> str:
        """Return `inputs_hash`, given that of the simulation."""
        return hash_of([model_hash, self.without_imu, asdict(self.options)])

    def recording_inputs(self) -> Callable[[str], str]:
        """Return name of a recording -> hash of the estimate at which it is linearised."""
        values, places = _point_content(self.point)
        at_places = hash_of(places) if places else ""

        def inputs_of(recording: str) -> str:
            separate = sorted(values.get(recording, {}).items())
            return hash_of([separate, at_places]) if separate or places else ""

        return inputs_of

    @property
    def shared_paths(self) -> tuple[str, ...]:
        """Files of the simulation and of the estimate, folder of decoded recordings."""
        return tuple(path for path in (self.simulation, self.point, self.logs) if path)

    def of_content(self, content_hash: str) -> EvidenceStage:
        """Return the stage for a recording with this hash of its content."""
        return replace(self, content=content_hash)

    def run_kept(self, recording: str) -> list[dict[str, Any]] | None:
        """Return the rows of a recording that was decoded before; None if it was not."""
        from adk_ros.mismatch.recording.sensor_log_file import load_sensor_log

        if not (self.logs and self.content):
            return None
        simulation = self._identified()
        # Whatever a crash or another version left there, the recording can be decoded.
        try:
            log = load_sensor_log(self._kept(simulation))
        except DataError:
            return None
        return self._rows(log, simulation, recording)

    def run(self, path: Path, recording: str) -> list[dict[str, Any]]:
        """Return the rows of the recording of this name."""
        from adk_ros.api.recording import read_log
        from adk_ros.mismatch.recording.sensor_log_file import save_sensor_log

        simulation, needs_imu = self._identified(), not self.without_imu
        radius = _wheel_radius(simulation)
        log = read_log(path, self.options, needs_imu=needs_imu, wheel_radius=radius)
        if self.logs and self.content:
            with suppress(OSError):
                save_sensor_log(log, self._kept(simulation))
        return self._rows(log, simulation, recording)

    def _rows(
        self, log: SensorLog, simulation: FleetSimulation, recording: str
    ) -> list[dict[str, Any]]:
        from adk_ros.fleet.inference.evidence import RECORDING
        from adk_ros.fleet.inference.recording_evidence import evidence_rows

        values, local = read_point(self.point, recording)
        return [
            {
                "kind": row["kind"],
                "finding": "evidence",
                "value": row["loss_ratio"] if row["kind"] == RECORDING else None,
                "details": evidence_text(row),
            }
            for row in evidence_rows(log, simulation, values, local, name=recording)
        ]

    def _kept(self, simulation: FleetSimulation) -> Path:
        """Return the file of the decoded recording; decoding takes two thirds of a pass."""
        radius = _wheel_radius(simulation)
        read_with = [self.without_imu, radius, asdict(self.options), code_digest()]
        return Path(self.logs) / f"{hash_of([self.content, *read_with])}.npz"

    def _identified(self) -> FleetSimulation:
        return _simulation(self.simulation, file_hash(self.simulation))


def _wheel_radius(simulation: FleetSimulation) -> float:
    from adk_ros.mismatch.library.surrogate_parameters import INDEX

    return float(simulation.surrogate.parameters[INDEX["wheel_radius"]])


@lru_cache(maxsize=1)
def _simulation(path: str, digest: str) -> FleetSimulation:
    from adk_ros.fleet.inference.fleet_simulation import FleetSimulation

    return FleetSimulation.load(Path(path))


def evidence_text(row: Row) -> str:
    """Return a row of evidence as JSON, its bytes in base64."""
    return json.dumps(
        {
            key: _BYTES + base64.b64encode(value).decode() if isinstance(value, bytes) else value
            for key, value in row.items()
        }
    )


def evidence_row(text: str, recording: str) -> Row:
    """Return the row of `evidence_text`, of a recording by its name in the fleet."""
    row: Row = json.loads(text)
    for key, value in row.items():
        if isinstance(value, str) and value.startswith(_BYTES):
            row[key] = base64.b64decode(value.removeprefix(_BYTES))
    return row | {"recording": recording}


def write_point(path: Path, values: Mapping[str, Mapping[str, float]], local: list[Any]) -> None:
    """Write the estimate of a fleet: recording -> key -> value, and effects at places."""
    # Their order is that of their significance, which changes nothing here.
    places = sorted([one.key, [cell.text for cell in one.cells], one.value] for one in local)
    content = {"values": {name: dict(x) for name, x in sorted(values.items())}, "places": places}
    path.write_text(json.dumps(content, indent=1), encoding="utf-8")


def read_point(path: str, recording: str) -> tuple[dict[str, float], list[Any]]:
    """Return the estimate for a recording and the effects at places; none for "" as path."""
    from adk_ros.fleet.inference.place_evidence import Cell
    from adk_ros.fleet.inference.recording_evidence import PlacedValue

    values, places = _point_content(path)
    local = [
        PlacedValue(key, tuple(Cell.of_text(text) for text in cells), value)
        for key, cells, value in places
    ]
    return values.get(recording, {}), local


def _point_content(path: str) -> tuple[dict[str, dict[str, float]], list[Any]]:
    if not path:
        return {}, []
    content = json.loads(Path(path).read_text(encoding="utf-8"))
    return content["values"], content["places"]
