# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The first five minutes: train, predict live over real topics, compare, draw.

Three processes, as on a vehicle: the node, the player, and this one, which listens. All run on the
loopback, in a ROS domain of their own, and are ended whatever happens.
"""

from __future__ import annotations

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

from adk_ros.bags import Bag, BagWriter
from adk_ros.bags.recording import RecordingOptions, choose_topics, read_recording
from adk_ros.cli import console
from adk_ros.errors import DataError, UsageError
from adk_ros.model import artefact
from adk_ros.model.pipeline import Pipeline
from adk_ros.offline.replay import TWIST_TOPIC, TWIST_TYPE, predictions, twist_message
from adk_ros.train.held_out import TIE, HeldOutScores, TrainingDomain, score_held_out
from adk_ros.train.network_fit import Step

_END_S = 5.0


def run_demo(out: Path, train_bag: Path, play_bag: Path, steps: int) -> None:
    """
    Do all of it, writing into `out`: model, predicted bag, score table, figures.

    :raises UsageError, DataError: a bag is missing or unfit, or the live part failed.
    """
    for bag in (train_bag, play_bag):
        if not bag.exists():
            raise UsageError(f"{bag} does not exist: run the demo from the repository's folder")
    started = time.monotonic()
    model = out / "model"
    console.note(f"1/4  training on {train_bag} ({steps} steps)")
    _train(train_bag, model, steps)
    console.note(f"2/4  starting the predictor node, playing {play_bag} to it in real time")
    live = _live(model, play_bag)
    console.note("3/4  comparing what was published with an offline replay")
    _compare(live, model, play_bag, out / "predicted")
    console.note(f"4/4  scoring on {play_bag}, which the model has never seen")
    test = _score(model, play_bag, out)
    console.show_test(test, f"RMSE on {play_bag.name}, commands known")
    known, held = (int((r[1:] < TIE).sum()) for r in (test.ratio, test.ratio_held))
    console.note(
        f"of {test.ratio[1:].size} cells from 0.25 to 2 s, {known} are better than the best naive "
        f"predictor's given the commands, {held} with the commands held; "
        f"done in {time.monotonic() - started:.0f} s"
    )
    for name in ("model/report.html", "predicted", "score.csv", "prediction.png", "horizon.png"):
        console.note(f"  {out / name}")


def _train(bag: Path, model: Path, steps: int) -> None:
    from adk_ros.train.train_settings import TrainSettings
    from adk_ros.train.training_report import write_report
    from adk_ros.train.training_run import run_training

    record = read_recording(bag).record
    settings = TrainSettings(steps=steps, validate_every=max(1, steps // 10))
    with console.progress("training") as bar, console.progress("tuning") as after:

        def on_step(step: Step) -> None:
            bar(step.step, step.steps, f"loss {step.loss:.4f}")

        def on_note(what: str, done: int, total: int) -> None:
            after(done, total, what)

        run = run_training([record], model, settings, on_step=on_step, note=on_note)
    write_report(run, model)


def _environment() -> dict[str, str]:
    """Loopback alone, and a domain that a robot on the same machine is unlikely to use."""
    own = {
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_DOMAIN_ID": os.environ.get("ROS_DOMAIN_ID", str(1 + os.getpid() % 100)),
    }
    os.environ.update(own)
    return dict(os.environ)


@contextmanager
def _process(arguments: list[str], environment: dict[str, str]) -> Iterator[subprocess.Popen[str]]:
    """Run a Python module beside us; interrupt it, and only it, at the end."""
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
                process.wait(_END_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def _live(model: Path, bag: Path) -> dict[int, tuple[float, ...]]:
    """Play `bag` to the live node; return what it published: stamp in ns -> state."""
    environment = _environment()
    from adk_ros.ros.echo import ReceivedPrediction, header, line, listen

    with Bag(bag) as opened:
        topics = choose_topics(opened, RecordingOptions())
        seconds = opened.duration_s
    remaps = {"odometry": topics.odometry, "command": topics.command}
    if topics.imu:
        remaps["imu"] = topics.imu
    node_arguments = ["adk_ros.ros.node", "--ros-args", "-p", f"model:={model.resolve()}"]
    for name, topic in remaps.items():
        node_arguments += ["-r", f"{name}:={topic}"]
    play_arguments = ["adk_ros.cli.main", "play", str(bag)]
    heard: dict[int, tuple[float, ...]] = {}

    def hear(prediction: ReceivedPrediction) -> None:
        if len(heard) % 80 == 0:
            console.output.print(line(prediction), markup=False)
        heard[prediction.stamp_ns] = prediction.x

    with _process(node_arguments, environment) as node:
        player: list[subprocess.Popen[str]] = []
        ended = threading.Event()

        def play(_: str) -> None:
            console.output.print(header(), markup=False)

            def run() -> None:
                with _process(play_arguments, environment) as process:
                    player.append(process)
                    process.wait(seconds + 60.0)
                time.sleep(1.0)
                ended.set()

            threading.Thread(target=run, daemon=True).start()

        listen(
            hear,
            TWIST_TOPIC,
            wait_s=60.0,
            on_ready=play,
            until=lambda: ended.is_set() or node.poll() is not None,
        )
        if node.poll() is not None:
            said = node.stderr.read() if node.stderr else ""
            raise DataError(f"the node ended on its own: {said.strip().splitlines()[-1:]}")
        if player and player[0].returncode:
            said = player[0].stderr.read() if player[0].stderr else ""
            raise DataError(f"playing failed: {said.strip().splitlines()[-1:]}")
    if not heard:
        raise DataError("the node published no prediction: see 'adk play --help' for topics")
    if node.returncode != 0:
        raise DataError(f"the node did not end cleanly: exit code {node.returncode}")
    return heard


def _compare(live: dict[int, tuple[float, ...]], model: Path, bag: Path, out: Path) -> None:
    """Say how far live and replay differ, and write what was heard live as a bag."""
    pipeline = Pipeline(artefact.load(model).model)
    with Bag(bag) as opened:
        replayed = [p for _, p in predictions(opened, pipeline, RecordingOptions())]
    both = [p for p in replayed if p.stamp_ns in live]
    differences = [float(np.abs(np.array(live[p.stamp_ns]) - p.x).max()) for p in both]
    console.note(
        f"     {len(live)} predictions heard, {len(both)} of {len(replayed)} of the replay's "
        f"ticks; largest difference {max(differences, default=float('nan')):.1e}"
    )
    if out.exists():
        for file in out.iterdir():
            file.unlink()
        out.rmdir()
    with BagWriter(out, "mcap", "zstd") as writer:
        writer.add_topic(TWIST_TOPIC, TWIST_TYPE)
        for p in both:
            heard = p._replace(x=np.array(live[p.stamp_ns]))
            writer.write(TWIST_TOPIC, twist_message(heard), p.origin_ns)


def _score(model: Path, bag: Path, out: Path) -> HeldOutScores:
    from adk_ros.train.report_figures import horizon_figure, prediction_figure

    with console.progress("scoring") as bar:
        loaded = artefact.load(model)
        known = TrainingDomain.from_json(loaded.manifest["training"].get("range"))
        test = score_held_out(
            loaded.model, [(read_recording(bag).record, None)], known, progress=bar
        )
    if test is None:
        raise DataError(f"{bag} has no stretch of 2 s without a gap: nothing to score")
    prediction_figure(test, out / "prediction.png")
    horizon_figure(test, out / "horizon.png")
    test.write_csv(out / "score.csv")
    return test
