# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a sensor log allows, as `adk info` says of its bag."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from helpers.mismatch_drive import driven

from adk_ros.calibration.scope import Possible, common_scope
from adk_ros.mismatch.inference.observability import ObservableEffects
from adk_ros.mismatch.recording.recorded_scope import recorded_scope


def test_a_missing_channel_reduces_what_depends_on_it() -> None:
    log = driven()
    rows = {row.name: row for row in recorded_scope(log)}
    assert rows["judge v_y"].possible is Possible.YES
    assert rows["grade"].possible is Possible.YES
    without = replace(log, imu_s=np.empty(0), imu=np.empty((0, 3)))
    rows = {row.name: row for row in recorded_scope(without)}
    assert rows["grade"].possible is Possible.NO
    assert rows["judge v_x"].possible is Possible.REDUCED
    assert rows["judge v_x"].needs == "an IMU"


def test_jointly_the_least_of_each_counts() -> None:
    log = driven()
    still = replace(log, odometry=log.odometry * [1.0, 0.0, 1.0])
    rows = {x.name: x for x in common_scope([recorded_scope(log), recorded_scope(still)])}
    assert rows["predict v_y"].possible is Possible.NO


def test_a_command_that_is_no_torque_does_not_judge_v_x() -> None:
    rows = ObservableEffects(torque=False).scope(recorded_scope(driven()))
    row = next(x for x in rows if x.name == "judge v_x")
    assert (row.possible, row.needs) == (Possible.NO, "a torque command")
    assert all(x.possible is not Possible.NO for x in rows if x.name != "judge v_x")
