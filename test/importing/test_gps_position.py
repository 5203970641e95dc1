# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Position from the fixes of a GPS receiver: against the true positions of a simulated drive."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml
from helpers.wheels import bus_map, read_frame, table, town

from adk_ros.api.importing import import_recording, propose_map
from adk_ros.bags import Bag
from adk_ros.errors import DataError, UsageError
from adk_ros.importing.geodesy import east_north
from adk_ros.importing.map_loading import checked_map
from adk_ros.importing.parquet_file import write_parquet
from adk_ros.importing.recording_import import ImportedRecording

METRES_PER_DEGREE = 111_320.0
"""Of longitude at the equator; of latitude within 1 %, which the test of `east_north` covers."""
LATITUDE, LONGITUDE = 50.8, 6.1
GPS = {"latitude": "deg", "longitude": "deg"}


def logged(repeats: int = 4) -> pd.DataFrame:
    """Return the bus with positions at a quarter of its rate, each repeated until the next."""
    frame, pose = table(), town().pose
    held = repeats * (np.arange(len(frame)) // repeats)
    one_metre = np.array([0.0, 1.0])
    east = east_north(np.full(2, LATITUDE), LONGITUDE + one_metre * 1e-5)[0][1] * 1e5
    north = east_north(LATITUDE + one_metre * 1e-5, np.full(2, LONGITUDE))[1][1] * 1e5
    longitude = LONGITUDE + (pose[held, 0] - pose[0, 0]) / east
    latitude = LATITUDE + (pose[held, 1] - pose[0, 1]) / north
    # Receivers write seven decimals, a centimetre.
    return frame.assign(latitude=latitude.round(7), longitude=longitude.round(7))


def gps_map(**computed: Any) -> dict[str, Any]:
    content = bus_map(v_x={"from": "wheel_speeds", "wheels": "rear"}, **computed)
    content["channels"] |= {n: {"column": n, "unit": unit} for n, unit in GPS.items()}
    return content


def imported(folder: Path, frame: pd.DataFrame) -> ImportedRecording:
    return read_frame(folder, frame, gps_map(position={"from": "gps"}))


def test_metres_on_the_ellipsoid() -> None:
    east, north = east_north(np.array([0.0, 0.01]), np.array([0.0, 0.01]))
    assert east[1] == pytest.approx(0.01 * METRES_PER_DEGREE, rel=1e-4)
    # One degree of latitude at the equator is 110.574 km (WGS 84).
    assert north[1] == pytest.approx(1105.74, rel=1e-4)
    far, _ = east_north(np.array([60.0, 60.0]), np.array([0.0, 0.01]))
    assert far[1] == pytest.approx(
        0.01 * METRES_PER_DEGREE * math.cos(math.radians(60.0)), rel=3e-3
    )


def test_positions_are_those_of_the_drive(tmp_path: Path) -> None:
    frame = logged()
    path = tmp_path / "drive.parquet"
    write_parquet(frame, path)
    content = gps_map(position={"from": "gps"})
    (tmp_path / "map.yaml").write_text(yaml.safe_dump(content))
    result = import_recording([path], tmp_path / "map.yaml", tmp_path / "bag")
    assert any("fixes (10 Hz)" in line for line in result.notes)
    with Bag(tmp_path / "bag") as bag:
        rows = [
            (msg.header.stamp.sec + 1e-9 * msg.header.stamp.nanosec, p.x, p.y)
            for _, _, msg in bag.messages(["/odometry"])
            for p in (msg.pose.pose.position,)
        ]
    found, true = np.array(rows), town().pose
    at_s = found[:, 0] - found[0, 0]
    # 10 Hz and a few m/s² leave a centimetre between fixes.
    for axis in (0, 1):
        expected = np.interp(at_s, frame["t"], true[:, axis] - true[0, axis])
        assert np.abs(found[:, 1 + axis] - expected).max() < 0.1


def channel(recording: ImportedRecording, name: str) -> tuple[np.ndarray, np.ndarray]:
    (found,) = [each for each in recording.channels if each.name == name]
    return (found.stamp_ns - found.stamp_ns[0]) * 1e-9, found.values


def test_repeated_fixes_are_new_once_and_a_standing_car_stays(tmp_path: Path) -> None:
    frame = logged()
    still = slice(400, 800)
    for name in GPS:
        frame.loc[frame.index[still], name] = frame[name].iloc[400]
    at_s, x = channel(imported(tmp_path, frame), "x")
    t = frame["t"].to_numpy()
    standing = (at_s >= t[400]) & (at_s <= t[799])
    assert np.ptp(x[standing]) == 0.0
    # All rows of the pause, else it would be a gap; one in four of the others.
    assert standing.sum() >= 396
    assert (~standing).sum() == pytest.approx((len(frame) - 400) / 4, abs=3)


def test_rows_without_a_fix_are_left_out(tmp_path: Path) -> None:
    frame = logged()
    frame.loc[frame.index[:40], list(GPS)] = 0.0
    frame.loc[frame.index[40:80], list(GPS)] = np.nan
    recording = imported(tmp_path, frame)
    assert any("40 rows without a fix are left out" in line for line in recording.notes)
    _, x = channel(recording, "x")
    assert np.abs(x).max() < 5e3
    # No position is invented for the rows before the first fix.
    (odometry,) = [topic for topic in recording.outcome.topics if topic.name == "/odometry"]
    t = frame["t"].to_numpy()
    since_s = (odometry.stream.stamp_ns - odometry.stream.stamp_ns[-1]) * 1e-9
    assert since_s[0] >= t[80] - t[-1] - 1e-6
    assert any("before the first or after the last value of x" in line for line in recording.notes)
    with pytest.raises(DataError, match="no two different fixes"):
        imported(tmp_path, frame.assign(latitude=0.0, longitude=0.0))


def test_the_proposal_computes_positions(tmp_path: Path) -> None:
    kept = ["t", "a_x", "a_y", "yaw_rate", "delta", "gps_speed", *GPS]
    logged()[kept].to_csv(tmp_path / "a.csv", index=False)
    loaded = yaml.safe_load(propose_map(tmp_path / "a.csv").text)
    assert loaded["computed"] == {"v_x": {"from": "gps"}, "position": {"from": "gps"}}
    checked_map("map.yaml", loaded)


def test_without_the_entry_a_note_names_it(tmp_path: Path) -> None:
    notes = read_frame(tmp_path, logged(), gps_map()).notes
    assert any("computed: {position: {from: gps}}" in line for line in notes)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"x": {"column": "x", "unit": "m"}}, "channels.x is given as well"),
        ({"latitude": None}, "needs channels.latitude"),
    ],
)
def test_an_entry_that_cannot_work_is_refused(changed: dict[str, Any], said: str) -> None:
    content = gps_map(position={"from": "gps"})
    channels = content["channels"] | changed
    content["channels"] = {name: entry for name, entry in channels.items() if entry}
    with pytest.raises(UsageError, match=f"m: computed.position: {said}"):
        checked_map("m", content)
