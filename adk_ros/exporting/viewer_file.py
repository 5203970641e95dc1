# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Write channels or signals as an MCAP file, and the layouts that show them."""

from __future__ import annotations

from collections.abc import Sequence
from heapq import merge
from pathlib import Path

import numpy as np

from adk_ros.bags import BagWriter, message
from adk_ros.bags.auxiliary_topics import FIX, NUMBER, PRESSURE, TWIST
from adk_ros.exporting.column_table import ColumnTable
from adk_ros.exporting.report_signals import ROLES
from adk_ros.exporting.viewer_layouts import Curve, Plot, foxglove_layout, plotjuggler_layout
from adk_ros.importing.topics import Topic
from adk_ros.mismatch.inference.signal_fit import SIGNAL_UNITS, SIGNALS

_TITLES = {
    "v_x": "longitudinal velocity", "v_y": "lateral velocity", "yaw_rate": "yaw rate",
    "a_x": "longitudinal acceleration", "a_y": "lateral acceleration",
}  # fmt: skip


def layout_files(out: Path) -> tuple[Path, Path]:
    """Return the paths of the layouts of Foxglove and PlotJuggler for an MCAP bag."""
    return (
        out.with_name(f"{out.name}.foxglove.json"),
        out.with_name(f"{out.name}.plotjuggler.xml"),
    )


def write_layouts(plots: Sequence[Plot], out: Path) -> None:
    """Write the layouts of a bag next to its folder."""
    foxglove, plotjuggler = layout_files(out)
    foxglove.write_text(foxglove_layout(plots), encoding="utf-8")
    name = f"{out.name}/{out.name}.mcap"
    plotjuggler.write_text(plotjuggler_layout(plots, name), encoding="utf-8")


def write_signals(tables: Sequence[ColumnTable], out: Path) -> list[Plot]:
    """
    Write the signals of reports as numbers, a topic `/signal/role` each; return their plots.

    A number that is not known is not written. The log time is the time of the signal.

    :raises UsageError: `out` exists or cannot be written.
    """
    number = message(NUMBER)
    with BagWriter(out, compression="zstd") as writer:
        written: set[str] = set()
        streams = []
        for table in tables:
            for signal in SIGNALS:
                for role in ROLES:
                    column = table.columns[f"{signal}_{role}"]
                    known = np.isfinite(column)
                    topic = f"/{signal}/{role}"
                    if known.any():
                        writer.add_topic(topic, NUMBER)
                        written.add(topic)
                        rows = zip(
                            table.stamp_ns[known].tolist(), column[known].tolist(), strict=True
                        )
                        streams.append([(stamp, topic, value) for stamp, value in rows])
        for stamp_ns, topic, value in merge(*streams, key=lambda row: row[0]):
            number.data = value
            writer.write(topic, number, stamp_ns)
    plots = []
    for signal, unit in zip(SIGNALS, SIGNAL_UNITS, strict=True):
        for title, roles in (("", ROLES[:3]), ("residual of ", ROLES[3:])):
            curves = tuple(
                Curve(f"/{signal}/{role}", "data")
                for role in roles
                if f"/{signal}/{role}" in written
            )
            if curves:
                plots.append(Plot(f"{title}{_TITLES[signal]} in {unit}", curves))
    # First what people compare, then what is left.
    return sorted(plots, key=lambda plot: plot.title.startswith("residual"))


def plots_of_topics(topics: Sequence[Topic]) -> list[Plot]:
    """Return plots of the channels that `importing.topics` writes."""
    by_name = {topic.name: topic for topic in topics}
    plots = [
        Plot(title, tuple(Curve(*curve) for curve in curves if curve[0] in by_name))
        for title, curves in (
            ("v_x in m/s", [("/odometry", "twist.twist.linear.x"), ("/gps/speed", "data")]),
            ("v_y in m/s", [("/odometry", "twist.twist.linear.y")]),
            (
                "yaw rate in rad/s",
                [("/imu/data", "angular_velocity.z"), ("/odometry", "twist.twist.angular.z")],
            ),
            (
                "acceleration in m/s^2",
                [("/imu/data", "linear_acceleration.x"), ("/imu/data", "linear_acceleration.y")],
            ),
            ("torque in N m", [("/vehicle/command", "effort[0]", "drive")]),
            ("road-wheel angle in rad", [("/vehicle/command", "position[1]", "steer")]),
        )
    ]
    for topic in topics:
        if not topic.name.startswith(("/vehicle/", "/gps/")) or topic.name == "/vehicle/command":
            continue
        fields = {TWIST: "twist.angular.y", PRESSURE: "fluid_pressure", NUMBER: "data"}
        field = "twist.linear.x" if topic.name == "/gps/velocity" else fields.get(topic.msgtype)
        if field is not None and topic.msgtype != FIX and topic.name != "/gps/speed":
            plots.append(Plot(topic.name.strip("/"), (Curve(topic.name, field),)))
    return [plot for plot in plots if plot.curves]
