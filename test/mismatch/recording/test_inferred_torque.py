# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The torque that a motion takes is the one that caused it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from helpers.mismatch_drive import driven, simulated_car

from adk_ros.mismatch.recording.inferred_torque import with_inferred_torque


def test_torque_is_that_which_moved_the_car() -> None:
    log = driven()
    found = with_inferred_torque(replace(log, command=log.command * [0.0, 1.0]), simulated_car())
    assert found.torque_is_inferred
    np.testing.assert_array_equal(found.command[:, 1], log.command[:, 1])
    inside = (log.command_s > 1.0) & (log.command_s < log.duration_s - 1.0)
    true, inferred = log.command[inside, 0], found.command[inside, 0]
    # Cornering drag is left out, and the speed is noisy.
    assert np.corrcoef(true, inferred)[0, 1] > 0.98
    assert abs(np.mean(inferred - true)) < 0.1 * np.std(true)
