# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What every test runs under, set before anything reads it.

The children that tests start inherit all of it.
"""

import gc
import os
import tempfile
from collections import Counter
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest
from helpers import shared
from hypothesis import settings

# Two cores at most are to be expected, and results must not depend on how sums are split.
for variable in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[variable] = "1"

os.environ["MPLBACKEND"] = "Agg"

# A domain for each run and each of its workers, this machine only: neither another run nor a robot
# answers. Domains above 101 meet the ports that Linux hands out.
IS_WORKER = "PYTEST_XDIST_WORKER" in os.environ
worker = os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw")
run = os.getppid() if IS_WORKER else os.getpid()
os.environ["ROS_DOMAIN_ID"] = str(1 + (4 * run + int(worker)) % 100)
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ.pop("ROS_STATIC_PEERS", None)
# rclpy.init refuses to start without a place for its log, see also `pytest_configure`.
os.environ.setdefault("HOME", tempfile.gettempdir())

# The same examples each time: a failure that comes and goes says nothing about a change.
settings.register_profile("adk_ros", derandomize=True, deadline=None, database=None)
settings.load_profile("adk_ros")

SLOW_S = 10
"""s that a slow test takes if its mark says nothing else."""
FIRST = "test/cli/test_info.py"
"""A short file whose tests train the model that other files use."""


@pytest.fixture
def unshrunk(monkeypatch: pytest.MonkeyPatch) -> None:
    """Predict as the model and the trained weights do, whatever earlier horizons were worth."""
    from adk_ros.model.uncertainty.published_horizons import PublishedHorizonErrors
    from adk_ros.model.uncertainty.rollout_monitor import RolloutMonitor

    monkeypatch.setattr(
        "adk_ros.model.predictor.PublishedHorizonErrors",
        partial(PublishedHorizonErrors, shrinks=False),
    )
    monkeypatch.setattr(
        "adk_ros.model.initial_errors.RolloutMonitor",
        partial(RolloutMonitor, learns_weights=False),
    )


@pytest.fixture
def unrendered(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw figures but do not render them, where a test is about texts and files."""
    from matplotlib.figure import Figure
    from PIL import Image

    def save(_: Figure, path: Path, **options: object) -> None:
        Image.new("RGB", (1, 1)).save(path)

    monkeypatch.setattr(Figure, "savefig", save)


@pytest.fixture(scope="module")
def one_candidate() -> Iterator[None]:
    """Train with one candidate for each hyperparameter, where a test is not about selecting."""
    from helpers.train import leave_one_candidate

    with pytest.MonkeyPatch.context() as patch:
        leave_one_candidate(patch)
        yield


def pytest_configure(config: pytest.Config) -> None:
    """Create the shared folder, and keep the order of `pytest_collection_modifyitems`."""
    if not IS_WORKER:
        folder = shared.create()
        os.environ.setdefault("ROS_LOG_DIR", str(folder / "ros_log"))
        if hasattr(config.option, "loadscopereorder"):
            config.option.loadscopereorder = False


def pytest_unconfigure() -> None:
    """Remove the shared folder; the workers have ended."""
    if not IS_WORKER:
        shared.remove()


# Collection makes a million objects that all stay: looking for rubbish among them takes 6 s.
gc.disable()


def pytest_collection_finish() -> None:
    """Collect rubbish from now on, but not among what the collection has made."""
    gc.freeze()
    gc.enable()


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """
    Order the files so that no worker waits for a model that another is training.

    First a file that trains the model, then the files that need none, then those that do. Within
    each, files that take long come first, so that the workers end at about the same time: those
    with many tests, and slow tests by their `seconds`, if the mark gives any.
    """
    files = [item.nodeid.partition("::")[0] for item in items]
    seconds: Counter[str] = Counter()
    for file, item in zip(files, items, strict=True):
        slow = item.get_closest_marker("slow")
        seconds[file] += 1 if slow is None else slow.kwargs.get("seconds", SLOW_S)

    def rank(file: str, item: pytest.Item) -> tuple[bool, bool, int]:
        module = item.getparent(pytest.Module)
        return file != FIRST, module is not None and hasattr(module.obj, "small"), -seconds[file]

    ranks = dict(zip(items, map(rank, files, items), strict=True))
    items.sort(key=lambda item: ranks[item])
