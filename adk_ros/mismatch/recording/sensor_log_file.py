# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A sensor log as a file, so that a bag that is analysed several times is decoded once."""

from __future__ import annotations

import json
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from pydantic import TypeAdapter

from adk_ros.errors import DataError
from adk_ros.files.whole_file import whole_file
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.signals.decode import SensorConfig

_TEXT = "text"


def save_sensor_log(log: SensorLog, path: Path) -> None:
    """
    Write a log without a measured road as a file of arrays, without pickled objects.

    The file appears whole or not at all. :raises OSError: it cannot be written.
    """
    assert log.road is None
    values = {f.name: getattr(log, f.name) for f in fields(log) if f.name != "road"}
    arrays: dict[str, Any] = {k: v for k, v in values.items() if isinstance(v, np.ndarray)}
    text = {name: value for name, value in values.items() if name not in arrays}
    encoded = json.dumps(text | {"sensors": asdict(log.sensors)}).encode()
    arrays[_TEXT] = np.frombuffer(encoded, dtype=np.uint8)
    with whole_file(path) as file:
        np.savez(file, **arrays)


def load_sensor_log(path: Path) -> SensorLog:
    """
    Return a log from its file.

    :raises DataError: it is no such file, or it cannot be read.
    """
    try:
        with np.load(path, allow_pickle=False) as content:
            arrays = {name: content[name] for name in content.files if name != _TEXT}
            text: dict[str, Any] = json.loads(content[_TEXT].tobytes())
        sensors = TypeAdapter(SensorConfig).validate_python(text.pop("sensors"))
        warnings = tuple(text.pop("warnings"))
        return SensorLog(**arrays, **text, sensors=sensors, warnings=warnings)
    except (BadZipFile, EOFError, KeyError, OSError, TypeError, ValueError) as error:
        raise DataError(f"{path} is no sensor log: {error}") from None
