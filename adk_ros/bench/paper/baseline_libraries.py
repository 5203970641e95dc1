# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
pykoop and pykoopman under the contract of the tables, run in an environment of their own.

What they require contradicts what adk_ros requires, so `make peers` gives them a Python, and
`peer_worker.py` runs there as a process that is fitted once and then asked. They see the same
training records as everybody else: the stretches of samples that may be learned from.
"""

from __future__ import annotations

import contextlib
import os
import selectors
import subprocess
import tempfile
import weakref
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from adk_ros.errors import DataError, UsageError
from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.signals.channels import Record

VARIABLE = "ADK_PEERS_PYTHON"
PEERS = ("pykoop", "pykoopman")
WORKER = Path(__file__).with_name("baseline_library_worker.py")
TIMEOUT_S = 900.0
MIN_STRETCH = 20
"""Samples of a stretch below which it is not worth a training episode."""
TRUSTED = 1e-6
"""Largest difference between a batch and the library's own prediction, in usual deviations."""

_ENVIRONMENT = Path(".venv-peers", "bin", "python")
_BESIDE = Path(__file__).resolve().parents[3]
_ONE_THREAD = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL")}


def find_python(given: str | Path | None = None) -> Path:
    """
    Return the Python that has the peers: given, or ADK_PEERS_PYTHON's, or that of `make peers`.

    :raises UsageError: there is none.
    """
    named = given or os.environ.get(VARIABLE)
    places = [Path(named)] if named else [_BESIDE / _ENVIRONMENT, Path.cwd() / _ENVIRONMENT]
    for place in places:
        # Not resolved: a link into an environment is what makes Python use it.
        if os.access(place, os.X_OK) and place.is_file():
            return place.absolute()
    where = f"{named} is no executable" if named else "there is no .venv-peers"
    raise UsageError(
        f"libraries to compare with need an environment of their own and {where}: run"
        f" `make peers`, or name its Python in {VARIABLE}"
    )


@dataclass(frozen=True)
class Peer:
    """
    One fitted library; `settings` says what was chosen on the last part of the training records.

    `check`: the largest difference found between its predictions in batches and those of the
    library's own function, in usual deviations of the channels.
    """

    name: str
    settings: str
    check: float
    _worker: Worker

    def predict(self, record: Record, rows: IntArray, ahead: int) -> FloatArray:
        """As `BenchPredictor.predict`; NaN where two samples of past are not there."""
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
                f"{self.name}: the worker answered with an array of shape {predicted.shape} to"
                f" {rows.shape[0]} rows and {ahead} steps"
            )
        return predicted


class Worker:
    """The process under the other Python, and the files that it is asked and answers by."""

    def __init__(
        self, python: Path, script: Path, timeout_s: float, scratch: Path | None = None
    ) -> None:
        self._timeout_s = timeout_s
        self._folder = tempfile.TemporaryDirectory(prefix="adk_peers_", dir=scratch)
        self._log = Path(self._folder.name, "log")
        with self._log.open("wb") as log:
            # Isolated: neither PYTHONPATH nor the user's own packages belong to what is compared.
            self._process = subprocess.Popen(
                [str(python), "-I", str(script)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=log,
                env=os.environ | _ONE_THREAD,
            )
        self._end = weakref.finalize(self, _end, self._process, self._folder)

    def close(self) -> None:
        """End the process; nothing can be asked any more."""
        self._end()

    def ask(self, **job: Any) -> dict[str, Any]:
        """
        Return the answer to a job.

        :raises UsageError: the environment does not hold what it should, or the process is closed.
        :raises DataError: the worker failed, or took too long.
        """
        if not self._end.alive:
            raise UsageError("the peers were closed: fit them anew")
        source, target = (Path(self._folder.name, name) for name in ("job.npz", "answer.npz"))
        np.savez(source, **job)
        target.unlink(missing_ok=True)
        said = self._exchange(f"{source}\t{target}\n")
        if said == "done" and target.is_file():
            with np.load(target) as answer:
                return dict(answer)
        why = said.removeprefix("failed ") or self._last_words()
        if not said or why.startswith(("ImportError", "ModuleNotFoundError")):
            self.close()
            raise UsageError(f"the peers' environment does not work ({why}): run `make peers`")
        raise DataError(f"the peers failed: {why}")

    def _exchange(self, line: str) -> str:
        """What the worker says to a line; "" if it has ended."""
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
            # It answers in one short line, so that what is readable is whole.
            if not selector.select(self._timeout_s):
                self.close()
                raise DataError(f"the peers took more than {self._timeout_s:g} s and were stopped")
        return pipe_out.readline().decode(errors="replace").strip()

    def _last_words(self) -> str:
        lines = self._log.read_text(errors="replace").split("\n") if self._log.is_file() else []
        return next((line for line in reversed(lines) if line.strip()), "it ended without a word")


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
    Both libraries, fitted: `predictors`. A context manager; on leaving, the process ends.

    :param train: training records, at least one with `MIN_STRETCH` samples in a row.
    :param python: the peers' Python; see `find_python`.
    :param scratch: where their files go for a while; None: among the system's temporary ones.
    :raises UsageError: there is no such environment, or it does not work.
    :raises DataError: nothing to learn from, the libraries fail, or their own predictions differ
        from those in batches.
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
            raise DataError(f"{name}: the worker's answer does not mention it") from None
        if not check <= TRUSTED:
            raise DataError(
                f"{name}: its predictions in batches are {check:.2g} deviations from its own"
                " function's, so they would not be its own: pin another version"
            )
        return Peer(name, settings, check, self._worker)

    def close(self) -> None:
        """End the process; the predictors cannot be asked any more."""
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
    Return the samples in a row that may be learned from: x (n, 3), u (n, 2), episode (n,).

    :raises DataError: no stretch is as long as `MIN_STRETCH`.
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
            f"the peers have nothing to learn from: no {MIN_STRETCH} good samples in a row"
        )
    return np.concatenate(x), np.concatenate(u), np.concatenate(numbers)
