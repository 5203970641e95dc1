# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Data frames of the Python interface: column names, units in `attrs`, HTML for notebooks."""

from __future__ import annotations

import html
from typing import Any

import pandas as pd

from adk_ros.signals.channels import INPUT_NAMES, STATE_NAMES
from adk_ros.signals.score import DISPLAY_NAMES

UNITS = {
    "v_x": "m/s",
    "v_y": "m/s",
    "yaw_rate": "rad/s",
    "a_x": "m/s²",
    "a_y": "m/s²",
    "torque": "N·m",
    "delta": "rad",
    "time_s": "s",
    "start_s": "s",
    "t_s": "s",
    "horizon_s": "s",
}
"""Unit of each channel and time column; a suffix such as `_measured` does not change the unit."""

_SHOWN_ROWS = 8
"""Rows of a frame that a result shows in a notebook."""


def suffixed(suffix: str, names: tuple[str, ...] = STATE_NAMES) -> list[str]:
    """Return the channel names with a suffix, such as `v_x_measured`."""
    return [f"{name}_{suffix}" for name in names]


def unit_of(column: str) -> str:
    """Return the unit of a column; "" if it has none."""
    if column in UNITS:
        return UNITS[column]
    channels = (*STATE_NAMES, *INPUT_NAMES, "a_x", "a_y")
    return next((UNITS[name] for name in channels if column.startswith(f"{name}_")), "")


def with_units(frame: pd.DataFrame, name: str = "") -> pd.DataFrame:
    """Set `frame.attrs["units"]`, column or index name -> unit, and `frame.attrs["name"]`."""
    labels = [str(label) for label in (*frame.index.names, *frame.columns) if label is not None]
    frame.attrs["units"] = {label: unit_of(label) for label in labels if unit_of(label)}
    frame.attrs["name"] = name
    return frame


def score_frame(scores: dict[str, Any] | None) -> pd.DataFrame:
    """
    Return the scores of a model and of the naive predictors as a table.

    :param scores: `held_out` of a model's manifest, or `HeldOutScores.as_json()`; None if nothing
        was scored, which gives an empty table.
    :return: index (channel, horizon_s); one column per predictor with its RMSE in m/s or rad/s;
        `ratio` and `ratio_commands_held`, the model's RMSE divided by that of the best naive
        predictor, with future commands known and with commands held constant. Below 1 is better.
    """
    index = pd.MultiIndex.from_tuples([], names=["channel", "horizon_s"])
    if not scores:
        return pd.DataFrame(index=index, columns=["ratio", "ratio_commands_held"], dtype=float)
    horizons = scores["horizons_s"]
    index = pd.MultiIndex.from_product([STATE_NAMES, horizons], names=["channel", "horizon_s"])
    columns = {
        DISPLAY_NAMES.get(name, name): [
            value for channel in STATE_NAMES for value in errors[channel]["rmse"]
        ]
        for name, errors in scores["predictors"].items()
    }
    for column, key in (
        ("ratio", "ratio_to_best_naive"),
        ("ratio_commands_held", "ratio_to_best_naive_commands_held"),
    ):
        columns[column] = [value for channel in STATE_NAMES for value in scores[key][channel]]
    frame = pd.DataFrame(columns, index=index)
    frame.attrs["units"] = {name: UNITS[name] for name in (*STATE_NAMES, "horizon_s")}
    frame.attrs["starts"] = scores["starts"]
    return frame


def as_html(title: str, *frames: pd.DataFrame) -> str:
    """Return a heading and the first rows of each frame as HTML for a notebook."""
    parts = [f"<p><b>{html.escape(title)}</b></p>"]
    for frame in frames:
        parts.append(frame.head(_SHOWN_ROWS).to_html(float_format=lambda value: f"{value:.4g}"))
        if len(frame) > _SHOWN_ROWS:
            parts.append(f"<p>{len(frame)} rows, {len(frame.columns)} columns</p>")
    return "\n".join(parts)
