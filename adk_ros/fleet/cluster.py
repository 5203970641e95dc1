# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A Dask cluster: local workers that are started here, or a running scheduler."""

from __future__ import annotations

import asyncio
import importlib.util
import logging
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from adk_ros.errors import UsageError, first_line
from adk_ros.fleet.libraries import fleet_library
from adk_ros.fleet.stage_process import ATTEMPTS
from adk_ros.fleet.store import OUTAGE_S

_RETRY_S = 1.0
_FIRST_WAIT_S = 15.0
"""Time for a scheduler that is just being started."""
_THREADS_KNOWN_S = 2.0
"""Time for which the number of workers is taken as unchanged."""
_REPLACED_S = 20.0
"""
Time after which a local worker that does not come back is replaced. Its nanny starts one that was
killed again within a few seconds, but 15 s after an end Dask closes the nanny if the worker is not
there at this moment, as when the second one has just been killed.
"""
_WATCHED_LESS = {
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "500 ms",
    "distributed.admin.system-monitor.interval": "2 s",
}
"""
What scheduler and workers watch of themselves, by default up to a hundred times a second. The work
is in other processes, of which that shows nothing, and takes its time on the same cores.
"""
WORKER_MIB = 150.0
"""MiB of a worker besides its stage process; measured with `adk bench fleet`."""


class Cluster:
    """A connection to a scheduler; `open_cluster` makes it."""

    def __init__(self, client: Any, address: str | None, local: Any = None) -> None:
        self.client = client
        self._address = address
        self._local = local
        self._threads = (0.0, 0)
        self._complete_at = time.monotonic()

    def replace_lost_workers(self) -> None:
        """Start other local workers for those that have been missing for `_REPLACED_S`."""
        if self._local is None:
            return
        wanted = len(self._local.worker_spec)
        present = {each["name"] for each in self._local.scheduler_info["workers"].values()}
        missing = set(self._local.worker_spec) - present
        now = time.monotonic()
        if not missing:
            self._complete_at = now
        elif now - self._complete_at > _REPLACED_S:
            for name in missing:
                del self._local.worker_spec[name]
            self._local.scale(wanted)
            self._complete_at = now

    @property
    def threads(self) -> int:
        """Number of tasks that the workers run at a time; 0 without workers."""
        now = time.monotonic()
        if now - self._threads[0] > _THREADS_KNOWN_S or not self._threads[1]:
            with suppress(Exception):  # the connection is just being lost
                self._threads = now, sum(self.client.nthreads().values())
        return self._threads[1]

    @property
    def lacking(self) -> str:
        """What the scheduler waits for before it can work, "" if for nothing."""
        if self._address is None or self.threads:
            return ""
        return f"no worker is connected: start one with 'dask worker {self._address}'"

    @property
    def is_connected(self) -> bool:
        """Whether the scheduler answers."""
        return bool(self.client.status == "running")

    @property
    def dashboard(self) -> str:
        """Address of the engine's page, "" if it has none or the scheduler does not answer."""
        if importlib.util.find_spec("bokeh") is None:
            return ""
        with suppress(Exception):  # the scheduler is asked, and may just have gone
            return str(self.client.dashboard_link or "")
        return ""

    def reconnect(self, outage_s: float = OUTAGE_S) -> None:
        """
        Connect again to a scheduler that has gone, as after its restart.

        :raises UsageError: it does not come back within `outage_s`.
        """
        with suppress(Exception):
            self.client.close(timeout=1.0)
        if self._address is None:
            raise UsageError("the local scheduler has ended: run the same command to continue")
        self.client = _connected(self._address, outage_s)


@contextmanager
def open_cluster(workers: int, address: str | None = None) -> Iterator[Cluster]:
    """
    Yield a cluster: `workers` local processes on the loopback interface, or the one at `address`.

    The local scheduler accepts only connections with a certificate made for this run, so that
    other users of the machine cannot give it tasks.

    :raises UsageError: Dask is not installed, or no scheduler answers at `address`.
    """
    distributed = fleet_library("distributed")
    _quiet()
    dask = fleet_library("dask")
    with dask.config.set(
        {
            "distributed.scheduler.allowed-failures": ATTEMPTS - 1,
            # A worker has no task that it does not work on, which would end with it.
            "distributed.scheduler.worker-saturation": 1.0,
            **_WATCHED_LESS,
        }
    ):
        if address is not None:
            cluster = Cluster(_connected(address, _FIRST_WAIT_S), address)
            try:
                yield cluster
            finally:
                with suppress(Exception):
                    cluster.client.close(timeout=2.0)
            return
        local = _local_cluster(distributed, workers)
        try:
            cluster = Cluster(distributed.Client(local), None, local)
            try:
                yield cluster
            finally:
                with suppress(Exception):
                    cluster.client.close(timeout=2.0)
        finally:
            with suppress(Exception):
                local.close(timeout=10.0)


def _local_cluster(distributed: Any, workers: int) -> Any:
    """Start local workers, again if one is killed while it starts."""
    for attempt in range(ATTEMPTS):
        try:
            return distributed.LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                processes=True,
                host="127.0.0.1",
                dashboard_address="127.0.0.1:0",
                security=_security(distributed),
                # The stage processes are limited, and the workers besides them are small.
                memory_limit=0,
                silence_logs=logging.CRITICAL,
                local_directory=tempfile.gettempdir(),
            )
        except RuntimeError as error:
            if attempt + 1 == ATTEMPTS:
                raise UsageError(f"no local worker can be started: {first_line(error)}") from None
    raise AssertionError("unreachable")


def _security(distributed: Any) -> Any:
    """Return a certificate for this run; None where it cannot be made."""
    try:
        return distributed.Security.temporary()
    except ImportError:
        return None


def _connected(address: str, wait_s: float) -> Any:
    distributed = fleet_library("distributed")
    deadline = time.monotonic() + wait_s
    while True:
        try:
            return distributed.Client(address, timeout=5.0, set_as_default=False)
        except (OSError, ValueError, asyncio.TimeoutError) as error:
            if isinstance(error, ValueError) or time.monotonic() > deadline:
                raise UsageError(
                    f"--cluster {address}: no Dask scheduler answers ({first_line(error)}): start "
                    "it with 'dask scheduler', then run the same command, results so far are kept"
                ) from None
        time.sleep(_RETRY_S)


def _quiet() -> None:
    """Keep Dask from logging what the run reports in its own words."""
    for name in ("distributed", "bokeh", "tornado", "asyncio"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
