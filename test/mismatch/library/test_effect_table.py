# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The generated table of all effects."""

from __future__ import annotations

from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.effect_table import effect_table


def test_the_table_has_one_row_per_effect_with_all_columns() -> None:
    header, ruler, *rows = effect_table().splitlines()
    columns = header.count("|")
    assert set(ruler) <= set("|- ")
    assert len(rows) == len(EFFECTS)
    for row, effect in zip(rows, EFFECTS.values(), strict=True):
        assert row.replace("\\|", "").count("|") == columns
        assert row.startswith(f"| `{effect.name}` |")
        assert effect.excitation in row
        assert effect.manoeuvre in row
        assert all(f"`{parameter.name}`" in row for parameter in effect.parameters)
        assert all(f"`{name}`" in row for name in effect.confusables)


def test_a_calibration_names_its_parameters() -> None:
    rows = {row.split("`")[1]: row for row in effect_table().splitlines()[2:]}
    assert "| physics |" in rows["aero_drag"]
    assert "| calibration: `accelerometer_bias`, `gyro_bias` |" in rows["imu_bias"]
    assert "| calibration or physics: `steering_ratio` |" in rows["steering_ratio"]
    assert "| calibration: no parameter |" in rows["odometry_filter"]


def test_units_are_typeset() -> None:
    rows = {row.split("`")[1]: row for row in effect_table().splitlines()[2:]}
    assert "`cda` (m²)" in rows["aero_drag"]
    assert "`offset` (N·m)" in rows["torque_offset"]
    assert "`inertia` (kg·m²)" in rows["rotating_inertia"]
    assert "`rad_per_mps2` (rad·s²/m)" in rows["compliance_steer"]
    assert "`scale`," not in rows["steering_ratio"]
    assert "| `scale` |" in rows["steering_ratio"]
