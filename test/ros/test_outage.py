# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Nothing predicted for a second: the level is ERROR, and the message says why."""

import copy
import random
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from helpers.node import Change, Rig, call, running_node, wait_for, write_model
from std_srvs.srv import SetBool

from adk_ros.model import artefact
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.pipeline import PipelineSettings
from adk_ros.ros.diagnostics import Level
from adk_ros.ros.messages import join_stamp, split_stamp
from adk_ros.ros.session import Session
from adk_ros.signals.channels import STANDARD_SOURCES, TICK_NS, Source
from adk_ros.signals.gate import GateSettings

YEAR_S = 365.25 * 86400.0


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> KoopmanModel:
    folder: Path = write_model(tmp_path_factory.mktemp("model") / "model")
    return artefact.load(folder).model


def restamped(new_ns: Callable[[int], int], *sources: Source) -> Change:
    """Return a change of the stamps of `sources`."""

    def change(source: Source, msg: Any) -> Any:
        if source in sources:
            stamp = msg.header.stamp
            stamp.sec, stamp.nanosec = split_stamp(new_ns(join_stamp(stamp)))
        return msg

    return change


def stuck() -> Callable[[int], int]:
    first: list[int] = []

    def same(stamp_ns: int) -> int:
        first.append(stamp_ns)
        return first[0]

    return same


def erratic() -> Callable[[int], int]:
    noise = random.Random(0)
    return lambda stamp_ns: stamp_ns + noise.randrange(-(10**15), 10**15)


def shifted(by_s: float) -> Callable[[int], int]:
    return lambda stamp_ns: stamp_ns + round(by_s * 1e9)


def edited(source: Source, edit: Callable[[Any], None]) -> Change:
    def change(given: Source, msg: Any) -> Any:
        if given is source:
            edit(msg)
        return msg

    return change


def no_joints(msg: Any) -> None:
    msg.name = []


def no_stamp(msg: Any) -> None:
    msg.header.stamp.sec = msg.header.stamp.nanosec = 0


def lost(*sources: Source) -> Change:
    return lambda source, msg: None if source in sources else msg


CAUSES: dict[str, tuple[Change, str]] = {
    "no odometry": (lost(Source.ODOMETRY), "odometry "),
    "no command": (lost(Source.COMMAND), "command never received"),
    "no topic": (lost(*STANDARD_SOURCES), "command never received"),
    "refused": (edited(Source.COMMAND, no_joints), "all command messages are refused"),
    "no stamps": (edited(Source.ODOMETRY, no_stamp), "all odometry messages are refused"),
    "one stamp": (restamped(stuck(), Source.ODOMETRY), "odometry stamps are stuck"),
    "one stamp each": (restamped(stuck(), *STANDARD_SOURCES), "command stamps are stuck"),
    "random stamps": (
        restamped(erratic(), Source.ODOMETRY), "odometry stamps jump back and forth",
    ),
    "all random": (
        restamped(erratic(), *STANDARD_SOURCES), "command stamps jump back and forth",
    ),
    "other time": (
        restamped(shifted(-54 * YEAR_S), Source.COMMAND),
        "command stamps are 54 years behind the other streams",
    ),
}  # fmt: skip


@pytest.mark.parametrize("cause", sorted(set(CAUSES) - {"one stamp"}))
def test_an_error_names_the_cause_from_the_start(model: KoopmanModel, cause: str) -> None:
    change, words = CAUSES[cause]
    rig = Rig(model)
    reports = rig.drive(4.0, copy.deepcopy(change))
    assert not rig.published
    assert {report.level for report in reports} == {Level.ERROR}
    assert reports[-1].message.startswith("no predictions: ")
    assert words in reports[-1].message
    assert float(dict(reports[-1].values)["prediction_age_s"]) == pytest.approx(4.0)
    rig.drive(4.0)
    assert rig.reports[-1].level is Level.OK, rig.reports[-1].message


@pytest.mark.parametrize(
    "cause", ["no odometry", "no topic", "no stamps", "one stamp", "one stamp each", "all random"]
)
def test_an_error_names_the_cause_in_mid_drive(model: KoopmanModel, cause: str) -> None:
    change, words = CAUSES[cause]
    rig = Rig(model)
    rig.drive(3.0)
    report = rig.drive(4.0, copy.deepcopy(change))[-1]
    assert report.level is Level.ERROR
    assert report.message.startswith("no predictions: ")
    assert words.replace("never received", "timeout (4.0 s)") in report.message


def test_a_gate_that_never_accepts_a_new_level_causes_no_outage(model: KoopmanModel) -> None:
    """Once the state is lost there is nothing to compare with, and readings are accepted again."""
    settings = PipelineSettings(gate=GateSettings(confirmations=1000), max_coast_s=0.5)
    rig = Rig(model, settings)
    rig.drive(3.0)

    def faster(msg: Any) -> None:
        msg.twist.twist.linear.x += 60.0

    reports = rig.drive(4.0, edited(Source.ODOMETRY, faster))
    assert "odometry readings rejected: v_x 7" in reports[0].message
    assert all(report.level is not Level.ERROR for report in reports)
    stamps = np.array([prediction.stamp_ns for prediction in rig.published])
    assert 4 * TICK_NS < np.diff(stamps).max() < 10**9


def test_an_error_says_that_simulation_time_is_missing(model: KoopmanModel) -> None:
    rig = Rig(model)
    rig.sim_time = (True, False)
    report = rig.drive(2.0, lost(*STANDARD_SOURCES))[-1]
    assert report.level is Level.ERROR
    assert "simulation time has not started: no /clock" in report.message


def test_an_outage_is_overdue_after_a_second(model: KoopmanModel) -> None:
    rig = Rig(model)
    rig.drive(2.3)
    assert not rig.diagnostics.is_overdue(rig.mono_ns * 1e-9)
    last_s = rig.core.counters.last_published_s
    assert last_s is not None
    assert not rig.diagnostics.is_overdue(last_s + 0.99)
    assert rig.diagnostics.is_overdue(last_s + 1.01)
    rig.mono_ns = round((last_s + 1.01) * 1e9)
    assert rig.report().level is Level.ERROR
    assert not rig.diagnostics.is_overdue(last_s + 1.02)


def test_short_gaps_are_no_error(model: KoopmanModel) -> None:
    rig = Rig(model, PipelineSettings(max_coast_s=0.1, odometry_timeout_s=0.1))
    rig.drive(2.0)
    rig.drive(0.9, lost(*STANDARD_SOURCES))
    assert rig.report().level is not Level.ERROR
    rig.mono_ns += TICK_NS * 16
    assert rig.report().level is Level.ERROR


def test_a_node_reports_a_second_after_its_start(tmp_path: Path) -> None:
    """Live, with a report every 60 s: the error comes in between, with the topics."""
    seen: list[Any] = []
    with (
        Session("watcher") as session,
        running_node(
            "-r",
            "odometry:=/odom",
            model=write_model(tmp_path / "model"),
            diagnostics_period_s=60.0,
        ),
    ):
        session.node.create_subscription(
            DiagnosticArray, "/diagnostics", lambda array: seen.extend(array.status), 10
        )
        # Discovery takes seconds now and then, and whoever comes after the report waits for the
        # next. So the node starts afresh once both know each other, and says so at once.
        while not seen:
            assert call(session, SetBool, "/predictor/enable", SetBool.Request(data=True)).success
            session.spin(0.1)
        begin_s = time.monotonic()
        wait_for(session, lambda: bool(seen[-1].level == b"\x02"))
    assert time.monotonic() - begin_s < 10.0
    assert seen[-1].message == (
        "no predictions: odometry never received on /odom, command never received on /command"
    )
