# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What an import once lost, misread or refused without saying why."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from adk_ros.calibration.pedals import _four_digits
from adk_ros.errors import DataError, UsageError
from adk_ros.files.yaml_file import validate
from adk_ros.importing.delimited_text import detect_layout, read_text_table
from adk_ros.importing.map_file import ChannelMap, FileMap
from adk_ros.importing.sign_choice import choose_signs
from adk_ros.importing.source_channels import SourceChannel
from adk_ros.importing.streams import joined
from adk_ros.importing.unit_choice import Findings
from adk_ros.importing.units import factor_to_si
from adk_ros.numerics.arrays import FloatArray


def test_a_row_with_a_field_more_hides_none_before_it(tmp_path: Path) -> None:
    path = tmp_path / "drive.csv"
    rows = [f"{i},{i},{i}" for i in range(150)]
    path.write_text("\n".join(["time,a,b", *rows, "150,1,2,marker", *rows]))
    assert detect_layout(path, FileMap()).first_row == 1
    with pytest.raises(DataError, match="Expected 3 fields in line 152, saw 4"):
        read_text_table(path, FileMap())


def test_a_long_file_of_two_byte_characters_is_read(tmp_path: Path) -> None:
    path = tmp_path / "excel.txt"
    rows = [f"{i}\t{0.5 * i}" for i in range(400)]
    path.write_text("\n".join(["time\tspeed", *rows]), encoding="utf-16")
    table = read_text_table(path, FileMap())
    assert table.columns == ("time", "speed")
    assert table.load(["speed"])["speed"].shape == (400,)


def test_a_header_far_below_the_top_is_found(tmp_path: Path) -> None:
    path = tmp_path / "logger.csv"
    rows = [f"{i},{i}" for i in range(50)]
    path.write_text("\n".join(["# about"] * 250 + ["time,speed", *rows]))
    assert detect_layout(path, FileMap(header_row=251)).names == ("time", "speed")


@pytest.mark.parametrize("given", ["\\t", "tab", "\t"])
def test_a_tab_has_three_spellings(given: str) -> None:
    assert validate("map", {"delimiter": given}, FileMap).delimiter == "\t"
    with pytest.raises(UsageError, match="delimiter"):
        validate("map", {"delimiter": "||"}, FileMap)


def test_units_of_loggers() -> None:
    assert factor_to_si("mg", "m/s^2") == pytest.approx(9.80665e-3)
    with pytest.raises(UsageError, match="torque"):
        factor_to_si("ft lb", "N m")


def channel(name: str, period_ns: int, count: int) -> SourceChannel:
    stamps = np.arange(count, dtype=np.int64) * period_ns
    entry = ChannelMap(column=name, unit="1")
    return SourceChannel(name, "table", name, entry, 1.0, stamps, np.sin(stamps * 1e-9), 0, 0, 0)


def test_a_channel_of_half_the_rate_loses_no_message_of_the_other() -> None:
    notes: list[str] = []
    stream = joined(
        "command", [channel("torque", 10_000_000, 1000), channel("delta", 20_000_000, 500)], notes
    )
    assert len(stream) >= 998


def turning(sign: float) -> dict[str, FloatArray]:
    """Return a drive whose axes point to the left (1) or to the right (-1), on a map."""
    at_s = np.arange(0.0, 200.0, 0.025)
    rate = 0.3 * np.sin(0.2 * at_s) + 0.1 * np.sin(0.7 * at_s)
    v, heading = np.full(at_s.size, 15.0), np.cumsum(rate) * 0.025
    return {
        "v_x": v,
        "v_y": sign * -0.2 * rate,
        "yaw_rate": sign * rate,
        "a_y": sign * v * rate,
        "delta": sign * 0.18 * rate,
        "x": np.cumsum(v * np.cos(heading)) * 0.025,
        "y": np.cumsum(v * np.sin(heading)) * 0.025,
    }


def test_the_lateral_velocity_turns_with_all_others() -> None:
    found = Findings()
    choose_signs(turning(-1.0), found)
    assert {"yaw_rate", "a_y", "delta", "v_y"} <= set(found.flipped)
    assert "v_y" in found.doubtful_signs
    right = Findings()
    choose_signs(turning(1.0), right)
    assert not right.flipped


def test_a_compass_does_not_settle_the_direction() -> None:
    signals = turning(1.0)
    rate = signals["yaw_rate"]
    for name in ("x", "y"):
        signals.pop(name)
    signals["heading"] = -np.cumsum(rate) * 0.025
    found = Findings()
    choose_signs(signals, found)
    assert set(found.flipped) <= found.doubtful_signs
    assert found.reference == ""


def test_a_map_of_pedals_has_no_exponents() -> None:
    assert _four_digits(np.array([0.0, 1234.5678, 4e6, 0.0123])) == "[0, 1235, 4000000, 0.0123]"
