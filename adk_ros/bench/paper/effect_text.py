# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Table and sentences about the effect of the paper's online method, by reading."""

from __future__ import annotations

from collections.abc import Sequence

from adk_ros.bench.paper.online_effect import (
    A_POSTERIORI,
    INNOVATION,
    Reading,
    printed_reduction,
)
from adk_ros.bench.paper.paper_results import PAPER_EPOCHS
from adk_ros.bench.paper.paper_tables import Table, number
from adk_ros.bench.paper.scores import CHANNELS, UNITS

OF_PAPER_EPOCHS = (
    f"The paper's {PAPER_EPOCHS} epochs are not among these readings; doc/paper.md describes a "
    f"run that has them (adk bench paper --only-effect --epochs {PAPER_EPOCHS})."
)
"""Such a training takes two hours on a CPU, so a run without it says where to look."""


def effect_tables(readings: Sequence[Reading]) -> list[Table]:
    """Return the table of the readings."""
    header = ["epochs", "window", "cut", "errors"]
    for channel, unit in zip(CHANNELS, UNITS, strict=True):
        header += [f"{channel}: ALDK, {unit}", f"SWLS, {unit}", f"Max, {unit}", "less, %"]
    header.append("as printed")
    rows = [_row(reading) for reading in readings]
    reached = ", ".join(f"{share:.0f}" for share in printed_reduction())
    title = f"ALDK-SWLS against ALDK by reading, nominal test (printed: {reached} % less)"
    strong = tuple(i for i, reading in enumerate(readings) if reading.reproduces)
    return [Table("online_effect", title, header, rows, strong)]


def _row(reading: Reading) -> list[str]:
    chosen = " (chosen)" if reading.chosen else ""
    cells = [str(reading.epochs), f"{reading.window}{chosen}", f"{reading.cut:g}", reading.kind]
    for c in range(3):
        figures = (reading.constant_rmse[c], reading.rmse[c], reading.worst[c])
        cells += [*(number(float(x)) for x in figures), f"{reading.reduction[c]:.0f}"]
    return [*cells, "yes" if reading.reproduces else "no"]


def effect_text(readings: Sequence[Reading]) -> list[str]:
    """
    Return sentences: which readings reproduce the printed effect, and which do not.

    Without a reading of the paper's epochs, the last one says where there is one.
    """
    if not readings:
        return []
    reached = ", ".join(f"{share:.0f}" for share in printed_reduction())
    has_paper_epochs = any(reading.epochs >= PAPER_EPOCHS for reading in readings)
    return [
        f"Printed: ALDK-SWLS is {reached} % (v_x, v_y, yaw rate) below ALDK, nominal test.",
        *(_sentence(kind, [x for x in readings if x.kind == kind]) for kind in
          (INNOVATION, A_POSTERIORI)),
        *([] if has_paper_epochs else [OF_PAPER_EPOCHS]),
    ]  # fmt: skip


def _sentence(kind: str, readings: Sequence[Reading]) -> str:
    reproduced = [x for x in readings if x.reproduces]
    what = "As innovations" if kind == INNOVATION else "As a-posteriori errors"
    if not reproduced:
        best = max(readings, key=lambda x: float((x.reduction - printed_reduction()).min()))
        return f"{what}, no reading reproduces it; nearest: {_described(best)}."
    listed = "; ".join(_described(x) for x in reproduced)
    return f"{what}, {len(reproduced)} of {len(readings)} readings reproduce it: {listed}."


def _described(reading: Reading) -> str:
    shares = ", ".join(f"{share:.0f}" for share in reading.reduction)
    return (
        f"{reading.epochs} epochs, window {reading.window}, cut {reading.cut:g}: {shares} % less"
    )
