# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A satellite receiver on a simulated drive, as streams and in bags."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from adk_ros.bags import Bag, message
from adk_ros.bags.auxiliary_topics import FIX, GPS_VELOCITY, TWIST
from adk_ros.calibration.streams import Stream, Streams
from adk_ros.plant.scenario.scenario_file import load_scenario
from adk_ros.plant.scenario.sensor_simulation import SimulatedDrive
from adk_ros.plant.scenario.simulate import simulate
from helpers.bags import START_NS
from helpers.calibration import driven, write_messages, write_streams


@lru_cache(maxsize=4)
def _truth(scenario: str, seed: int, seconds: float) -> SimulatedDrive:
    return simulate(load_scenario(scenario), seed, seconds)


def with_course(
    scenario: str = "town",
    seed: int = 2,
    seconds: float = 200.0,
    *,
    delay_s: float = 0.1,
    rate_hz: float = 10.0,
    noise: float = 0.05,
    ahead: float = 0.8,
    turned: float = 0.0,
) -> Streams:
    """
    Return a drive with a receiver of east and north velocity.

    :param noise: of either, m/s. :param ahead: of the antenna before the reference point, m.
    :param turned: angle, rad, by which the receiver's axes are turned from those of the pose.
    """
    drive, streams = _truth(scenario, seed, seconds), driven(scenario, seed, seconds)
    start = min(int(stream.stamp_ns[0]) for stream in drive.streams.values())
    t = (drive.stamp_ns - start) * 1e-9
    v_x, v_y, rate = drive.x.T
    heading = np.unwrap(drive.pose[:, 2]) + turned
    sideways = v_y + rate * ahead
    east = v_x * np.cos(heading) - sideways * np.sin(heading)
    north = v_x * np.sin(heading) + sideways * np.cos(heading)
    at = np.arange(1.0, t[-1] - 1.0, 1.0 / rate_hz)
    rng = np.random.default_rng(5)
    east, north = (
        np.interp(at - delay_s, t, x) + noise * rng.standard_normal(at.size) for x in (east, north)
    )
    columns = {"gps_speed": np.hypot(east, north), "gps_course": np.arctan2(east, north)}
    return replace(streams, gps_speed=Stream("the GPS receiver", at, columns))


NO_FIX = -1


def write_with_receiver(streams: Streams, path: Path, fix_topic: str = "/gps/fix") -> Path:
    """
    Write streams as a bag with the height in odometry, fixes and velocities; return its path.

    Of every ten fixes, one is none (with an altitude of zero) and one has no altitude.
    """
    whole = write_streams(streams, path.parent / f"{path.name}_whole")
    events: list[tuple[int, str, Any]] = []
    height, z = streams.heights.get("gps"), streams.heights.get("odometry")
    with Bag(whole) as bag:
        for topic, log_ns, msg in bag.messages([each.name for each in bag.topics]):
            if topic == "/odometry" and z is not None:
                at = 1e-9 * (log_ns - START_NS)
                msg.pose.pose.position.z = float(np.interp(at, z.at_s, z["height"]))
            events.append((log_ns, topic, msg))
    for i, stamp_ns in enumerate(_stamps(height)):
        assert height is not None
        altitude = [0.0, math.nan, *[float(height["height"][i])] * 8][i % 10]
        status = {"status": NO_FIX if i % 10 == 0 else 0}
        header = {"stamp": stamp_ns, "frame_id": "gps"}
        fix = message(FIX, header=header, altitude=altitude, latitude=48.0, status=status)
        events.append((stamp_ns, fix_topic, fix))
    gps = streams.gps_speed
    for i, stamp_ns in enumerate(_stamps(gps)):
        assert gps is not None
        speed, course = float(gps["gps_speed"][i]), float(gps["gps_course"][i])
        linear = {"x": speed * math.sin(course), "y": speed * math.cos(course)}
        header = {"stamp": stamp_ns, "frame_id": "enu"}
        msg = message(TWIST, header=header, twist={"linear": linear})
        events.append((stamp_ns, GPS_VELOCITY, msg))
    return write_messages(path, events)


def _stamps(stream: Stream | None) -> list[int]:
    return [] if stream is None else [START_NS + round(at * 1e9) for at in stream.at_s.tolist()]
