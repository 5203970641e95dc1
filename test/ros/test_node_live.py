# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The real node in a separate process over DDS: its publications and its end.

The node must publish exactly what the pipeline yields for the same bag, as `adk replay` does.
"""

import json
import signal
import subprocess
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from helpers.node import (
    REMAP,
    TOPICS,
    NodeProcess,
    call,
    run_python,
    running_node,
    wait_for,
    write_bag,
    write_model,
)
from nav_msgs.msg import Odometry
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger
from trajectory_msgs.msg import MultiDOFJointTrajectory

from adk_ros.bags import Bag
from adk_ros.errors import UsageError
from adk_ros.model import artefact
from adk_ros.model.pipeline import Pipeline
from adk_ros.model.prediction import Prediction
from adk_ros.ros.echo import PredictionLog, echo, record, watch_diagnostics
from adk_ros.ros.messages import join_stamp
from adk_ros.ros.node import GRACE_S
from adk_ros.ros.session import Session
from adk_ros.ros.traffic import Rates, message
from adk_ros.signals.channels import STANDARD_SOURCES, Reading, Source

PLAY = f"""
import json, sys
from adk_ros.ros.play import play
options = json.loads(sys.argv[2])
stats = play(sys.argv[1], remap={REMAP!r}, wait_for_subscribers_s=30.0, **options)
print(json.dumps(stats.to_json()))
"""
SKIPPED_NS = 100_000_000
"""ns; the node may start this much later, since the first message that it receives varies."""


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_model(tmp_path_factory.mktemp("model") / "model")


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_bag(tmp_path_factory.mktemp("bag") / "bag", 10.0)


class Listener:
    """Records the predictions of a node, and its horizons and diagnostics, in a thread."""

    def __init__(self) -> None:
        self.horizons: dict[int, Any] = {}
        self.covariances: list[Any] = []
        self.shown: dict[str, str] = {}
        self.recording = PredictionLog("")
        self._ended = threading.Event()
        self._ready = threading.Event()
        self._thread = threading.Thread(target=self._listen)

    def _listen(self) -> None:
        def subscribe(node: Any) -> None:
            watch_diagnostics(node, self.shown)
            node.create_subscription(
                MultiDOFJointTrajectory, "/predictor/predicted_horizon", self._take_horizon, 1000
            )
            node.create_subscription(
                Float64MultiArray, "/predictor/predicted_horizon_covariance",
                self.covariances.append, 1000,
            )  # fmt: skip

        self.recording = record(
            wait_s=60.0, until=self._ended.is_set, on_ready=lambda _name: self._ready.set(),
            on_node=subscribe,
        )  # fmt: skip

    def _take_horizon(self, message: Any) -> None:
        self.horizons[join_stamp(message.header.stamp)] = message

    def __enter__(self) -> "Listener":
        self._thread.start()
        assert self._ready.wait(60.0)
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()


def play(bag: Path, **options: Any) -> subprocess.Popen[str]:
    return run_python(PLAY, str(bag), json.dumps(options))


def finish(player: subprocess.Popen[str]) -> dict[str, Any]:
    out, errors = player.communicate(timeout=120.0)
    assert player.returncode == 0, errors
    stats: dict[str, Any] = json.loads(out.splitlines()[-1])
    return stats


def replay_bags(model: Path, bags: list[Path], until_s: float | None = None) -> list[Prediction]:
    """Return the pipeline's predictions for bags, one after the other."""
    pipeline = Pipeline(artefact.load(model).model)
    predictions = []
    for path in bags:
        with Bag(path) as opened:
            for topic, log_ns, msg in opened.messages(list(TOPICS)):
                if until_s is None or log_ns <= opened.start_ns + until_s * 1e9:
                    predictions += pipeline.take(TOPICS[topic], msg)
    return predictions


def compare(expected: list[Prediction], recording: PredictionLog) -> None:
    """Require the same samples except in the first 100 ms, and values within 1e-9."""
    first_ns = expected[0].stamp_ns
    required = [item for item in expected if item.stamp_ns > first_ns + SKIPPED_NS]
    received = [item for item in recording.received if item.stamp_ns > first_ns + SKIPPED_NS]
    assert [item.stamp_ns for item in received] == [item.stamp_ns for item in required]
    assert len(required) > 100
    np.testing.assert_allclose(
        [item.x for item in received], [item.x for item in required], rtol=0.0, atol=1e-9
    )
    np.testing.assert_allclose(
        [item.covariance for item in received], [item.covariance for item in required],
        rtol=0.0, atol=1e-9,
    )  # fmt: skip


def test_live_equals_replay(model: Path, bag: Path) -> None:
    with running_node(model=model) as node, Listener() as listener:
        stats = finish(play(bag))
        time.sleep(1.2)
        code, spent_s = node.end(signal.SIGTERM)
    assert (code, stats["unheard"]) == (0, [])
    assert spent_s < GRACE_S + 1.0
    expected = replay_bags(model, [bag])
    assert len(expected) == len(listener.recording.received) > 390
    compare(expected, listener.recording)
    for prediction in expected[4:]:
        message = listener.horizons[prediction.origin_ns]
        rows = [
            (twist.linear.x, twist.linear.y, twist.angular.z)
            for point in message.points
            for twist in point.velocities
        ]
        np.testing.assert_allclose(rows, prediction.horizon, rtol=0.0, atol=1e-9)
    # Covariances have no stamp, but arrive in order, and the last belong to the last samples.
    tables = [np.reshape(message.data, (80, 3, 3)) for message in listener.covariances]
    assert len(expected) - 4 <= len(tables) <= len(expected)
    for table, prediction in zip(tables[::-1], expected[::-1], strict=False):
        np.testing.assert_allclose(table, prediction.horizon_covariance, rtol=0.0, atol=1e-9)
    assert listener.shown["internal_errors"] == "0"
    assert listener.shown["imu"] == "/imu"
    assert listener.shown["method"] == "windowed"
    assert int(listener.shown["predictions"]) == len(expected)


def test_live_without_imu_by_sim_time(model: Path, tmp_path: Path) -> None:
    """No IMU, and time from the player's /clock."""
    bag = write_bag(tmp_path / "bag", 6.0, Rates(imu_hz=0.0))
    with running_node(model=model, use_sim_time="true") as node, Listener() as listener:
        finish(play(bag))
        time.sleep(1.2)
        assert node.end(signal.SIGINT)[0] == 0
    compare(replay_bags(model, [bag]), listener.recording)
    assert "stamps_behind_clock_s" in listener.shown


@pytest.mark.slow
def test_looping_bag(model: Path, bag: Path) -> None:
    """The clock jumps back: the state is reset, and the second loop equals a replay as well."""
    part_s = 4.0
    with running_node(model=model) as node, Listener() as listener:
        player = play(bag, loop=True, duration_s=part_s)
        deadline_s = time.monotonic() + 60.0
        messages: set[str] = set()
        while time.monotonic() < deadline_s and "clock_jumps" not in messages:
            time.sleep(0.2)
            # At the third jump all predictions after the second one have arrived.
            if int(listener.shown.get("clock_jumps", "0")) >= 3:
                messages.add("clock_jumps")
            if "clock jumped" in listener.shown.get("message", ""):
                messages.add("reported")
        player.send_signal(signal.SIGINT)
        stats = finish(player)
        # Two signals in a row while data arrives.
        node.process.send_signal(signal.SIGINT)
        code, spent_s = node.end(signal.SIGINT)
    assert messages == {"clock_jumps", "reported"}
    assert stats["interrupted"]
    assert stats["loops"] >= 2
    assert (code, spent_s < GRACE_S + 1.0) == (0, True)
    once = replay_bags(model, [bag], part_s)
    twice = replay_bags(model, [bag, bag], part_s)
    stamps = listener.recording.stamp_ns
    rounds = np.flatnonzero(np.diff(stamps) < 0) + 1
    assert len(rounds) >= 2
    begin, end = rounds[0], rounds[1]
    second = PredictionLog("", listener.recording.received[begin:end])
    compare(twice[len(once) :], second)


def test_service_parameters_and_echo(
    model: Path, bag: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with running_node(model=model, ridge=20, method="rls", use_imu="never") as node:
        player = play(bag)
        shown = echo(count=3, every=10, as_json=True, wait_s=60.0)
        printed = [json.loads(text) for text in capsys.readouterr().out.splitlines()]
        assert [item["stamp_ns"] for item in printed] == [item.stamp_ns for item in shown.received]
        assert len(printed) == 3
        echo(duration_s=0.5, every=5, wait_s=60.0, topic="predictor/predicted_twist")
        lines = capsys.readouterr().out.splitlines()
        assert lines[0].split()[:4] == ["time", "predicted", "for", "v_x"]
        assert len(lines) >= 3
        with Session("client") as session:
            answer = call(session, Trigger, "/predictor/reset", Trigger.Request())
            assert answer.success
            request = SetParameters.Request(
                parameters=[
                    Parameter("ridge", value=3.0).to_parameter_msg(),
                    Parameter("publish_horizon", value=False).to_parameter_msg(),
                ]
            )
            fixed, live = call(
                session, SetParameters, "/predictor/set_parameters", request
            ).results
            assert not fixed.successful
            assert live.successful
            horizons: list[Any] = []
            for kind, name in (
                (MultiDOFJointTrajectory, "predicted_horizon"),
                (Float64MultiArray, "predicted_horizon_covariance"),
            ):
                session.node.create_subscription(kind, f"/predictor/{name}", horizons.append, 10)
            until = time.monotonic() + 1.0
            while time.monotonic() < until:
                session.spin(0.1)
            assert not horizons
        player.send_signal(signal.SIGTERM)
        assert finish(player)["interrupted"]
        assert node.end()[0] == 0


@pytest.mark.slow
def test_faults_and_late_simulation_time_over_real_topics(model: Path) -> None:
    """A node without a clock receives NaN, then valid data: it recovers and reports both."""
    reported: list[tuple[int, str]] = []
    with running_node(model=model, use_sim_time="true") as node, Session("sensors") as session:

        def note(array: Any) -> None:
            reported.extend((status.level[0], status.message) for status in array.status)

        session.node.create_subscription(DiagnosticArray, "/diagnostics", note, 10)
        publishers = {
            source: session.node.create_publisher(kind, source.name.lower(), 10)
            for source, kind in zip(STANDARD_SOURCES, (Imu, Odometry, JointState), strict=True)
        }
        clock = session.node.create_publisher(Clock, "/clock", 10)
        wait_for(
            session,
            lambda: all(p.get_subscription_count() for p in [*publishers.values(), clock]), 60.0,
        )  # fmt: skip

        def run(seconds: float, corrupt: bool, with_clock: bool) -> None:
            begin_ns = time.monotonic_ns()
            for step in range(round(seconds * 40)):
                while time.monotonic_ns() < begin_ns + step * 25_000_000:
                    session.spin(0.002)
                stamp_ns = 5_000_000_000 + time.monotonic_ns() - origin_ns
                wobble = 0.01 * (step % 7)
                rows = {
                    Source.IMU: (wobble, wobble, wobble),
                    Source.ODOMETRY: (float("nan") if corrupt else 10.0 + wobble, 0.0, wobble),
                    Source.COMMAND: (100.0 + wobble, wobble),
                }
                if with_clock:
                    now = Clock()
                    now.clock.sec, now.clock.nanosec = divmod(stamp_ns, 10**9)
                    clock.publish(now)
                for source, values in rows.items():
                    publishers[source].publish(message(Reading(source, stamp_ns, values)))

        origin_ns = time.monotonic_ns()
        run(2.5, corrupt=True, with_clock=False)
        assert "simulation time has not started: no /clock" in reported[-1][1]
        assert "odometry messages refused: velocity is not finite or above" in reported[-1][1]
        run(4.0, corrupt=False, with_clock=True)
        wait_for(session, lambda: reported[-1][0] == 2)
        code, spent_s = node.end()
    levels = [level for level, message in reported if not message.startswith("starting")]
    assert levels[0] in (1, 2)
    assert 0 in levels, reported
    # After the last message:
    assert reported[-1][1].startswith("no predictions: odometry timeout (")
    assert (code, spent_s < GRACE_S + 1.0) == (0, True)


@pytest.mark.parametrize(
    ("number", "delays_s"), [(signal.SIGINT, (0.7, 3.0)), (signal.SIGTERM, (1.4, 6.0))]
)
def test_signal_during_start_up(
    model: Path, number: int, delays_s: tuple[float, float], tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    """While it imports, and while it compiles all kernels; three signals are as good as one."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "empty"))
    for delay_s in delays_s:
        node = NodeProcess(model=model)
        time.sleep(delay_s)
        for _ in range(2):
            node.process.send_signal(number)
        code, spent_s = node.end(number)
        _, errors = node.process.communicate()
        assert "Traceback" not in errors
        assert code == 0
        assert spent_s < GRACE_S + 1.0


def test_start_is_reported_under_the_full_name(
    model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With an empty cache the kernels take far longer than a second to compile."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "empty"))
    seen: list[Any] = []
    with (
        running_node("-r", "__ns:=/car1", model=model) as node,
        Session("watcher") as session,
    ):
        session.node.create_subscription(
            DiagnosticArray, "/diagnostics", lambda array: seen.extend(array.status), 10
        )
        wait_for(session, lambda: len(seen) >= 2, 40.0)
        assert node.end()[0] == 0
    assert {status.name for status in seen} == {"car1/predictor: prediction"}
    assert {status.hardware_id for status in seen} == {"car1/predictor"}
    assert all(status.message.startswith("starting for ") for status in seen[:2])


def test_no_predictor_running() -> None:
    with pytest.raises(UsageError, match="no node publishes a topic predicted_twist"):
        record(wait_s=0.5)
    with pytest.raises(UsageError, match="no node publishes /elsewhere"):
        record("elsewhere", wait_s=0.5)
    with pytest.raises(UsageError, match="topic 'a b'"):
        record("a b", wait_s=0.5)
    with pytest.raises(UsageError, match="must be 1 or more"):
        echo(every=0)
