# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""v_x from wheel speeds and GPS: against the truth of simulated drives, radius with interval."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from helpers.train import refused
from helpers.wheels import GPS_DELAY_S, UNITS, bus_map, read_frame, table, town

from adk_ros.api.importing import import_recording
from adk_ros.bags.recording import read_recording
from adk_ros.errors import UsageError
from adk_ros.importing.column_names import recognise
from adk_ros.importing.map_loading import checked_map
from adk_ros.importing.parquet_file import write_parquet
from adk_ros.importing.recording_import import ImportedRecording, read_channels

RADIUS = 0.325


def true_speed() -> np.ndarray:
    """Return v_x of the drive of `table`, m/s."""
    return town().x[:, 0]


def imported(
    folder: Path, frame: pd.DataFrame, without: tuple[str, ...] = (), **velocity: object
) -> ImportedRecording:
    return read_frame(folder, frame, bus_map(*without, v_x={"from": "wheel_speeds"} | velocity))


def error(recording: ImportedRecording) -> np.ndarray:
    (v,) = [channel for channel in recording.channels if channel.name == "v_x"]
    at = (v.stamp_ns - v.stamp_ns[0]) * 1e-9
    return np.asarray(v.values - np.interp(at, table()["t"], true_speed()))


def note(recording: ImportedRecording, beginning: str) -> str:
    (line,) = [line for line in recording.notes if line.startswith(beginning)]
    return line


def test_undriven_wheels_give_the_speed(tmp_path: Path) -> None:
    undriven = error(imported(tmp_path, table(), wheels="rear", wheel_radius=RADIUS))
    front = error(imported(tmp_path, table(), wheels="front", wheel_radius=RADIUS))
    # 0.3 % of 13 m/s; driven wheels slip.
    assert np.sqrt(np.mean(undriven**2)) < 0.04
    assert np.sqrt(np.mean(front**2)) > 5.0 * np.sqrt(np.mean(undriven**2))


def test_the_radius_is_identified_by_a_late_gps(tmp_path: Path) -> None:
    recording = imported(tmp_path, table(), wheels="rear", wheel_radius="identify")
    line = note(recording, "v_x from wheel_speed_rear_left, wheel_speed_rear_right")
    words = line.split("wheel radius ")[1].split()
    radius, low, high = float(words[0]), float(words[2][1:]), float(words[4].rstrip(","))
    assert low < radius < high < 1.01 * low
    # Speed over ground includes the sideslip of bends: 0.1 %.
    assert radius == pytest.approx(RADIUS, rel=2e-3)
    assert f"which is {GPS_DELAY_S:.2f} s late" in line
    assert np.sqrt(np.mean(error(recording) ** 2)) < 0.06


def test_the_radius_is_identified_by_positions(tmp_path: Path) -> None:
    drive = town()
    frame = table().drop(columns="gps_speed").assign(x=drive.pose[:, 0], y=drive.pose[:, 1])
    frame["heading"] = np.unwrap(drive.pose[:, 2])
    content = bus_map("gps_speed", v_x={"from": "wheel_speeds", "wheels": "rear"})
    units = {"x": "m", "y": "m", "heading": "rad"}
    content["channels"] |= {n: {"column": n, "unit": unit} for n, unit in units.items()}
    recording = read_frame(tmp_path, frame, content)
    line = note(recording, "v_x from wheel_speed_rear_left")
    assert "against the positions" in line
    assert float(line.split("wheel radius ")[1].split()[0]) == pytest.approx(RADIUS, rel=2e-3)


def test_the_radius_is_identified_by_satellite_positions(tmp_path: Path) -> None:
    latitude, degrees = 48.0, 180.0 / np.pi
    east, north = town().pose[:, 0], town().pose[:, 1]
    # Radii of curvature of WGS 84 at 48°: along the meridian, and across it.
    frame = (
        table()
        .drop(columns="gps_speed")
        .assign(
            latitude=latitude + degrees * north / 6_370_730.0,
            longitude=11.0 + degrees * east / (6_389_960.0 * np.cos(np.radians(latitude))),
        )
    )
    content = bus_map("gps_speed", v_x={"from": "wheel_speeds", "wheels": "rear"})
    for name in ("latitude", "longitude"):
        content["channels"][name] = {"column": name, "unit": "deg"}
    recording = read_frame(tmp_path, frame, content)
    line = note(recording, "v_x from wheel_speed_rear_left")
    assert "against GPS positions" in line
    assert float(line.split("wheel radius ")[1].split()[0]) == pytest.approx(RADIUS, rel=5e-3)


def test_a_gap_of_the_receiver_is_not_compared(tmp_path: Path) -> None:
    frame = table().copy()
    frame.loc[(frame["t"] > 30.0) & (frame["t"] < 41.0), "gps_speed"] = np.nan
    recording = imported(tmp_path, frame, wheels="rear", wheel_radius="identify")
    line = note(recording, "v_x from wheel_speed_rear_left")
    assert float(line.split("wheel radius ")[1].split()[0]) == pytest.approx(RADIUS, rel=3e-3)
    seconds = float(line.split(" s) against")[0].split()[-1])
    assert seconds == pytest.approx(90.0 - 15.0, abs=5.1)


def test_a_stated_radius_is_compared_with_the_gps(tmp_path: Path) -> None:
    recording = imported(tmp_path, table(), wheels="rear", wheel_radius=0.31)
    assert "wheel radius 0.31 m; identified: 0.325" in note(recording, "v_x from")


def test_wheel_speeds_in_kmh_keep_the_speed_that_they_state(tmp_path: Path) -> None:
    frame, content = table().copy(), bus_map(v_x={"from": "wheel_speeds", "wheels": "rear"})
    for name in UNITS:
        if name.startswith("wheel_speed_"):
            frame[name] *= 3.6 * RADIUS
            content["channels"][name] = {"column": name, "unit": "km/h", "wheel_radius": 0.5}
    recording = read_frame(tmp_path, frame, content)
    assert np.sqrt(np.mean(error(recording) ** 2)) < 0.04


def test_an_axle_and_its_wheels_are_the_same(tmp_path: Path) -> None:
    frame = table().copy()
    pair = [f"wheel_speed_rear_{side}" for side in ("left", "right")]
    frame["axle"] = frame[pair].mean(axis=1)
    content = bus_map(*pair, v_x={"from": "wheel_speeds", "wheels": "rear"})
    content["channels"]["wheel_speed_rear"] = {"column": "axle", "unit": "rad/s"}
    content["computed"]["v_x"]["wheel_radius"] = RADIUS
    path = tmp_path / "b.csv"
    frame.to_csv(path, index=False)
    recording = read_channels([path], checked_map("m", content), "m", [])
    wheels = error(imported(tmp_path, table(), wheels="rear", wheel_radius=RADIUS))
    assert error(recording) == pytest.approx(wheels, abs=1e-9)
    assert "/vehicle/wheel_speed/rear" in {topic.name for topic in recording.outcome.topics}


def test_reverse_gear_turns_the_sign(tmp_path: Path) -> None:
    frame = table().assign(gear=np.where(table()["t"] < 10.0, -1.0, 1.0))
    content = bus_map(
        v_x={"from": "wheel_speeds", "wheels": "rear", "wheel_radius": RADIUS},
    )
    content["channels"]["gear"] = {"column": "gear", "unit": "1"}
    recording = read_frame(tmp_path, frame, content)
    (v,) = [channel for channel in recording.channels if channel.name == "v_x"]
    assert (np.sign(v.values) == np.where(frame["t"] < 10.0, -1.0, 1.0)).all()


def test_left_and_right_are_compared_with_the_gyro(tmp_path: Path) -> None:
    recording = imported(tmp_path, table(), wheels="rear", wheel_radius=RADIUS)
    line = note(recording, "rear wheels agree with yaw_rate")
    # The track of the simulated car is 1.715 m.
    assert float(line.split("radius ")[1].split()[0]) == pytest.approx(1.715 / RADIUS, rel=0.01)
    names = {"wheel_speed_rear_left": "wheel_speed_rear_right"}
    names |= {right: left for left, right in names.items()}
    swapped = imported(tmp_path, table().rename(columns=names), wheels="rear", wheel_radius=RADIUS)
    assert "left and right are swapped" in note(swapped, "rear wheels: the right one turns slower")


def test_gps_gives_the_speed_at_its_stamps(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    table().to_csv(path, index=False)
    content = bus_map(v_x={"from": "gps"})
    recording = read_channels([path], checked_map("m", content), "m", [])
    (v,) = [channel for channel in recording.channels if channel.name == "v_x"]
    assert np.array_equal(v.values, table()["gps_speed"].dropna())


def test_formats_agree_and_the_bag_is_read(tmp_path: Path) -> None:
    table().to_csv(tmp_path / "a.csv", index=False)
    write_parquet(table(), tmp_path / "a.parquet")
    content = bus_map(v_x={"from": "wheel_speeds", "wheels": "rear", "wheel_radius": "identify"})
    records = []
    for suffix in ("csv", "parquet"):
        import_recording(tmp_path / f"a.{suffix}", content, tmp_path / suffix)
        records.append(read_recording(tmp_path / suffix).record)
    assert np.array_equal(records[0].x, records[1].x)
    assert np.array_equal(records[0].measured, [True, False, True])


@pytest.mark.parametrize(
    ("column", "channel"),
    [
        ("wheel_speed_front", "wheel_speed_front"),
        ("Rear wheel speed [rad/s]", "wheel_speed_rear"),
        ("rear_left_wheel_speed", "wheel_speed_rear_left"),
        ("Raddrehzahl_VL", "wheel_speed_front_left"),
    ],
)
def test_names_of_axles_and_wheels(column: str, channel: str) -> None:
    assert recognise(column).channel == channel


@pytest.mark.parametrize(
    ("without", "computed", "line"),
    [
        ((), {"from": "wheels"}, "computed.v_x.from: Input should be 'wheel_speeds' or 'gps'"),
        ((), {}, "computed.v_x.from: is missing"),
        (("gps_speed",), {"from": "gps"}, "computed.v_x: needs channels.gps_speed"),
        ((), {"from": "gps", "wheels": "rear"}, "are for 'from: wheel_speeds'"),
        (
            ("wheel_speed_rear_left", "wheel_speed_rear_right"),
            {"from": "wheel_speeds", "wheels": "rear"},
            "computed.v_x: needs rear wheel speeds in channels, such as wheel_speed_rear_left",
        ),
        *(
            (
                (),
                {"from": "wheel_speeds", "wheel_radius": radius},
                "computed.v_x.wheel_radius: give a length up to 5 m, or identify, got ",
            )
            for radius in (-1.0, 300, "big", float("nan"))
        ),
    ],
)
def test_a_wrong_entry_is_refused_in_one_line(
    without: tuple[str, ...], computed: dict, line: str
) -> None:
    with pytest.raises(UsageError) as refusal:
        checked_map("map.yaml", bus_map(*without, v_x=computed))
    assert line in str(refusal.value)
    assert str(refusal.value).startswith("map.yaml: computed.v_x")


def test_a_velocity_that_is_measured_as_well_is_refused() -> None:
    content = bus_map(v_x={"from": "gps"})
    content["channels"]["v_x"] = {"column": "v", "unit": "m/s"}
    with pytest.raises(UsageError, match=r"channels\.v_x is given as well: leave out one"):
        checked_map("m", content)


def test_a_radius_that_cannot_be_identified_is_asked_for(capsys, tmp_path: Path) -> None:
    table()[table()["t"] < 20.0].to_csv(tmp_path / "a.csv", index=False)
    for without, reason in (
        (("gps_speed",), "nothing to identify it with: no gps_speed, x and y"),
        ((), "too little driving with wheel speeds and GPS"),
    ):
        content = bus_map(*without, v_x={"from": "wheel_speeds"})
        (tmp_path / "map.yaml").write_text(yaml.safe_dump(content))
        arguments = ["import", tmp_path / "a.csv", "--map", tmp_path / "map.yaml"]
        printed = refused(capsys, [*arguments, "--out", tmp_path / "bag"], 2)
        assert f"map.yaml: computed.v_x.wheel_radius: {reason}" in printed
        assert "give the rolling radius in m" in printed


def test_a_missing_velocity_names_what_would_give_it(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    table().to_csv(path, index=False)
    recording = read_channels([path], checked_map("m", bus_map()), "m", [])
    assert any("computed: {v_x: {from: wheel_speeds}}" in line for line in recording.notes)


def test_v_y_is_estimated_from_v_x_and_yaw_rate_and_marked(tmp_path: Path) -> None:
    sideslip = {"cg_to_rear_axle": 1.4, "slip_per_acceleration": 0.004}
    velocity = {"from": "wheel_speeds", "wheels": "rear", "wheel_radius": RADIUS}
    frame = table()
    frame.to_csv(tmp_path / "a.csv", index=False)
    content = bus_map(v_x=velocity, v_y=sideslip)
    imported_as = import_recording(tmp_path / "a.csv", content, tmp_path / "bag")
    assert any("v_y is estimated" in line for line in imported_as.notes)
    recording = read_recording(tmp_path / "bag")
    assert recording.record.measured.tolist() == [True, False, True]
    at = (recording.record.stamp_ns - recording.record.stamp_ns[0]) * 1e-9
    v_y, truth = recording.record.x_ref[:, 1], np.interp(at, frame["t"], town().x[:, 1])
    known = np.isfinite(v_y)
    # The slip of this car's rear tyres is not known: the sign and the size are right.
    assert np.corrcoef(v_y[known], truth[known])[0, 1] > 0.9


@pytest.mark.parametrize(
    ("without", "computed", "text"),
    [
        (("yaw_rate",), {"v_x": {"from": "gps"}}, "computed.v_y: needs channels.yaw_rate"),
        ((), {}, "computed.v_y: needs v_x, in channels or computed"),
    ],
)
def test_an_estimate_of_v_y_needs_v_x_and_yaw_rate(
    without: tuple[str, ...], computed: dict[str, object], text: str
) -> None:
    content = bus_map(*without, **computed, v_y={"cg_to_rear_axle": 1.4})
    with pytest.raises(UsageError, match=text):
        checked_map("m", content)
