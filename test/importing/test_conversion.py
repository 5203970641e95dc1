# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Units, sign, offset and ratio; what a map may say, and one line on what it may not."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.train import refused

from adk_ros.errors import UsageError
from adk_ros.importing.map_loading import checked_map
from adk_ros.importing.source_channels import converted
from adk_ros.importing.units import factor_to_si, is_unit_of


@pytest.mark.parametrize(
    ("unit", "si", "factor"),
    [
        ("km/h", "m/s", 1 / 3.6),
        ("mph", "m/s", 0.44704),
        ("g", "m/s^2", 9.80665),
        ("m/s²", "m/s^2", 1.0),
        ("deg", "rad", np.pi / 180),
        ("Grad", "rad", np.pi / 180),
        ("°/s", "rad/s", np.pi / 180),
        ("rpm", "rad/s", np.pi / 30),
        ("U/min", "rad/s", np.pi / 30),
        ("bar", "Pa", 1e5),
        ("Nm", "N m", 1.0),
        ("kN m", "N m", 1e3),
        ("%", "1", 0.01),
        ("%", "N m", 0.01),
        ("deg", "deg", 1.0),
    ],
)
def test_units(unit: str, si: str, factor: float) -> None:
    assert factor_to_si(unit, si) == pytest.approx(factor, rel=1e-14)


def test_a_unit_in_si_changes_no_bit() -> None:
    values = np.random.default_rng(0).normal(size=100)
    entry = checked_map("m", {"channels": {"v_x": {"column": "v", "unit": "m/s"}}}).channels["v_x"]
    assert np.array_equal(converted(values, entry, factor_to_si("m/s", "m/s")), values)


@pytest.mark.parametrize(
    ("unit", "si"),
    [
        ("deg", "m/s"), ("m/s", "rad"), ("1", "rad"), ("deg", "1"), ("Hz", "rad/s"),
        ("degC", "m/s"), ("bar", "N m"), ("__import__('os')", "m/s"), ("m/s" * 50, "m/s"),
        ("furlongs", "m/s"), ("m/0", "m/s"), ("5 m/s", "m/s^2"),
    ],
)  # fmt: skip
def test_other_dimensions_do_not_fit(unit: str, si: str) -> None:
    assert not is_unit_of(unit, si)
    with pytest.raises(UsageError, match=r"is unknown|does not fit"):
        factor_to_si(unit, si)


def test_sign_offset_scale_and_ratio() -> None:
    entry = checked_map(
        "m",
        {
            "channels": {
                "delta": {
                    "column": "a",
                    "unit": "deg",
                    "sign": -1,
                    "offset": -5.0,
                    "scale": 2.0,
                    "ratio": 15.0,
                }
            }
        },
    ).channels["delta"]
    values = converted(np.array([10.0]), entry, factor_to_si("deg", "rad"))
    assert values[0] == pytest.approx(-np.radians(2.0 * 10.0 - 5.0) / 15.0)


def test_the_speed_of_a_wheel_may_be_a_velocity_with_its_radius() -> None:
    wheel = {"column": "w", "unit": "km/h"}
    with pytest.raises(UsageError, match="needs wheel_radius"):
        checked_map("m", {"channels": {"wheel_speed_front_left": wheel}})
    checked_map("m", {"channels": {"wheel_speed_front_left": wheel | {"wheel_radius": 0.3}}})
    with pytest.raises(UsageError, match="for wheel speeds only"):
        checked_map("m", {"channels": {"v_x": wheel | {"wheel_radius": 0.3}}})


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("channels: {v_x: {column: v}}", "channels.v_x.unit: is missing"),
        ("channels: {v_x: {colum: v, unit: m/s}}", "channels.v_x.colum: no such parameter"),
        ("channels: {vx: {column: v, unit: m/s}}", "channels.vx: no such channel; did you mean"),
        ("chanels: {}", "chanels: no such parameter"),
        ("channels: {}", "channels: name at least one channel"),
        (
            "channels: {v_x: {column: v, unit: deg}}",
            "channels.v_x.unit: unit 'deg' does not fit: a velocity, such as m/s or km/h",
        ),
        (
            "channels: {v_x: {column: v, unit: kmm/h}}",
            "channels.v_x.unit: unit 'kmm/h' is unknown",
        ),
        ("channels: {v_x: {column: v, unit: m/s, sign: 2}}", "channels.v_x.sign: Input should be"),
        ("channels: {v_x: {column: v, unit: m/s, ratio: 0}}", "scale and ratio must not be 0"),
        (
            "time: {column: t, unit: days}\nchannels: {v_x: {column: v, unit: m/s}}",
            "time.unit: unit 'days' is unknown: choose one of ns, us",
        ),
        (
            "files: {a.csv: {delimeter: ','}}\nchannels: {v_x: {column: v, unit: m/s}}",
            "files.a.csv.delimeter: no such parameter",
        ),
        ("channels: [", "at line"),
    ],
)
def test_a_wrong_map_is_refused_in_one_line(capsys, tmp_path, text: str, line: str) -> None:
    (tmp_path / "map.yaml").write_text(text)
    (tmp_path / "a.csv").write_text("t,v\n0.0,1.0\n0.1,1.0\n")
    arguments = ["import", tmp_path / "a.csv", "--map", tmp_path / "map.yaml"]
    printed = refused(capsys, [*arguments, "--out", tmp_path / "bag"], 2)
    assert "map.yaml" in printed
    assert line in printed
    assert not (tmp_path / "bag").exists()
