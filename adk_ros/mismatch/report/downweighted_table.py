# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Residuals that the robust loss downweights: the page's sentence on them, and its table."""

from __future__ import annotations

from typing import Any

from adk_ros.mismatch.inference.downweighted import LONGEST_S
from adk_ros.mismatch.inference.downweighted_episodes import Downweighted, Episode
from adk_ros.mismatch.recording.sensor_log import CHANNELS, UNITS
from adk_ros.mismatch.report.effect_text import percent
from adk_ros.mismatch.report.report_tables import Rows, without_empty
from adk_ros.mismatch.report.vocabulary import CHANNEL_TITLES, unit_text
from adk_ros.numerics.levenberg_marquardt import HUBER_THRESHOLD

MAX_ROWS = 20
"""Most episodes that the page shows; `mismatch.json` lists all of them. By choice."""


def downweighted_parts(hidden: Downweighted) -> dict[str, Any]:
    """Return what the page's section on downweighted residuals shows."""
    header, rows = downweighted_rows(hidden)
    return {
        "text": downweighted_text(hidden),
        "header": header,
        "rows": rows,
        "further": len(hidden.episodes) - len(rows),
        "threshold": f"{HUBER_THRESHOLD:g}",
        "longest": f"{LONGEST_S:g}",
    }


def downweighted_text(hidden: Downweighted) -> str:
    """Return number, duration and share of the loss of all episodes, and what they compare to."""
    count = len(hidden.episodes)
    text = (
        f"{count} episode{'' if count == 1 else 's'}, {hidden.seconds} s in all (each counts as "
        f"at least 1 s): {percent(hidden.share)} of the loss, and "
        f"{percent(hidden.share_of_excess)} of the loss above that of noise."
    )
    if hidden.is_rule:
        return (
            f"{text} They take {100.0 * hidden.share_of_time:.0f} % of the seconds: the "
            "simulation is far from the recording, and what is fitted follows the smaller "
            "residuals."
        )
    others = "accidents and the surrogate model's error on the simulation"
    if hidden.is_material:
        return f"{text} These are more than {others} explain."
    return f"{text} No more than {others} may explain."


def downweighted_rows(hidden: Downweighted) -> tuple[list[str], Rows]:
    """
    Return header and rows of the episodes with the largest shares of the loss, by time.

    Begin, duration, place, channel, size, standard deviations, share; without the column of the
    place where the recording has no positions.
    """
    largest = sorted(hidden.episodes, key=lambda x: -x.share)[:MAX_ROWS]
    rows = [_row(episode) for episode in sorted(largest, key=lambda x: x.begin_s)]
    header = [
        "begin",
        "duration",
        "place",
        "channel",
        "size",
        "standard deviations",
        "share of the loss",
    ]
    return without_empty(header, rows, 2)


def _row(episode: Episode) -> list[str]:
    unit = unit_text(UNITS[CHANNELS.index(episode.channel)])
    return [
        f"{episode.begin_s:.1f} s",
        f"{episode.end_s - episode.begin_s:.2f} s",
        _place(episode),
        CHANNEL_TITLES[episode.channel],
        f"{episode.size:+.2g} {unit}",
        f"{episode.sigmas:.1f}",
        percent(episode.share),
    ]


def _place(episode: Episode) -> str:
    """Return the distance along the lap, or the position; nothing where there is neither."""
    if episode.lap_m is not None:
        return f"{episode.lap_m:.0f} m along the lap"
    # Odometry without positions reports zeros.
    if episode.x == episode.y == 0.0:
        return ""
    return f"x {episode.x:.0f} m, y {episode.y:.0f} m"
