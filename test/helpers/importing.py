# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One simulated drive, written in every format that `adk import` reads."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.io import savemat

from adk_ros.bags import BagWriter, message
from adk_ros.importing.parquet_file import write_parquet
from adk_ros.signals.channels import Source
from helpers.train import drive

NAMES = {
    Source.IMU: ("a_x", "a_y", "yaw_rate"),
    Source.ODOMETRY: ("v_x", "v_y", "odometry_yaw_rate", "x", "y", "heading"),
    Source.COMMAND: ("torque", "delta"),
}
UNITS = {
    "a_x": "m/s^2", "a_y": "m/s^2", "yaw_rate": "rad/s", "v_x": "m/s", "v_y": "m/s",
    "odometry_yaw_rate": "rad/s", "x": "m", "y": "m", "heading": "rad", "torque": "N m",
    "delta": "rad",
}  # fmt: skip
SECONDS = 12.0


@lru_cache
def frames() -> dict[str, pd.DataFrame]:
    """Return a table per stream: stamps in ns, and the values in SI units."""
    out = {}
    for source, stream in drive("town", SECONDS).streams.items():
        frame = pd.DataFrame(stream.values, columns=list(NAMES[source]))
        frame.insert(0, "stamp_ns", stream.stamp_ns)
        out[source.name.lower()] = frame
    return out


def si_map(**more):
    """Return a map of columns that are named as their channels, in SI units."""
    channels = {name: {"column": name, "unit": unit} for name, unit in UNITS.items()}
    return {"channels": channels} | more


STAMPS = {"column": "stamp_ns", "unit": "ns"}


def write_csv(folder: Path) -> list[Path]:
    paths = [folder / f"{name}.csv" for name in frames()]
    for path, frame in zip(paths, frames().values(), strict=True):
        frame.to_csv(path, index=False)
    return paths


def write_parquet_files(folder: Path) -> list[Path]:
    paths = [folder / f"{name}.parquet" for name in frames()]
    for path, frame in zip(paths, frames().values(), strict=True):
        write_parquet(frame, path)
    return paths


def write_mat(folder: Path) -> list[Path]:
    path = folder / "drive.mat"
    content = {
        name: {column: frame[column].to_numpy() for column in frame.columns}
        for name, frame in frames().items()
    }
    savemat(path, content)
    return [path]


def start_ns() -> int:
    """Return a whole second before the first stamp: what loggers store as the start."""
    first = min(int(frame["stamp_ns"].iloc[0]) for frame in frames().values())
    return first // 10**9 * 10**9


def write_mdf(folder: Path) -> list[Path]:
    from datetime import datetime, timezone

    from asammdf import MDF, Signal

    path = folder / "drive.mf4"
    with MDF(version="4.10") as mdf:
        mdf.header.start_time = datetime.fromtimestamp(start_ns() // 10**9, tz=timezone.utc)
        for name, frame in frames().items():
            seconds = (frame["stamp_ns"].to_numpy() - start_ns()) * 1e-9
            signals = [
                Signal(frame[column].to_numpy(), seconds, name=column, unit=UNITS[column])
                for column in frame.columns[1:]
            ]
            mdf.append(signals, acq_name=name)
        mdf.save(path, overwrite=True)
    return [path]


def write_other_bag(folder: Path) -> list[Path]:
    """Write a bag without Imu, Odometry and JointState messages, with the same values."""
    path = folder / "other"
    topics = {
        "imu": ("/accel", "geometry_msgs/msg/AccelStamped"),
        "odometry": ("/state", "sensor_msgs/msg/MultiDOFJointState"),
        "command": ("/driver", "geometry_msgs/msg/WrenchStamped"),
    }
    with BagWriter(path) as writer:
        rows = []
        for name, frame in frames().items():
            topic, kind = topics[name]
            writer.add_topic(topic, kind)
            for stamp, *values in frame.itertuples(index=False):
                rows.append((int(stamp), topic, kind, [float(value) for value in values]))
        for stamp, topic, kind, v in sorted(rows, key=lambda row: row[0]):
            header = {"stamp": stamp, "frame_id": "car"}
            if topic == "/accel":
                accel = {"linear": {"x": v[0], "y": v[1]}, "angular": {"z": v[2]}}
                msg = message(kind, header=header, accel=accel)
            elif topic == "/state":
                twist = {"linear": {"x": v[0], "y": v[1], "z": v[5]}, "angular": {"z": v[2]}}
                pose = {"translation": {"x": v[3], "y": v[4]}}
                msg = message(
                    kind, header=header, joint_names=["b"], transforms=[pose], twist=[twist]
                )
            else:
                wrench = {"torque": {"y": v[0]}, "force": {"z": v[1]}}
                msg = message(kind, header=header, wrench=wrench)
            writer.write(topic, msg, stamp)
    return [path]


OTHER_FIELDS = {
    "a_x": "/accel.accel.linear.x", "a_y": "/accel.accel.linear.y",
    "yaw_rate": "/accel.accel.angular.z", "v_x": "/state.twist[0].linear.x",
    "v_y": "/state.twist[0].linear.y", "odometry_yaw_rate": "/state.twist[0].angular.z",
    "x": "/state.transforms[0].translation.x", "y": "/state.transforms[0].translation.y",
    "heading": "/state.twist[0].linear.z", "torque": "/driver.wrench.torque.y",
    "delta": "/driver.wrench.force.z",
}  # fmt: skip

# Signal: first bit, bits, factor, offset, unit; each message has 8 bytes.
_SIGNALS = {
    "imu": {
        "a_x": (0, 16, 0.001, 0.0, "g"), "a_y": (16, 16, 0.001, 0.0, "g"),
        "yaw_rate": (32, 16, 0.01, 0.0, "deg/s"),
    },
    "odometry": {
        "v_x": (0, 16, 0.01, 0.0, "km/h"), "v_y": (16, 16, 0.01, 0.0, "km/h"),
        "odometry_yaw_rate": (32, 16, 0.01, 0.0, "deg/s"),
    },
    "pose": {
        "x": (0, 20, 0.01, 0.0, "m"), "y": (20, 20, 0.01, 0.0, "m"),
        "heading": (40, 16, 0.01, 0.0, "deg"),
    },
    "command": {"torque": (0, 16, 1.0, 0.0, "Nm"), "delta": (16, 16, 0.002, 0.0, "deg")},
}  # fmt: skip
TO_SI = {"g": 9.80665, "deg/s": np.pi / 180, "deg": np.pi / 180, "km/h": 1 / 3.6, "m": 1, "Nm": 1}


def can_unit(channel: str) -> tuple[str, float]:
    """Return unit and resolution of a channel on the bus, the latter in SI units."""
    for signals in _SIGNALS.values():
        if channel in signals:
            unit = signals[channel][4]
            return unit, signals[channel][2] * TO_SI[unit]
    raise KeyError(channel)


def dbc_text() -> str:
    lines = ['VERSION ""', "NS_ :", "BS_:", "BU_: ECU"]
    for number, (name, signals) in enumerate(_SIGNALS.items()):
        lines.append(f"BO_ {256 + number} {name}: 8 ECU")
        lines += [
            f' SG_ {key} : {bit}|{bits}@1- ({factor},{offset}) [0|0] "{unit}" ECU'
            for key, (bit, bits, factor, offset, unit) in signals.items()
        ]
        lines.append("")
    return "\n".join(lines)


def write_can(folder: Path, suffix: str) -> list[Path]:
    """Write a CAN log of the drive, and `drive.dbc` in the same folder."""
    import can
    import cantools

    (folder / "drive.dbc").write_text(dbc_text())
    database = cantools.database.Database()
    database.add_dbc_string(dbc_text())
    path = folder / f"drive{suffix}"
    kinds = {".blf": can.BLFWriter, ".asc": can.ASCWriter, ".log": can.CanutilsLogWriter}
    frames_sent = []
    for number, (name, signals) in enumerate(_SIGNALS.items()):
        frame = frames()["odometry" if name == "pose" else name]
        message_of = database.get_message_by_name(name)
        for row in frame.to_dict("records"):
            values = {key: row[key] / TO_SI[spec[4]] for key, spec in signals.items()}
            data = message_of.encode(values, strict=False)
            frames_sent.append((row["stamp_ns"], 256 + number, data))
    with kinds[suffix](str(path)) as writer:
        for stamp_ns, identifier, data in sorted(frames_sent, key=lambda item: item[0]):
            writer.on_message_received(
                can.Message(
                    timestamp=(stamp_ns - start_ns()) * 1e-9 + start_ns() // 10**9,
                    arbitration_id=identifier,
                    data=data,
                    is_extended_id=False,
                    channel=0,
                )
            )
    return [path]


def can_map():
    """Return the map of the CAN log: the units of the bus."""
    channels = {name: {"column": name, "unit": can_unit(name)[0]} for name in UNITS}
    return {"channels": channels}
