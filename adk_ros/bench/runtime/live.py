# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Live latency and CPU load of the node: sensors, node, listener, and a relay to compare with.

Each is a process of its own, connected by Fast DDS on this machine.

The latency of a prediction runs from the publication of the last input that it needs to its
arrival in the listener's callback. The aligner, fed with the published messages in their order,
tells which reading completes a tick. CLOCK_MONOTONIC is shared by all processes of a machine, so
times of different processes may be subtracted. The tick time is the node's: from the message
that completes a tick to its last output. The relay receives and republishes the same messages.

The listener also subscribes to the horizon, without decoding it: the node serialises what is
subscribed to alone, and a planner reads the horizon.
"""

from __future__ import annotations

import gc
import importlib.util
import select
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import psutil  # type: ignore[import-untyped, unused-ignore]
from numpy.typing import NDArray

from adk_ros.bench.paper.criterion import Criterion
from adk_ros.bench.runtime.ros_processes import cpu_seconds, last_error, start_process
from adk_ros.errors import DataError, UsageError
from adk_ros.signals.align import Aligner
from adk_ros.signals.channels import TICK_NS, Reading, Source

TARGET_P99_MS = 5.0
"""Required 99th percentile of the latency, ms: a fifth of the 25 ms tick."""
TARGET_CPU_PERCENT = 6.0
"""Required CPU load of the node, per cent of one core, with the IMU at 200 Hz. By choice."""
TARGET_TICK_MS = 0.4
"""Required median of the tick's processing time, ms: a third of what it took before the encoder
was compiled."""
TARGET_CPU_RATIO = 2.0
"""Required CPU load of the node in loads of the relay. By choice."""
MIN_DURATION_S, MAX_DURATION_S = 1.0, 86_400.0
MIN_IMU_HZ, MAX_IMU_HZ = 1.0, 2000.0
_WARM_UP_S = 3.0
"""Time before the measurement in which kernels compile and caches fill, s."""
_TIMEOUT_S = 60.0
_START_S = 900.0
"""Longest wait for the node, which compiles at its first start. By choice."""
MODULE = "adk_ros.bench.runtime.live"
"""Runs the parts of the measurement: `drive`, `listen`, `relay`."""


def check_live(duration_s: float, imu_hz: float) -> None:
    """
    Check the options and the installation, without doing any work.

    :raises UsageError: a value out of range, or ROS 2 is not installed.
    """
    if not MIN_DURATION_S <= duration_s <= MAX_DURATION_S:
        raise UsageError(
            f"--duration {duration_s:g} is out of range: choose {MIN_DURATION_S:g} to"
            f" {MAX_DURATION_S:g} s"
        )
    if not MIN_IMU_HZ <= imu_hz <= MAX_IMU_HZ:
        raise UsageError(
            f"--imu-hz {imu_hz:g} is out of range: choose {MIN_IMU_HZ:g} to {MAX_IMU_HZ:g} Hz"
        )
    if importlib.util.find_spec("rclpy") is None:
        raise UsageError(
            "adk bench live runs the ROS 2 node, and rclpy is not installed:"
            " run `make install`, or source your ROS 2 installation"
        )


def bench_live(
    model: Path | str,
    duration_s: float = 60.0,
    imu_hz: float = 200.0,
    odometry_hz: float = 50.0,
    command_hz: float = 40.0,
    *,
    method: str = "",
    progress: Callable[[float, float], None] | None = None,
) -> dict[str, Any]:
    """
    Measure the node for `duration_s` after a warm-up of 3 s; the result can be written as JSON.

    `latency_ms` has p50, p99 and max; `tick_p50_ms` the processing time within the node; `ticks`,
    `ticks_missed` (completed by the sensors, but never predicted), `cpu_percent` of one core, of
    the relay `relay_cpu_percent`, and `cpu_ratio` of the two; `horizons` received;
    `memory_growth_mb`; `criteria` with verdict, name and figure; and under `node` the values of
    the node's own diagnostics.
    :param progress: called about ten times a second with (seconds done, seconds in all).
    :raises UsageError: as `check_live`.
    :raises DataError: the node did not start, or a part of the measurement failed.
    """
    check_live(duration_s, imu_hz)
    total_s = duration_s + _WARM_UP_S
    rates = [str(total_s), str(imu_hz), str(odometry_hz), str(command_hz)]
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="adk_bench_")))
        arguments = ["--ros-args", "-p", f"model:={model}"]
        if method:
            arguments += ["-p", f"method:={method}"]
        node = start_process(stack, folder, "adk_ros.ros.node", *arguments)
        listener = start_process(stack, folder, MODULE, "listen", str(folder / "received.npz"))
        relay = start_process(stack, folder, MODULE, "relay")
        sent_path = str(folder / "sent.npz")
        traffic = start_process(stack, folder, MODULE, "drive", sent_path, "2", *rates)
        await_line(traffic, "started", node, folder)
        cpu_percent, relay_percent, grown_mb = _watch(node, relay, duration_s, progress)
        if traffic.wait(_TIMEOUT_S) or node.poll() is not None or relay.poll() is not None:
            raise DataError(f"the measurement failed: {last_error(folder)}")
        time.sleep(1.5)
        listener.terminate()
        if listener.wait(_TIMEOUT_S):
            raise DataError(f"the listener failed: {last_error(folder)}")
        sent, received = np.load(sent_path), np.load(folder / "received.npz")
        result = _evaluate(sent, received, round(_WARM_UP_S * 1e9))
    result["tick_p50_ms"] = round(1e-3 * float(result["node"].get("tick_p50_us", "nan")), 3)
    result["cpu_percent"] = round(cpu_percent, 2)
    result["relay_cpu_percent"] = round(relay_percent, 2)
    result["cpu_ratio"] = round(cpu_percent / relay_percent, 2)
    result["memory_growth_mb"] = round(grown_mb, 2)
    result["duration_s"] = duration_s
    result["rates_hz"] = {"imu": imu_hz, "odometry": odometry_hz, "command": command_hz}
    return result | {"criteria": [vars(item) for item in live_criteria(result)]}


def live_criteria(result: dict[str, Any]) -> list[Criterion]:
    """Judge the figures of `bench_live`; one that is not a number is a FAIL."""
    p99_ms, missed = result["latency_ms"]["p99"], result["ticks_missed"]
    tick_ms, percent, ratio = (result[x] for x in ("tick_p50_ms", "cpu_percent", "cpu_ratio"))
    return [
        Criterion.judged(
            p99_ms <= TARGET_P99_MS, "latency", f"{p99_ms:g} ms (p99), at most {TARGET_P99_MS:g}"
        ),
        Criterion.judged(missed == 0, "ticks-missed", f"{missed} of {result['ticks']}, at most 0"),
        Criterion.judged(
            tick_ms <= TARGET_TICK_MS,
            "tick-time",
            f"{tick_ms:g} ms (p50), at most {TARGET_TICK_MS:g}",
        ),
        Criterion.judged(
            percent <= TARGET_CPU_PERCENT,
            "cpu",
            f"{percent:g} % of a core with the IMU at {result['rates_hz']['imu']:g} Hz, at most "
            f"{TARGET_CPU_PERCENT:g}",
        ),
        Criterion.judged(
            ratio <= TARGET_CPU_RATIO,
            "cpu-ratio",
            f"{ratio:g} times the load of a node that receives and republishes the same "
            f"messages ({result['relay_cpu_percent']:g} %), at most {TARGET_CPU_RATIO:g}",
        ),
    ]


def await_line(
    process: subprocess.Popen[str], wanted: str, node: subprocess.Popen[str], folder: Path
) -> None:
    """
    Wait until a process writes a line; `node`: the process of the node.

    :raises DataError: one of the two has ended.
    """
    assert process.stdout is not None
    while node.poll() is None:
        if select.select([process.stdout], [], [], 0.2)[0]:
            line = process.stdout.readline()
            if line.strip() == wanted:
                return
            if not line:
                raise DataError(f"the simulated sensors found no node: {last_error(folder)}")
    raise DataError(f"the node ended with exit code {node.returncode}: {last_error(folder)}")


def _watch(
    node: subprocess.Popen[str],
    relay: subprocess.Popen[str],
    duration_s: float,
    progress: Callable[[float, float], None] | None,
) -> tuple[float, float, float]:
    """Return the CPU loads of node and relay, per cent of a core, and the node's growth in MB."""
    processes = psutil.Process(node.pid), psutil.Process(relay.pid)
    time.sleep(_WARM_UP_S)
    begin_s, before_s = time.monotonic(), [cpu_seconds(process) for process in processes]
    rss_before = processes[0].memory_info().rss
    while (done_s := time.monotonic() - begin_s) < duration_s - 0.2:
        if progress is not None:
            progress(done_s, duration_s)
        time.sleep(0.1)
    elapsed_s = time.monotonic() - begin_s
    loads = [
        100.0 * (cpu_seconds(process) - spent_s) / elapsed_s
        for process, spent_s in zip(processes, before_s, strict=True)
    ]
    grown_mb = (processes[0].memory_info().rss - rss_before) * 1e-6
    return loads[0], loads[1], float(grown_mb)


def _evaluate(sent: Any, received: Any, warm_up_ns: int) -> dict[str, Any]:
    """Return the statistics of the messages sent and the predictions received."""
    from_ns = int(sent["stamp_ns"][0]) + warm_up_ns
    latencies_ms, missed = latencies(
        sent["source"],
        sent["stamp_ns"],
        sent["values"],
        sent["published_ns"],
        dict(zip(received["stamp_ns"].tolist(), received["arrival_ns"].tolist(), strict=True)),
        from_ns,
    )
    if not len(latencies_ms):
        raise DataError("no prediction arrived at the listener")
    measured = sent["stamp_ns"] >= from_ns
    published_ns, arrived_ns = sent["published_ns"][measured], received["horizon_ns"]
    # After the last message, the node goes on for a second without measurements.
    horizons = int(((arrived_ns >= published_ns[0]) & (arrived_ns <= published_ns[-1])).sum())
    if not horizons:
        raise DataError("no horizon arrived at the listener")
    p50, p99, worst = np.percentile(latencies_ms, (50, 99, 100)).round(3).tolist()
    pauses_ns = np.diff(published_ns)
    diagnostics = dict(zip(received["keys"].tolist(), received["shown"].tolist(), strict=True))
    kept = ("tick_p50_us", "tick_p99_us", "tick_max_us", "missed_deadlines", "internal_errors")
    return {
        "latency_ms": {"p50": p50, "p99": p99, "max": worst},
        "ticks": len(latencies_ms) + missed,
        "ticks_missed": missed,
        "horizons": horizons,
        "messages": len(sent["stamp_ns"]),
        "longest_pause_of_the_sensors_ms": round(float(pauses_ns.max()) * 1e-6, 3),
        "node": {key: float(diagnostics[key]) for key in kept if key in diagnostics},
    }


def latencies(
    source: NDArray[np.int64],
    stamp_ns: NDArray[np.int64],
    values: NDArray[np.float64],
    published_ns: NDArray[np.int64],
    arrived_ns: dict[int, int],
    from_ns: int,
) -> tuple[NDArray[np.float64], int]:
    """
    Return the latencies, ms, and the number of ticks from `from_ns` on without a prediction.

    :param source: of the published messages (n,), in order of publication; so the next three.
    :param arrived_ns: time predicted for -> monotonic time of arrival, both ns.
    """
    aligner = Aligner()
    found, missed = [], 0
    for row in range(len(source)):
        kind = Source(int(source[row]))
        width = 2 if kind is Source.COMMAND else 3
        reading = Reading(kind, int(stamp_ns[row]), tuple(values[row, :width].tolist()))
        for sample in aligner.push(reading):
            if sample.stamp_ns < from_ns:
                continue
            arrival_ns = arrived_ns.get(sample.stamp_ns + TICK_NS)
            if arrival_ns is None:
                missed += 1
            else:
                found.append((arrival_ns - int(published_ns[row])) * 1e-6)
    return np.array(found), missed


def _drive(path: str, subscribers: str, *rates: str) -> None:
    from adk_ros.ros.traffic import Rates, publish_synthetic_sensors

    duration_s, *hz = (float(rate) for rate in rates)
    sent = publish_synthetic_sensors(
        duration_s,
        Rates(*hz),
        wait_s=_START_S,
        subscribers=int(subscribers),
        on_start=lambda: print("started", flush=True),
    )
    values = np.full((len(sent), 3), np.nan)
    for row, item in enumerate(sent):
        values[row, : len(item.reading.values)] = item.reading.values
    np.savez(
        path,
        source=[int(item.reading.source) for item in sent],
        stamp_ns=[item.reading.stamp_ns for item in sent],
        published_ns=[item.published_ns for item in sent],
        values=values,
    )


def _listen(path: str) -> None:
    from adk_ros.ros.echo import record, time_horizons, watch_diagnostics

    shown: dict[str, str] = {}
    horizon_ns: list[int] = []

    def subscribe(node: Any) -> None:
        watch_diagnostics(node, shown)
        time_horizons(node, "/predictor", horizon_ns)

    recording = record(wait_s=_START_S, on_node=subscribe)
    np.savez(
        path,
        stamp_ns=recording.stamp_ns,
        arrival_ns=recording.arrival_ns,
        horizon_ns=np.array(horizon_ns, dtype=np.int64),
        keys=list(shown),
        shown=list(shown.values()),
    )


def _relay() -> None:
    from adk_ros.ros.relay import relay_sensors

    relay_sensors()


if __name__ == "__main__":
    # Garbage collection in the measuring processes must not count as the node's latency.
    gc.disable()
    parts: dict[str, Callable[..., None]] = {"drive": _drive, "listen": _listen, "relay": _relay}
    parts[sys.argv[1]](*sys.argv[2:])
