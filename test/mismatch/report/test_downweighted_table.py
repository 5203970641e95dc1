# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Episodes that the loss downweights, on the page and in the JSON file."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from helpers.mismatch_report import result_of
from helpers.pages import Page, assert_contents, assert_self_contained

from adk_ros.mismatch.inference.downweighted_episodes import Downweighted, Episode
from adk_ros.mismatch.report.downweighted_table import (
    MAX_ROWS,
    downweighted_rows,
    downweighted_text,
)
from adk_ros.mismatch.report.result_files import write_report

pytestmark = pytest.mark.usefixtures("unrendered")

EPISODE = Episode(35.2, 35.8, "imu_a_y", 1.4, 20.0, 3.0, 4.0, 120.0, 0.05)


def hidden(*episodes: Episode) -> Downweighted:
    share = sum(episode.share for episode in episodes)
    return Downweighted(episodes, len(episodes), 0, 1.0, 1, share, ("v_y",), share_of_excess=0.25)


def many(count: int) -> Downweighted:
    """The later an episode, the smaller its share."""
    return hidden(
        *(
            EPISODE._replace(begin_s=10.0 * i, end_s=10.0 * i + 0.2, share=0.02 - 1e-4 * i)
            for i in range(count)
        )
    )


def test_an_episode_is_listed_with_time_place_channel_size_and_share() -> None:
    header, rows = downweighted_rows(hidden(EPISODE))
    assert header[:3] == ["begin", "duration", "place"]
    assert rows == [
        [
            "35.2 s",
            "0.60 s",
            "120 m along the lap",
            "IMU lateral acceleration",
            "+1.4 m/s²",
            "20.0",
            "5 %",
        ]
    ]


def test_without_a_lap_the_place_is_the_position_if_there_is_one() -> None:
    _, rows = downweighted_rows(hidden(EPISODE._replace(lap_m=None)))
    assert rows[0][2] == "x 3 m, y 4 m"
    nowhere = EPISODE._replace(lap_m=None, x=0.0, y=0.0)
    header, rows = downweighted_rows(hidden(nowhere))
    assert "place" not in header
    assert len(rows[0]) == len(header)


def test_the_largest_are_listed_in_order_of_time() -> None:
    reversed_in_time = hidden(*reversed(many(MAX_ROWS + 5).episodes))
    _, rows = downweighted_rows(reversed_in_time)
    assert [row[0] for row in rows] == [f"{10.0 * i:.1f} s" for i in range(MAX_ROWS)]


def test_the_sentence_says_what_the_episodes_compare_to() -> None:
    one, five = downweighted_text(many(1)), downweighted_text(many(5))
    assert one.startswith("1 episode, 1 s in all (each counts as at least 1 s): 2 % of the loss")
    assert "25 % of the loss above that of noise" in one
    assert one.endswith("error on the simulation may explain.")
    assert "error on the simulation explain." in five
    assert "may explain" not in five
    assert "far from the recording" in downweighted_text(replace(many(5), counted_s=9.0))


def test_the_page_lists_them_and_counts_those_that_it_leaves_out(tmp_path: Path) -> None:
    write_report(replace(result_of(), downweighted=many(MAX_ROWS + 3)), tmp_path / "report")
    page = Page((tmp_path / "report" / "report.html").read_text(encoding="utf-8"))
    assert_self_contained(page)
    assert_contents(page)
    assert "Episodes of large residuals" in page.headings.values()
    assert (
        sum("IMU lateral acceleration" in row and "20.0" in row for row in page.rows) == MAX_ROWS
    )
    assert "3 further episodes with smaller shares" in page.text
    written = json.loads((tmp_path / "report" / "mismatch.json").read_text())
    episodes = written["downweighted"]["episodes"]
    assert len(episodes) == MAX_ROWS + 3
    assert episodes[0]["share"] == 0.02


def test_a_page_without_episodes_has_no_such_section(tmp_path: Path) -> None:
    write_report(result_of(), tmp_path / "report")
    text = (tmp_path / "report" / "report.html").read_text(encoding="utf-8")
    assert "downweighted" not in text
