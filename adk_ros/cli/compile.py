# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk compile: the numerical code for this machine."""

from __future__ import annotations

import typer

from adk_ros.cli import console
from adk_ros.cli.options import JsonOption


def compile_code(as_json: JsonOption = False) -> None:
    """
    Compile the numerical code, so that later starts take seconds.

    The compiled code is stored beside the sources or, if they are read-only, in the user's cache
    folder. It is valid for this processor until the sources or numba change. `make install` runs
    this command. Takes about 1 min on two cores.

    Example: adk compile
    """
    from adk_ros.api.compilation import compile_kernels
    from adk_ros.shutdown import TERMINATED, Terminated, graceful_shutdown

    try:
        with graceful_shutdown(), console.stages() as progress:
            result = compile_kernels(progress)
    except Terminated:
        console.note("adk: terminated")
        raise typer.Exit(TERMINATED) from None
    if as_json:
        console.print_json({"compiled": result.compiled, "seconds": round(result.seconds, 1)})
    elif result.compiled:
        console.note(f"{result.compiled} functions compiled in {result.seconds:.0f} s")
    else:
        console.note(f"the compiled code is up to date ({result.seconds:.0f} s)")
