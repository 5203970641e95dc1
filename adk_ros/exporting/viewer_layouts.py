# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Layouts that show the signals of an MCAP file in Foxglove and PlotJuggler."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from typing import Any, NamedTuple

_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
"""Colours of Okabe and Ito, which colour-blind readers distinguish."""
_PER_TAB = 3


class Curve(NamedTuple):
    """
    A number in a topic; `field` is its path in the message, with dots and indices.

    `joint`: of a JointState, the name of the joint that the index stands for.
    """

    topic: str
    field: str
    joint: str = ""


class Plot(NamedTuple):
    """Curves in one diagram."""

    title: str
    curves: tuple[Curve, ...]


def foxglove_layout(plots: Sequence[Plot]) -> str:
    """Return a layout of Foxglove (JSON) with the plots below each other, three in a tab."""
    panels: dict[str, Any] = {}
    tabs = []
    for start in range(0, len(plots), _PER_TAB):
        group = plots[start : start + _PER_TAB]
        names = []
        for number, plot in enumerate(group, start=start + 1):
            names.append(f"Plot!plot{number}")
            panels[names[-1]] = {
                "foxglovePanelTitle": plot.title,
                "paths": [
                    {
                        "value": f"{curve.topic}.{curve.field}",
                        "enabled": True,
                        "timestampMethod": "receiveTime",
                        "color": _COLOURS[i % len(_COLOURS)],
                    }
                    for i, curve in enumerate(plot.curves)
                ],
                "showLegend": True,
                "legendDisplay": "floating",
                "showXAxisLabels": True,
                "showYAxisLabels": True,
                "isSynced": True,
                "xAxisVal": "timestamp",
            }
        tabs.append({"title": ", ".join(plot.title for plot in group), "layout": _column(names)})
    panels["Tab!signals"] = {"activeTabIdx": 0, "tabs": tabs}
    layout = {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": "Tab!signals",
    }
    return json.dumps(layout, indent=2) + "\n"


def _column(names: Sequence[str]) -> Any:
    """Return panels below each other, of equal height."""
    if len(names) == 1:
        return names[0]
    return {
        "direction": "column",
        "first": names[0],
        "second": _column(names[1:]),
        "splitPercentage": round(100.0 / len(names), 1),
    }


def plotjuggler_layout(plots: Sequence[Plot], file_name: str) -> str:
    """Return a layout of PlotJuggler (XML), three plots in a tab; `file_name` is the MCAP file."""
    root = ElementTree.Element("root")
    window = ElementTree.SubElement(
        root, "tabbed_widget", {"parent": "main_window", "name": "Main Window"}
    )
    for start in range(0, len(plots), _PER_TAB):
        group = plots[start : start + _PER_TAB]
        title = ", ".join(plot.title for plot in group)
        tab = ElementTree.SubElement(window, "Tab", {"containers": "1", "tab_name": title})
        container = ElementTree.SubElement(tab, "Container")
        sizes = ";".join([f"{1.0 / len(group):.6f}"] * len(group))
        splitter = ElementTree.SubElement(
            container,
            "DockSplitter",
            {"orientation": "-", "count": str(len(group)), "sizes": sizes},
        )
        for plot in group:
            area = ElementTree.SubElement(splitter, "DockArea", {"name": plot.title})
            diagram = ElementTree.SubElement(
                area, "plot", {"mode": "TimeSeries", "style": "Lines"}
            )
            ElementTree.SubElement(diagram, "limitY")
            for i, curve in enumerate(plot.curves):
                ElementTree.SubElement(
                    diagram,
                    "curve",
                    {"color": _COLOURS[i % len(_COLOURS)], "name": plotjuggler_name(curve)},
                )
    ElementTree.SubElement(window, "currentTabIndex", {"index": "0"})
    ElementTree.SubElement(root, "use_relative_time_offset", {"enabled": "1"})
    loaded = ElementTree.SubElement(root, "previouslyLoaded_Datafiles")
    about = ElementTree.SubElement(loaded, "fileInfo", {"filename": file_name, "prefix": ""})
    topics = {curve.topic for plot in plots for curve in plot.curves}
    selected = ElementTree.SubElement(about, "selected_datasources")
    selected.set("value", ";".join(sorted(topics)))
    ElementTree.indent(root, " ")
    text = ElementTree.tostring(root, encoding="unicode")
    return f"<?xml version='1.0' encoding='UTF-8'?>\n{text}\n"


def plotjuggler_name(curve: Curve) -> str:
    """Return the name that PlotJuggler gives a number: slashes, and joints by their name."""
    if curve.joint:
        return f"{curve.topic}/{curve.joint}/{curve.field.partition('[')[0]}"
    return f"{curve.topic}/{curve.field.replace('.', '/')}"
