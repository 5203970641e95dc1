# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The demo: train, predict live over real topics, compare with an offline replay, score.

Three processes run as on a vehicle: the node, the player, and this one, which listens. They use
the loopback interface and a ROS domain of their own, and are ended in any case.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from adk_ros.api.output import remove_earlier_bag
from adk_ros.api.replay import ReplayResult, replay
from adk_ros.api.training import default_settings, train_model
from adk_ros.bags import Bag, BagWriter
from adk_ros.bags.recording import RecordingOptions, choose_topics
from adk_ros.cli import console
from adk_ros.errors import DataError, UsageError
from adk_ros.files.output_folder import refuse_existing
from adk_ros.offline.replay import TWIST_TOPIC, TWIST_TYPE, twist_message
from adk_ros.train.held_out import TIE

MARKER = "demo.json"
"""Identifies an earlier demo in a folder, which alone may be replaced."""

RESULTS = ("model/report.html", "predicted", "score.csv", "prediction.png", "horizon.png")
"""What the demo writes, and prints at the end."""

_STOP_TIMEOUT_S = 5.0
"""Time for a process to end after an interrupt, before it is killed."""

_PLAYER_MARGIN_S = 60.0
"""Longest time that playing may take beyond the duration of the bag."""

_SETTLE_S = 1.0
"""Time after the last message for the last predictions to arrive."""

_SHOWN_EVERY = 80
"""One of this many live predictions is printed: one every 2 s."""


def run_demo(out: Path, train_bag: Path, play_bag: Path, steps: int) -> None:
    """
    Run the demo and write model, predicted bag, score table and figures into `out`.

    :raises UsageError: a bag is missing, or `out` contains anything but an earlier demo.
    :raises DataError: a bag is unusable, or the live part failed.
    """
    for bag in (train_bag, play_bag):
        if not bag.exists():
            raise UsageError(f"{bag} does not exist: run the demo from the repository's folder")
    _claim_folder(out, train_bag, play_bag, steps)
    started = time.monotonic()
    console.note(f"1/4  training on {train_bag} ({steps} steps)")
    with console.stages() as progress:
        settings = default_settings(steps)
        model = train_model(
            train_bag, out / "model", settings=settings, force=True, progress=progress
        )
    console.note(f"2/4  starting the predictor node, playing {play_bag} to it in real time")
    live = _predict_live(model.path, play_bag)
    console.note("3/4  checking that the live predictions equal an offline replay")
    with console.stages() as progress:
        replayed = replay(play_bag, model, progress=progress)
    _compare(live, replayed, out / "predicted")
    console.note(f"4/4  scoring on {play_bag}, which was not used for training")
    _score(replayed, play_bag, out)
    console.note(f"done in {time.monotonic() - started:.0f} s")
    for name in RESULTS:
        console.note(f"  {out / name}")


def _claim_folder(out: Path, train_bag: Path, play_bag: Path, steps: int) -> None:
    """
    Create `out` and mark it as a demo's.

    :raises UsageError: `out` contains anything but an earlier demo, or cannot be written.
    """
    refuse_existing(out, force=True, result_files=(MARKER,))
    content = {"train_bag": str(train_bag), "play_bag": str(play_bag), "steps": steps}
    try:
        out.mkdir(parents=True, exist_ok=True)
        (out / MARKER).write_text(json.dumps(content | {"results": RESULTS}, indent=2) + "\n")
    except OSError as error:
        raise UsageError(f"{out} cannot be written: {error.strerror}") from None


def _environment() -> dict[str, str]:
    """Restrict ROS to the loopback and a domain that a robot nearby is unlikely to use."""
    restricted = {
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_DOMAIN_ID": os.environ.get("ROS_DOMAIN_ID", str(1 + os.getpid() % 100)),
    }
    os.environ.update(restricted)
    return dict(os.environ)


@contextmanager
def _process(arguments: list[str], environment: dict[str, str]) -> Iterator[subprocess.Popen[str]]:
    """Run a Python module in a separate process, and interrupt it at the end."""
    process = subprocess.Popen(
        [sys.executable, "-m", *arguments],
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        yield process
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
            try:
                process.wait(_STOP_TIMEOUT_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def _predict_live(model: Path, bag: Path) -> dict[int, tuple[float, ...]]:
    """
    Play `bag` to the live node and return its predictions.

    :return: stamp in ns -> predicted state in SI units.
    :raises DataError: the node or the player failed, or no prediction arrived.
    """
    environment = _environment()
    from adk_ros.ros.echo import ReceivedPrediction, header, line, listen

    with Bag(bag) as opened:
        topics = choose_topics(opened, RecordingOptions())
        duration_s = opened.duration_s
    used = {"odometry": topics.odometry, "command": topics.command, "imu": topics.imu}
    remaps = {name: topic for name, topic in used.items() if topic}
    node_arguments = ["adk_ros.ros.node", "--ros-args", "-p", f"model:={model.resolve()}"]
    for name, topic in remaps.items():
        node_arguments += ["-r", f"{name}:={topic}"]
    play_arguments = ["adk_ros.cli.main", "play", str(bag)]
    received: dict[int, tuple[float, ...]] = {}

    def on_prediction(prediction: ReceivedPrediction) -> None:
        if len(received) % _SHOWN_EVERY == 0:
            console.output.print(line(prediction), markup=False)
        received[prediction.stamp_ns] = prediction.x

    with _process(node_arguments, environment) as node:
        player: list[subprocess.Popen[str]] = []
        ended = threading.Event()

        def play(_: str) -> None:
            console.output.print(header(), markup=False)

            def run() -> None:
                with _process(play_arguments, environment) as process:
                    player.append(process)
                    process.wait(duration_s + _PLAYER_MARGIN_S)
                time.sleep(_SETTLE_S)
                ended.set()

            threading.Thread(target=run, daemon=True).start()

        listen(
            on_prediction,
            TWIST_TOPIC,
            wait_s=60.0,
            on_ready=play,
            until=lambda: ended.is_set() or node.poll() is not None,
        )
        if node.poll() is not None:
            raise DataError(f"the node stopped: {_last_line(node)}")
        if player and player[0].returncode:
            raise DataError(f"playing failed: {_last_line(player[0])}")
    if not received:
        raise DataError("the node published no prediction: see 'adk play --help' for topics")
    if node.returncode != 0:
        raise DataError(f"the node did not end cleanly: exit code {node.returncode}")
    return received


def _last_line(process: subprocess.Popen[str]) -> str:
    """Return the last line that a process wrote on stderr."""
    written = process.stderr.read() if process.stderr else ""
    return next(reversed(written.strip().splitlines()), "no message")


def _compare(live: dict[int, tuple[float, ...]], replayed: ReplayResult, out: Path) -> None:
    """Print how much the live predictions differ from the replay; write them as a bag."""
    predictions = replayed.predictions
    both = [p for p in predictions if p.stamp_ns in live]
    differences = [float(np.abs(np.array(live[p.stamp_ns]) - p.x).max()) for p in both]
    largest = max(differences, default=float("nan"))
    if len(both) == len(predictions) == len(live) and largest == 0.0:
        console.note(f"     all {len(live)} live predictions are identical to the replay's")
    else:
        console.note(
            f"     {len(live)} live predictions, of which {len(both)} are among the replay's "
            f"{len(predictions)}; largest difference {largest:.1e}"
        )
    remove_earlier_bag(out)
    with BagWriter(out, "mcap", "zstd") as writer:
        writer.add_topic(TWIST_TOPIC, TWIST_TYPE)
        for p in both:
            received = p._replace(x=np.array(live[p.stamp_ns]))
            writer.write(TWIST_TOPIC, twist_message(received), p.origin_ns)


def _score(replayed: ReplayResult, bag: Path, out: Path) -> None:
    """
    Print the score table and a summary; write table and figures, in SI units.

    :raises DataError: the bag has no stretch of 2 s without gaps.
    """
    from adk_ros.train.report_figures import SI_UNITS, horizon_figure, prediction_figure

    scores = replayed.held_out
    if scores is None:
        raise DataError(f"{bag} has no stretch of 2 s without gaps: nothing to score")
    prediction_figure(scores, out / "prediction.png", units=SI_UNITS)
    horizon_figure(scores, out / "horizon.png", units=SI_UNITS)
    scores.write_csv(out / "score.csv")
    console.print_scores(scores, f"RMSE on {bag.name}")
    # The first row is one step ahead, which does not depend on future commands.
    better, better_held = (
        int((ratio[1:] < TIE).sum()) for ratio in (scores.ratio, scores.ratio_held)
    )
    total = int(np.isfinite(scores.ratio[1:]).sum())
    console.note(
        f"better than every naive predictor in {better} of {total} (channel, horizon) "
        f"combinations from 0.25 to 2 s (without the 0.025 s rows) with future commands known, in "
        f"{better_held} of {total} with commands held constant"
    )
