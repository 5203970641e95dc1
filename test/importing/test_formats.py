# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One drive as CSV, Parquet, MAT, MDF4, CAN log and bag of other messages: the same records."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from helpers import importing as source
from helpers.train import bag

from adk_ros.api.importing import import_recording
from adk_ros.bags.recording import read_recording
from adk_ros.signals.channels import Record

EXACT = {
    "csv": (source.write_csv, source.si_map(time=source.STAMPS)),
    "parquet": (source.write_parquet_files, source.si_map(time=source.STAMPS)),
    "mat": (source.write_mat, source.si_map(time=source.STAMPS)),
    "mdf": (source.write_mdf, source.si_map()),
    "bag": (
        source.write_other_bag,
        {
            "channels": {
                name: {"column": path, "unit": source.UNITS[name]}
                for name, path in source.OTHER_FIELDS.items()
            }
        },
    ),
}


def same(first: Record, second: Record) -> None:
    for name in ("stamp_ns", "x", "u", "a", "flags", "x_ref", "episode"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name), name)


@pytest.mark.parametrize("kind", EXACT)
def test_formats_of_float64_give_identical_records(tmp_path: Path, kind: str) -> None:
    write, channels = EXACT[kind]
    result = import_recording(write(tmp_path), channels, tmp_path / "out")
    assert result.notes == []
    assert result.not_imported == {}
    same(read_recording(bag("town", source.SECONDS)).record, read_recording(result.out).record)


@pytest.mark.parametrize("suffix", [".blf", ".asc", ".log"])
def test_can_logs_give_the_record_within_the_resolution_of_the_bus(
    tmp_path: Path, suffix: str
) -> None:
    files = source.write_can(tmp_path, suffix)
    result = import_recording(
        files, source.can_map(), tmp_path / "out", dbc=[tmp_path / "drive.dbc"]
    )
    assert result.not_imported == {}
    rows = result.channels
    pairs = [(name, x) for x in source.frames().values() for name in x.columns[1:]]
    for name, frame in pairs:
        count = min(frame.shape[0], 200)
        got = next(c for c in result.content.channels if c.name == name)
        assert rows.loc[name, "count"] == frame.shape[0]
        # They store the time as a decimal or float64 of seconds, ASC from the local date on.
        difference_ns = got.stamp_ns[:count] - frame["stamp_ns"].to_numpy()[:count]
        assert np.abs(difference_ns - np.median(difference_ns)).max() <= 1_000
        if suffix != ".asc":
            assert np.abs(difference_ns).max() <= 1_000
        resolution = source.can_unit(name)[1]
        assert np.abs(got.values - frame[name].to_numpy()).max() <= 0.5001 * resolution
    record = read_recording(result.out).record
    reference = read_recording(bag("town", source.SECONDS)).record
    if suffix != ".asc":
        both = np.intersect1d(record.stamp_ns, reference.stamp_ns)
        assert both.shape[0] == len(reference)
        inside = np.isin(record.stamp_ns, both)
        assert np.abs(record.x[inside, 0] - reference.x[:, 0]).max() < 0.02
        assert np.abs(record.u[inside] - reference.u).max() < 0.51
