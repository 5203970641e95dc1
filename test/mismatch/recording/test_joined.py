# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Several recordings: refused where they are no further evidence, or not comparable."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.mismatch import case

from adk_ros.errors import DataError
from adk_ros.mismatch.recorded_data import usable_recordings
from adk_ros.mismatch.recording.joined import (
    concatenated,
    distinct_names,
    in_sequence,
    shifted,
)


def test_a_recording_given_twice_is_refused() -> None:
    log = case().recording
    copy = replace(log, name="copy", imu=log.imu + 0.01, start_ns=5)
    with pytest.raises(DataError, match="recording and copy have the same odometry"):
        usable_recordings([log, case().held_out, copy])


def test_recordings_with_different_channels_are_refused() -> None:
    bare = replace(case().held_out, imu_s=np.empty(0), imu=np.empty((0, 3)))
    with pytest.raises(DataError, match="recording has an IMU and heldout has none"):
        usable_recordings([case().recording, bare])


def test_an_unusable_recording_is_named() -> None:
    short = replace(case().held_out.between(0.0, 10.0), name="short")
    with pytest.raises(DataError, match=r"^short: "):
        usable_recordings([case().recording, short])


def test_recordings_follow_each_other() -> None:
    first, second = in_sequence([case().recording, case().held_out])
    assert second.odometry_s[0] >= first.duration_s
    joined = concatenated([first, second])
    assert joined.duration_s == second.duration_s
    assert joined.name == "recording and heldout"
    assert joined.odometry.shape[0] == first.odometry.shape[0] + second.odometry.shape[0]
    assert np.all(np.diff(joined.odometry_s) > 0.0)


def test_a_shift_keeps_the_absolute_time() -> None:
    log = replace(case().recording, start_ns=10**18)
    later = shifted(log, 90.0)
    assert later.duration_s == log.duration_s + 90.0
    stamps = [x.start_ns + round(1e9 * float(x.odometry_s[7])) for x in (log, later)]
    assert abs(stamps[0] - stamps[1]) < 1000


def test_equal_names_are_numbered() -> None:
    log = case().recording
    logs = [log, replace(log, name="b"), log]
    assert distinct_names(logs) == ("recording (1)", "b", "recording (2)")
