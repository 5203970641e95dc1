# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Baseline libraries pykoop and pykoopman as predictors of the tables, in a separate environment.

Their requirements conflict with those of adk_ros, so `make peers` creates an environment for them.
`baseline_library_worker.py` runs there as a process that is fitted once and then queried. Training
data are the same as for all predictors: the contiguous learnable samples.
"""

from __future__ import annotations

import contextlib
import os
import selectors
import subprocess
import tempfile
import time
import weakref
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from adk_ros.bench.paper.last_readings import predict_from_new_readings
from adk_ros.errors import DataError, UsageError
from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.signals.channels import Record

VARIABLE = "ADK_PEERS_PYTHON"
PEERS = ("pykoop", "pykoopman")
WORKER = Path(__file__).with_name("baseline_library_worker.py")
TIMEOUT_S = 900.0
MIN_STRETCH = 20
"""Samples of the shortest segment that is used as a training episode (0.5 s)."""
TRUSTED = 1e-6
"""Largest difference between a batch prediction and that of the library's own function, in
standard deviations of the channel: far above rounding, far below any error."""

_PAST = 2
"""Past samples that the libraries are given as delays, as in the worker."""
_ENVIRONMENT = Path(".venv-peers", "bin", "python")
_SOURCE_FOLDER = Path(__file__).resolve().parents[3]
_ONE_THREAD = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL")}


def find_python(given: str | Path | None = None) -> Path:
    """
    Return the Python of the baseline libraries: `given`, ADK_PEERS_PYTHON, or of `make peers`.

    :raises UsageError: there is none.
    """
    named = given or os.environ.get(VARIABLE)
    places = [Path(named)] if named else [_SOURCE_FOLDER / _ENVIRONMENT, Path.cwd() / _ENVIRONMENT]
    for place in places:
        # Not resolved: Python finds its environment by the path of the link.
        if os.access(place, os.X_OK) and place.is_file():
            return place.absolute()
    where = f"{named} is not an executable" if named else "there is no .venv-peers"
    raise UsageError(
        f"the baseline libraries need a separate environment and {where}: run `make peers`, or"
        f" set {VARIABLE} to its Python"
    )


@dataclass(frozen=True)
class Peer:
    """
    One fitted library; `settings`: hyperparameters selected on the last part of the training data.

    `check`: largest difference between its batch predictions and those of the library's own
    function, in standard deviations of the channels.
    """

    name: str
    settings: str
    check: float
    _worker: Worker

    def predict(self, record: Record, rows: IntArray, ahead: int) -> FloatArray:
        """As `BenchPredictor.predict`; NaN where there are not two past samples."""
        return predict_from_new_readings(
            record,
            rows,
            ahead,
            lambda _, starts, steps: self._predicted(record, starts, steps),
            past=_PAST,
        )

    def _predicted(self, record: Record, rows: IntArray, ahead: int) -> FloatArray:
        """Return what the worker predicts from `rows`, (n, ahead, 3)."""
        answer = self._worker.ask(
            peer=np.array(self.name),
            x=record.x,
            u=record.u,
            episode=record.episode,
            rows=rows,
            ahead=np.array(ahead),
        )
        predicted = np.asarray(answer.get("predicted"), dtype=np.float64)
        if predicted.shape != (rows.shape[0], ahead, 3):
            raise DataError(
                f"{self.name}: the worker returned an array of shape {predicted.shape} for"
                f" {rows.shape[0]} rows and {ahead} steps"
            )
        return predicted


_POLL_S = 1.0
"""s; interval at which a thread that waits for a reply sees that another has closed the worker: no
event comes from a pipe that is closed."""


@dataclass(frozen=True)
class WorkerNames:
    """What messages call the code that a worker runs, and how its environment is made."""

    code: str = "the baseline libraries"
    remedy: str = "run `make peers`"


class Worker:
    """Process in the other environment that exchanges requests and answers as files."""

    def __init__(
        self,
        python: Path,
        script: Path,
        timeout_s: float,
        scratch: Path | None = None,
        names: WorkerNames = WorkerNames(),
    ) -> None:
        self._timeout_s = timeout_s
        self._names = names
        self._folder = tempfile.TemporaryDirectory(prefix="adk_peers_", dir=scratch)
        self._log = Path(self._folder.name, "log")
        with self._log.open("wb") as log:
            # Isolated from PYTHONPATH and from packages of the user.
            self._process = subprocess.Popen(
                [str(python), "-I", str(script)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=log,
                env=os.environ | _ONE_THREAD,
            )
        self._end = weakref.finalize(self, _end, self._process, self._folder)

    def close(self) -> None:
        """End the process; later requests fail."""
        self._end()

    def ask(self, **job: Any) -> dict[str, Any]:
        """
        Return the answer to a job.

        :raises UsageError: the environment is incomplete, or the process is closed.
        :raises DataError: the worker failed, or took too long.
        """
        if not self._end.alive:
            raise UsageError(f"{self._names.code} were closed: fit them again")
        source, target = (Path(self._folder.name, name) for name in ("job.npz", "answer.npz"))
        np.savez(source, **job)
        target.unlink(missing_ok=True)
        status = self._exchange(f"{source}\t{target}\n")
        if status == "done" and target.is_file():
            with np.load(target) as answer:
                return dict(answer)
        reason = status.removeprefix("failed ") or self._last_error()
        if not status or reason.startswith(("ImportError", "ModuleNotFoundError")):
            self.close()
            raise UsageError(
                f"the environment of {self._names.code} is broken ({reason}): {self._names.remedy}"
            )
        raise DataError(f"{self._names.code} failed: {reason}")

    def _exchange(self, line: str) -> str:
        """Return the worker's reply to a line; "" if it has ended."""
        pipe_in, pipe_out = self._process.stdin, self._process.stdout
        assert pipe_in is not None
        assert pipe_out is not None
        try:
            pipe_in.write(line.encode())
            pipe_in.flush()
        except BrokenPipeError:
            return ""
        with selectors.DefaultSelector() as selector:
            selector.register(pipe_out, selectors.EVENT_READ)
            # The reply is one short line, which arrives as a whole.
            end_s = time.monotonic() + self._timeout_s
            while not selector.select(min(_POLL_S, max(end_s - time.monotonic(), 0.0))):
                if not self._end.alive:
                    return ""
                if time.monotonic() >= end_s:
                    self.close()
                    raise DataError(
                        f"{self._names.code} took more than {self._timeout_s:g} s and were stopped"
                    )
        return pipe_out.readline().decode(errors="replace").strip()

    def _last_error(self) -> str:
        lines = self._log.read_text(errors="replace").split("\n") if self._log.is_file() else []
        return next(
            (line for line in reversed(lines) if line.strip()), "it ended without a message"
        )


def _end(process: subprocess.Popen[bytes], folder: tempfile.TemporaryDirectory[str]) -> None:
    process.kill()
    process.wait()
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            with contextlib.suppress(BrokenPipeError):
                pipe.close()
    folder.cleanup()


class Peers:
    """
    Both libraries, fitted: `predictors`. A context manager that ends the process on exit.

    :param train: training records, at least one with `MIN_STRETCH` contiguous samples.
    :param python: Python of the libraries; see `find_python`.
    :param scratch: folder for temporary files; None: the one of the system.
    :raises UsageError: the environment is missing or broken.
    :raises DataError: no usable training data, a library fails, or its batch predictions differ
        from those of its function.
    """

    def __init__(
        self,
        train: Sequence[Record],
        python: str | Path | None = None,
        *,
        names: Sequence[str] = PEERS,
        worker: Path = WORKER,
        timeout_s: float = TIMEOUT_S,
        scratch: Path | None = None,
    ) -> None:
        x, u, episode = stretches(train)
        self._worker = Worker(find_python(python), worker, timeout_s, scratch)
        try:
            answer = self._worker.ask(peers=np.array(names), x=x, u=u, episode=episode)
            self.predictors = [self._peer(name, answer) for name in names]
        except BaseException:
            self.close()
            raise

    def _peer(self, name: str, answer: dict[str, Any]) -> Peer:
        try:
            settings, check = str(answer[f"{name}_settings"]), float(answer[f"{name}_check"])
        except KeyError:
            raise DataError(f"{name}: missing in the worker's answer") from None
        if not check <= TRUSTED:
            raise DataError(
                f"{name}: batch predictions differ by {check:.2g} standard deviations from those"
                " of the library's own function: pin another version"
            )
        return Peer(name, settings, check, self._worker)

    def close(self) -> None:
        """End the process; the predictors cannot be used any more."""
        self._worker.close()

    def __enter__(self) -> Peers:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def stretches(records: Sequence[Record]) -> tuple[FloatArray, FloatArray, IntArray]:
    """
    Return contiguous learnable samples: x (n, 3), u (n, 2), episode (n,).

    :raises DataError: no segment has `MIN_STRETCH` samples.
    """
    x, u, numbers = [], [], []
    count = 0
    for record in records:
        good = record.learnable & np.isfinite(record.x).all(axis=1)
        good &= np.isfinite(record.u).all(axis=1)
        breaks = (np.diff(good.astype(np.int64)) != 0) | (np.diff(record.episode) != 0)
        for part in np.split(np.arange(len(record)), np.flatnonzero(breaks) + 1):
            if part.size >= MIN_STRETCH and good[part[0]]:
                x.append(record.x[part])
                u.append(record.u[part])
                numbers.append(np.full(part.size, count, dtype=np.int64))
                count += 1
    if not count:
        raise DataError(
            f"no training data for the baseline libraries: no {MIN_STRETCH} good samples in a row"
        )
    return np.concatenate(x), np.concatenate(u), np.concatenate(numbers)
