# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What loggers write: preambles, decimal commas, gaps, bad cells, several files and rates."""

from __future__ import annotations

import json
import sys
from contextlib import suppress
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import importing as source
from helpers.train import refused
from scipy.io import savemat

from adk_ros.api.importing import import_recording, propose_map
from adk_ros.bags import Bag
from adk_ros.bags.recording import RecordingOptions, read_recording
from adk_ros.calibration.from_bag import read_streams
from adk_ros.cli.main import main
from adk_ros.errors import AdkError, DataError, UsageError
from adk_ros.importing.optional_library import optional_library
from adk_ros.signals.decode import MAX_VARIANCE

CHANNELS = {
    "v_x": {"column": "v", "unit": "m/s"},
    "delta": {"column": "d", "unit": "rad"},
    "torque": {"column": "m", "unit": "N m"},
}
TIME = {"column": "t", "unit": "s"}


def rows(count: int = 200, step: float = 0.02) -> list[str]:
    return [
        f"{i * step:.3f},{10 + 0.01 * i:.3f},{0.001 * i:.4f},{2.0 * i:g}" for i in range(count)
    ]


def write(path: Path, lines: list[str], header: str = "t,v,d,m") -> Path:
    path.write_text("\n".join([header, *lines]) + "\n")
    return path


def take(path: Path | list[Path], out: Path, **more):
    content = {"time": TIME, "channels": CHANNELS} | more
    return import_recording(path, content, out, force=True)


def values_of(bag: Path, topic: str, field) -> list:
    with Bag(bag) as opened:
        return [(t, field(msg)) for _, t, msg in opened.messages([topic])]


def test_what_is_not_measured_is_marked_and_nothing_is_nan(tmp_path: Path) -> None:
    result = take(write(tmp_path / "a.csv", rows()), tmp_path / "bag")
    assert any("no v_y: written as 0" in note for note in result.notes)
    assert any("no yaw rate: written as 0" in note for note in result.notes)
    twists = values_of(tmp_path / "bag", "/odometry", lambda msg: msg.twist)
    assert len(twists) == 200
    for _, twist in twists:
        assert twist.covariance[7] == twist.covariance[35] == 1e6
        assert np.isfinite([twist.twist.linear.x, twist.twist.linear.y]).all()
    for _, msg in values_of(tmp_path / "bag", "/vehicle/command", lambda msg: msg):
        assert np.isfinite([*msg.position, *msg.effort]).all()
    record = read_recording(tmp_path / "bag").record
    assert np.isfinite(record.x).all()
    np.testing.assert_allclose(record.u[-1], [2.0 * 198, 0.198], rtol=1e-12)


def test_a_logger_file_with_preamble_units_and_decimal_comma(tmp_path: Path) -> None:
    plain = take(write(tmp_path / "a.csv", rows()), tmp_path / "plain")
    lines = ["Logger;V1.2", "Driver;M. Müller", "", "Zeit;v;d;m", "s;m/s;rad;N m"]
    lines += [row.replace(",", ";").replace(".", ",") for row in rows()]
    (tmp_path / "b.csv").write_bytes("\r\n".join(lines).encode("latin-1"))
    german = take(tmp_path / "b.csv", tmp_path / "german", time={"column": "Zeit", "unit": "s"})
    assert german.content.rows()[0]["count"] == 200
    for first, second in zip(plain.content.channels, german.content.channels, strict=True):
        np.testing.assert_array_equal(first.values, second.values)
        np.testing.assert_array_equal(first.stamp_ns, second.stamp_ns)


def test_bad_cells_and_times_are_counted_and_skipped(tmp_path: Path) -> None:
    lines = rows()
    lines[10] = "0.200,,0.010,20"  # empty
    lines[11] = "0.220,ERR,0.011,22"  # a text
    lines[12] = "0.240,inf,0.012,24"
    lines[13] = lines[14]  # a stamp given twice
    lines[20], lines[21] = lines[21], lines[20]  # out of order
    lines[30] = ",10.3,0.030,60"  # no time
    result = take(write(tmp_path / "a.csv", lines), tmp_path / "bag")
    notes = "\n".join(result.notes)
    assert "a.csv: 1 of 200 rows have no time: skipped" in notes
    assert "1 rows lie before the row above them, by at most 0.02 s: sorted by time" in notes
    assert "v_x: 1 of 199 cells are empty: skipped" in notes
    assert "v_x: 2 of 199 cells are no number: skipped" in notes
    assert "1 of 199 cells repeat the time of another row: skipped" in notes
    counts = {row["channel"]: row["count"] for row in result.content.rows()}
    assert counts == {"v_x": 195, "delta": 198, "torque": 198}
    stamps = [t for t, _ in values_of(tmp_path / "bag", "/odometry", lambda msg: msg)]
    assert stamps == sorted(set(stamps))


def test_recordings_in_a_row_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"the time jumps back by 3.98 s at row 201"):
        take(write(tmp_path / "a.csv", rows() + rows()), tmp_path / "bag")


def test_files_of_different_rates_keep_their_stamps(tmp_path: Path) -> None:
    fast = write(tmp_path / "imu.csv", [f"{i * 5},0.1,0.2,{i * 0.001:.4f}" for i in range(800)],
                 "ms,ax,ay,r")  # fmt: skip
    slow = write(tmp_path / "can.csv", rows())
    imu = {"a_x": ("ax", "m/s^2"), "a_y": ("ay", "m/s^2"), "yaw_rate": ("r", "rad/s")}
    channels = CHANNELS | {k: {"column": c, "unit": u} for k, (c, u) in imu.items()}
    files = {"imu.csv": {"time": {"column": "ms", "unit": "ms"}}}
    result = take([fast, slow], tmp_path / "bag", channels=channels, files=files)
    counts = {topic["name"]: topic["count"] for topic in result.as_dict()["topics"]}
    assert counts == {"/imu/data": 800, "/odometry": 200, "/vehicle/command": 200}
    # The yaw rate of odometry is the gyro's, at the stamps of v_x, and this is said; as a
    # measurement it would confirm all of the gyro's errors.
    assert "no yaw rate but the gyro's: marked as not measured in odometry" in result.notes
    assert any("yaw_rate (200 Hz) is interpolated at the stamps of v_x" in n for n in result.notes)
    rates = values_of(tmp_path / "bag", "/odometry", lambda msg: msg.twist.twist.angular.z)
    np.testing.assert_allclose([x for _, x in rates], 0.004 * np.arange(200), atol=1e-12)
    variances = values_of(tmp_path / "bag", "/odometry", lambda msg: msg.twist.covariance[35])
    assert all(x >= MAX_VARIANCE for _, x in variances)
    # Without an IMU it is odometry's.
    del channels["a_x"], channels["a_y"]
    take([fast, slow], tmp_path / "no_imu", channels=channels, files=files)
    variances = values_of(tmp_path / "no_imu", "/odometry", lambda msg: msg.twist.covariance[35])
    assert all(x < MAX_VARIANCE for _, x in variances)


def test_channels_of_one_message_are_joined_at_the_leading_stamps(tmp_path: Path) -> None:
    lines = [f"{i * 0.02 + 0.007:.3f},{0.5 * i:g}" for i in range(200)]
    other = write(tmp_path / "y.csv", lines, "t,vy")
    channels = CHANNELS | {"v_y": {"column": "vy", "unit": "m/s", "file": "y.csv"}}
    result = take([write(tmp_path / "a.csv", rows()), other], tmp_path / "bag", channels=channels)
    assert "odometry: v_y (50 Hz) is interpolated at the stamps of v_x (50 Hz)" in result.notes
    assert "odometry: 1 of 200 stamps lie in gaps: skipped" in result.notes
    lateral = values_of(tmp_path / "bag", "/odometry", lambda msg: msg.twist.twist.linear.y)
    np.testing.assert_allclose(lateral[0][1], 0.5 * 0.013 / 0.02, atol=1e-9)


def with_columns(more: list[str], gap: range) -> list[str]:
    """Return `rows` with further cells, which are empty in a gap."""
    empty = "," * (more[0].count(",") + 1)
    return [
        f"{row}{empty}" if i in gap else f"{row},{cells}"
        for i, (row, cells) in enumerate(zip(rows(), more, strict=True))
    ]


def test_a_gap_of_the_position_takes_no_velocity_with_it(tmp_path: Path) -> None:
    gap = range(60, 140)
    lines = with_columns([f"{0.2 * i:.1f},{0.1 * i:.1f}" for i in range(200)], gap)
    channels = CHANNELS | {name: {"column": name, "unit": "m"} for name in "xy"}
    path = write(tmp_path / "a.csv", lines, "t,v,d,m,x,y")
    result = take(path, tmp_path / "bag", channels=channels)
    for name in "xy":
        text = f"odometry: {name} is missing at 80 of 200 stamps, in gaps: marked as not measured"
        assert any(note.startswith(text) for note in result.notes)
    poses = [pose for _, pose in values_of(result.out, "/odometry", lambda msg: msg.pose)]
    marked = [[p.covariance[i] >= MAX_VARIANCE for i in (0, 7)] for p in poses]
    assert marked == [[i in gap] * 2 for i in range(200)]
    # A reader that does not look at the marks finds no jump.
    at = [p.pose.position.x for p in poses]
    np.testing.assert_allclose(at, 0.2 * np.arange(200), atol=1e-9)
    odometry = read_streams(result.out, RecordingOptions()).streams.odometry
    assert odometry is not None
    (interval,) = odometry.unknown
    assert interval == pytest.approx((1.18, 2.8))


def test_a_gap_of_the_attitude_takes_no_acceleration_with_it(tmp_path: Path) -> None:
    gap = range(20, 90)
    cells = [f"0.1,0.2,0.01,9.8,0.05,{0.001 * i:.3f}" for i in range(200)]
    lines = with_columns(cells, range(0))
    lines = [line.rsplit(",", 3)[0] + ",,," if i in gap else line for i, line in enumerate(lines)]
    units = {"a_x": "m/s^2", "a_y": "m/s^2", "yaw_rate": "rad/s", "a_z": "m/s^2"}
    units |= {"roll": "rad", "pitch": "rad"}
    channels = CHANNELS | {name: {"column": name, "unit": u} for name, u in units.items()}
    path = write(tmp_path / "a.csv", lines, f"t,v,d,m,{','.join(units)}")
    result = take(path, tmp_path / "bag", channels=channels)
    found = [msg for _, msg in values_of(result.out, "/imu/data", lambda msg: msg)]
    assert [msg.orientation_covariance[0] == -1.0 for msg in found] == [
        i in gap for i in range(200)
    ]
    vertical = [msg.linear_acceleration_covariance[8] >= MAX_VARIANCE for msg in found]
    assert vertical == [i in gap for i in range(200)]


@pytest.mark.parametrize(
    ("time", "cell", "first_s"),
    [
        ({"unit": "ms"}, lambda s: f"{s * 1e3:.0f}", 946_684_800.0),
        ({"unit": "s", "origin": "2024-05-01T10:00:00+02:00"}, lambda s: f"{s}", 1_714_550_400.0),
        ({"unit": "s", "origin": 5.0}, lambda s: f"{s}", 5.0),
        ({"unit": "s"}, lambda s: f"{1.7e9 + s:.6f}", 1.7e9),
        ({"unit": "ns"}, lambda s: f"{1_700_000_000_000_000_000 + round(s * 1e9)}", 1.7e9),
        ({"unit": "date"}, lambda s: f"2024-05-01T08:00:{s:09.6f}Z", 1_714_550_400.0),
        (
            {"unit": "date", "format": "%d.%m.%Y %H:%M:%S.%f"},
            lambda s: f"01.05.2024 08:00:{s:09.6f}",
            1_714_550_400.0,
        ),
    ],
)
def test_time_units_origins_and_dates(tmp_path: Path, time, cell, first_s: float) -> None:
    lines = [f"{cell(i * 0.02)},10.0,0.0{i},5" for i in range(100)]
    result = take(write(tmp_path / "a.csv", lines), tmp_path / "bag", time={"column": "t"} | time)
    stamps = result.content.channels[0].stamp_ns
    assert stamps[0] == round(first_s * 1e9)
    assert np.abs(np.diff(stamps) - 20_000_000).max() < 1000


def test_the_clock_of_a_file_without_a_start_gets_an_origin(tmp_path: Path) -> None:
    from asammdf import MDF, Signal

    seconds = np.arange(0.02, 4.0, 0.02)
    path = tmp_path / "a.mf4"
    with MDF(version="4.10") as mdf:
        mdf.header.start_time = datetime.fromtimestamp(0, tz=timezone.utc)
        names = {"v": 10.0 + seconds, "d": 0.01 * seconds, "m": seconds}
        mdf.append([Signal(values, seconds, name=name) for name, values in names.items()])
        mdf.save(path, overwrite=True)
    relative = take(path, tmp_path / "bag", time=None)
    assert relative.content.channels[0].stamp_ns[0] == 946_684_800_020_000_000
    origin = {"a.mf4": {"time": {"origin": "2024-05-01T08:00:00Z"}}}
    placed = take(path, tmp_path / "bag", time=None, files=origin)
    assert placed.content.channels[0].stamp_ns[0] == 1_714_550_400_020_000_000
    files = source.write_mdf(tmp_path)
    with pytest.raises(UsageError, match=r"its time is absolute: leave out time\.origin"):
        import_recording(
            files,
            source.si_map(files={"drive.mf4": origin["a.mf4"]}),
            tmp_path / "bag",
            force=True,
        )
    both = source.si_map()["channels"] | {"motor_speed": {"column": "m", "unit": "rpm"}}
    with pytest.raises(UsageError, match=r"a.mf4: its time is relative, that of .* is absolute"):
        take([*files, path], tmp_path / "bag", time=None, channels=both)


def test_rows_without_a_time_are_counted(tmp_path: Path) -> None:
    lines = [row.split(",", 1)[1] for row in rows()]
    path = write(tmp_path / "a.csv", lines, "v,d,m")
    result = take(path, tmp_path / "bag", time={"period": 20, "unit": "ms"})
    stamps = [t for t, _ in values_of(result.out, "/odometry", lambda msg: msg)]
    assert np.diff(stamps).tolist() == [20_000_000] * 199
    with pytest.raises(UsageError, match=r"time\.period: needs a unit, and no column"):
        take(path, tmp_path / "bag", time={"period": 20, "column": "v"})


def test_a_part_of_the_rows_is_one_of_several_drives(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", [*rows(), *rows(100)])
    files = {"a.csv": {"rows": [201, 300]}}
    result = take(path, tmp_path / "bag", files=files)
    assert result.content.duration_s == pytest.approx(1.98)
    with pytest.raises(UsageError, match=r"files\.a\.csv\.rows: give the first and the last row"):
        take(path, tmp_path / "bag", files={"a.csv": {"rows": [3, 2]}})


def test_a_wide_matrix_has_its_channels_in_rows(tmp_path: Path) -> None:
    t = 0.02 * np.arange(200.0)
    savemat(tmp_path / "a.mat", {"s": np.vstack([10.0 + t, 0.01 * t, t])})
    channels = {
        "v_x": {"column": "s[0]", "unit": "m/s"},
        "delta": {"column": "s[1]", "unit": "rad"},
    }
    time = {"period": 0.02}
    result = take(tmp_path / "a.mat", tmp_path / "bag", channels=channels, time=time)
    speeds = values_of(result.out, "/odometry", lambda msg: msg.twist.twist.linear.x)
    assert [v for _, v in speeds] == pytest.approx((10.0 + t).tolist())


@pytest.mark.parametrize("name", ["torque", "delta"])
def test_a_command_has_what_is_there(tmp_path: Path, name: str) -> None:
    missing = {"torque": "delta", "delta": "torque"}[name]
    channels = {key: entry for key, entry in CHANNELS.items() if key != missing}
    result = take(write(tmp_path / "a.csv", rows()), tmp_path / "bag", channels=channels)
    torque = values_of(result.out, "/vehicle/command", lambda msg: msg.effort[0])
    delta = values_of(result.out, "/vehicle/command", lambda msg: msg.position[1])
    present, absent = (torque, delta) if name == "torque" else (delta, torque)
    assert len({v for _, v in present}) == 200
    assert not any(v for _, v in absent)
    assert result.not_imported == {}
    assert any(f"no {missing}: written as 0" in note for note in result.notes)


def test_other_channels_get_topics_of_their_own(tmp_path: Path) -> None:
    header = "t,v,d,m,fl,p,gas,gear,gs,course,lat,lon,n"
    lines = [f"{row},{36.0},{1.5},{50},{3},{36},{90},{48.1},{11.5},{3000}" for row in rows()]
    extra = {
        "wheel_speed_front_left": {"column": "fl", "unit": "km/h", "wheel_radius": 0.25},
        "brake_pressure": {"column": "p", "unit": "bar"},
        "throttle": {"column": "gas", "unit": "%"},
        "gear": {"column": "gear", "unit": "1"},
        "gps_speed": {"column": "gs", "unit": "km/h"},
        "gps_course": {"column": "course", "unit": "deg"},
        "latitude": {"column": "lat", "unit": "deg"},
        "longitude": {"column": "lon", "unit": "deg"},
        "motor_speed": {"column": "n", "unit": "rpm"},
        "a_x": {"column": "v", "unit": "m/s^2"},
    }
    path = write(tmp_path / "a.csv", lines, header)
    result = take(path, tmp_path / "bag", channels=CHANNELS | extra)
    assert result.not_imported == {"a_x": "an IMU message also needs a_y, yaw_rate"}
    first: dict[str, Any] = {}
    with Bag(tmp_path / "bag") as bag:
        for topic, _, msg in bag.messages():
            first.setdefault(topic, msg)
    wheel = first["/vehicle/wheel_speed/front_left"].twist.angular.y
    assert wheel == pytest.approx(10.0 / 0.25)
    assert first["/vehicle/brake_pressure"].fluid_pressure == pytest.approx(1.5e5)
    assert first["/vehicle/throttle"].data == pytest.approx(0.5)
    assert first["/vehicle/gear"].data == 3.0
    assert first["/vehicle/motor_speed"].twist.angular.y == pytest.approx(100 * np.pi)
    east = first["/gps/velocity"].twist.linear
    assert (east.x, east.y) == pytest.approx((10.0, 0.0), abs=1e-9)
    assert first["/gps/fix"].latitude == 48.1
    # The command of training and replay is still the only JointState.
    assert read_recording(tmp_path / "bag").topics.command == "/vehicle/command"


ERRORS = [
    ("a.csv", "", {}, 3, "a.csv: is empty"),
    ("a.csv", "t,v,d,m\n", {}, 3, "has no row of numbers"),
    ("a.csv", "0,1,2,3\n1,2,3,4\n", {}, 3, "has no row of column names"),
    ("a.csv", "t,v,d\n0.0,1,2\n0.1,1,2\n", {}, 2, "channels.torque: no column 'm' in a.csv"),
    ("a.csv", "x,v,d,m\n0.0,1,2,3\n0.1,1,2,3\n", {}, 2, "has no column 't' for the time"),
    ("a.csv", "t,v,d,m\n0.0,1,2,a\n0.1,1,2,b\n", {}, 3, "column 'm' has no number"),
    ("a.mf4", "no MDF", {}, 3, "a.mf4: cannot be read as MDF"),
    ("a.mat", "no MAT file at all" * 20, {}, 3, "cannot be read as a MAT file"),
    ("a.parquet", "no Parquet", {}, 3, "cannot be read as Parquet"),
    ("a.blf", "no BLF", {"--dbc": "c.dbc"}, 3, "cannot be read as a CAN log"),
    ("a.blf", "no BLF", {}, 2, "a CAN log needs its messages: give --dbc FILE"),
    ("a.blf", "x", {"--dbc": "a.blf"}, 2, "a.blf: is no DBC file"),
    ("a.mcap", "x", {}, 3, "is neither MCAP, SQLite nor a ROS 1 bag"),
    ("a.xlsx", "x", {}, 2, "format '.xlsx' is not known: give CSV, Parquet"),
]


@pytest.mark.parametrize(("name", "content", "more", "code", "line"), ERRORS)
def test_unusable_files_are_refused_in_one_line(
    capsys, tmp_path: Path, name: str, content: str, more: dict, code: int, line: str
) -> None:
    (tmp_path / "map.yaml").write_text(json.dumps({"time": TIME, "channels": CHANNELS}))
    (tmp_path / "c.dbc").write_text('VERSION ""\n')
    (tmp_path / name).write_text(content)
    arguments = ["import", tmp_path / name, "--map", tmp_path / "map.yaml"]
    for option, value in more.items():
        arguments += [option, tmp_path / value]
    assert line in refused(capsys, [*arguments, "--out", tmp_path / "bag"], code)
    assert not (tmp_path / "bag").exists()


def test_damaged_files_are_refused_or_read_in_part(capfd, tmp_path: Path) -> None:
    """Cut and altered files of each binary format; no library prints or raises by itself."""
    rng = np.random.default_rng(0)
    files = [
        *source.write_mdf(tmp_path),
        *source.write_mat(tmp_path),
        *source.write_parquet_files(tmp_path)[:1],
        *source.write_can(tmp_path, ".blf"),
    ]
    for path in files:
        whole = path.read_bytes()
        for length in (100, len(whole) // 2, len(whole)):
            content = bytearray(whole[:length])
            for place in rng.integers(min(length, 4000), size=5):
                content[place] = rng.integers(256)
            path.write_bytes(bytes(content))
            with suppress(AdkError):
                propose_map(path, dbc=[tmp_path / "drive.dbc"])
    printed = capfd.readouterr()
    assert (printed.out, printed.err) == ("", "")


def test_mat_of_version_7_3_is_named(tmp_path: Path) -> None:
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124, b" ") + b"\x00\x02IM"
    (tmp_path / "a.mat").write_bytes(head + bytes(400))
    with pytest.raises(DataError, match=r"version 7.3 \(HDF5\).*save\(file, '-v7'\)"):
        take(tmp_path / "a.mat", tmp_path / "bag")
    savemat(tmp_path / "b.mat", {"text": "only"})
    with pytest.raises(DataError, match="has no vector of numbers"):
        take(tmp_path / "b.mat", tmp_path / "bag")


def test_wrong_arguments_are_refused(capsys, tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", rows())
    assert "give --map YAML, or write a first one" in refused(capsys, ["import", path], 2)
    (tmp_path / "map.yaml").write_text(json.dumps({"time": TIME, "channels": CHANNELS}))
    arguments = ["import", path, "--map", tmp_path / "map.yaml"]
    assert "give --out BAG" in refused(capsys, arguments, 2)
    assert "leave out --map" in refused(capsys, [*arguments, "--propose"], 2)
    assert "no such file" in refused(capsys, [arguments[0], tmp_path / "b", *arguments[2:],
                                              "--out", tmp_path / "o"], 2)  # fmt: skip
    assert "no such map file" in refused(
        capsys, ["import", path, "--map", tmp_path / "no.yaml", "--out", tmp_path / "o"], 2
    )
    assert main([str(x) for x in [*arguments, "--out", tmp_path / "o"]]) == 0
    printed = capsys.readouterr()
    assert "v_x" in printed.out
    assert f"next: adk info {tmp_path / 'o'}" in printed.err
    line = refused(capsys, [*arguments, "--out", tmp_path / "o"], 2)
    assert "add --force to replace it" in line
    forced = [*arguments, "--out", tmp_path / "o", "--force", "--json"]
    assert main([str(x) for x in forced]) == 0
    printed_json = json.loads(capsys.readouterr().out)
    assert printed_json["messages"] == 400
    assert {row["channel"]: row["count"] for row in printed_json["channels"]} == dict.fromkeys(
        CHANNELS, 200
    )


def test_a_missing_library_is_named_with_the_command(monkeypatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "asammdf", None)
    (tmp_path / "a.mf4").write_bytes(b"x")
    with pytest.raises(UsageError, match=r"MDF needs asammdf.*pip install 'adk_ros\[import\]'"):
        take(tmp_path / "a.mf4", tmp_path / "bag")
    monkeypatch.setitem(sys.modules, "can", None)
    with pytest.raises(UsageError, match="CAN logs needs python-can, which is not installed"):
        optional_library("can", "CAN logs", "python-can")


def test_every_so_many_rows_are_read_at_their_times(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", rows(100))
    stamps = {}
    for name, time in (("column", TIME), ("period", {"period": 20, "unit": "ms"})):
        files = {"a.csv": {"rows": [3, 90], "every": 4}}
        result = take(path, tmp_path / name, time=time, files=files)
        counts = {row["channel"]: row["count"] for row in result.content.rows()}
        assert counts["v_x"] == 22
        found = values_of(tmp_path / name, "/odometry", lambda msg: msg.twist.twist.linear.x)
        np.testing.assert_allclose(
            [v for _, v in found], 10.0 + 0.01 * np.arange(2, 90, 4), atol=1e-9
        )
        stamps[name] = np.diff([t for t, _ in found])
    assert (stamps["column"] == 80_000_000).all()
    assert (stamps["period"] == 80_000_000).all()
    with pytest.raises(UsageError, match=r"files\.a\.csv\.every"):
        take(path, tmp_path / "bag", files={"a.csv": {"every": 0}})


def test_a_curvature_times_v_x_is_odometrys_yaw_rate(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", [f"{row},{-0.002 * i:g}" for i, row in enumerate(rows())],
                 "t,v,d,m,k")  # fmt: skip
    channels = CHANNELS | {"curvature": {"column": "k", "unit": "1/m", "sign": -1}}
    computed = {"yaw_rate": {"from": "curvature"}}
    result = take(path, tmp_path / "bag", channels=channels, computed=computed)
    assert not any("no yaw rate" in note for note in result.notes)
    assert result.content.unused == ()
    found = values_of(tmp_path / "bag", "/odometry", lambda msg: msg.twist.twist.angular.z)
    i = np.arange(200)
    np.testing.assert_allclose([r for _, r in found], 0.002 * i * (10.0 + 0.01 * i), rtol=1e-9)
    with Bag(tmp_path / "bag") as opened:
        assert not any("curvature" in topic.name for topic in opened.topics)
    # In km^-1 it is a thousandth.
    channels["curvature"] = {"column": "k", "unit": "1/km", "sign": -1}
    take(path, tmp_path / "bag", channels=channels, computed=computed)
    found = values_of(tmp_path / "bag", "/odometry", lambda msg: msg.twist.twist.angular.z)
    np.testing.assert_allclose([r for _, r in found], 2e-6 * i * (10.0 + 0.01 * i), rtol=1e-9)


@pytest.mark.parametrize(
    ("more", "computed", "said"),
    [
        (
            {},
            {"yaw_rate": {"from": "curvature"}},
            r"computed\.yaw_rate: needs channels\.curvature",
        ),
        (
            {"curvature": {"column": "m", "unit": "1/m"}, "v_x": None},
            {"yaw_rate": {"from": "curvature"}},
            r"computed\.yaw_rate: needs v_x, in channels or computed",
        ),
        (
            {"curvature": {"column": "m", "unit": "1/m"}},
            {},
            r"computed\.yaw_rate: channels\.curvature needs 'yaw_rate: \{from: curvature\}'",
        ),
        (
            {
                "curvature": {"column": "m", "unit": "1/m"},
                "odometry_yaw_rate": {"column": "d", "unit": "rad/s"},
            },
            {"yaw_rate": {"from": "curvature"}},
            r"channels\.odometry_yaw_rate is given as well",
        ),
        ({"curvature": {"column": "m", "unit": "m"}}, {"yaw_rate": {"from": "curvature"}}, "unit"),
    ],
)
def test_a_curvature_needs_its_entry(tmp_path: Path, more: Any, computed: Any, said: str) -> None:
    path = write(tmp_path / "a.csv", rows())
    channels = {name: entry for name, entry in (CHANNELS | more).items() if entry is not None}
    with pytest.raises(UsageError, match=said):
        take(path, tmp_path / "bag", channels=channels, computed=computed)


def test_a_sideslip_is_estimated_from_a_computed_yaw_rate(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", [f"{row},0.01" for row in rows()], "t,v,d,m,k")
    channels = CHANNELS | {"curvature": {"column": "k", "unit": "1/m"}}
    computed = {"yaw_rate": {"from": "curvature"}, "v_y": {"cg_to_rear_axle": 1.4}}
    take(path, tmp_path / "bag", channels=channels, computed=computed)
    found = values_of(tmp_path / "bag", "/odometry", lambda msg: msg.twist.twist)
    for _, twist in found:
        assert twist.linear.y == pytest.approx(1.4 * 0.01 * twist.linear.x)
