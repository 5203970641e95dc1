# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Options that the verbs of `adk fleet` share."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from adk_ros.errors import UsageError

if TYPE_CHECKING:
    from adk_ros.api.fleet.fleet_run import FleetOptions

RecordingsArgument = Annotated[
    list[str],
    typer.Argument(help="folders, globs and URLs (s3://bucket/folder) with recordings"),
]
OutOption = Annotated[Path, typer.Option(help="folder of the results; a later run continues it")]
TagsOption = Annotated[
    Path | None,
    typer.Option(
        help="table of recording, vehicle, time and conditions",
        show_default="fleet.csv in the folder of the recordings, if there",
    ),
]
WorkersOption = Annotated[
    int | None, typer.Option(help="local worker processes", show_default="one per core")
]
ClusterOption = Annotated[
    str | None,
    typer.Option(help="address of a running Dask scheduler, instead of local workers"),
]
TimeoutOption = Annotated[float, typer.Option(help="seconds for one recording")]
MemoryOption = Annotated[
    float, typer.Option(help="MiB of memory for the work on one recording; a worker adds 150")
]
LimitOption = Annotated[
    int | None, typer.Option(help="process at most so many recordings", show_default="all")
]
RetryOption = Annotated[
    bool, typer.Option("--retry-failed", help="process failed recordings again")
]
DryRunOption = Annotated[
    bool, typer.Option("--dry-run", help="say what would be done and how long it would take")
]


def fleet_options(
    tags: Path | None,
    workers: int | None,
    cluster: str | None,
    timeout: float,
    memory: float,
    limit: int | None,
    retry_failed: bool,
) -> FleetOptions:
    """
    Return how the stages of a verb run.

    :raises UsageError: local workers and a cluster are both asked for.
    """
    from adk_ros.api.fleet.fleet_run import FleetOptions, available_cores
    from adk_ros.fleet.run import Limits

    if workers is not None and cluster is not None:
        raise UsageError("--workers starts local workers: leave it out with --cluster")
    return FleetOptions(
        available_cores() if workers is None else workers,
        cluster,
        tags,
        Limits(timeout, memory, limit, retry_failed),
    )
