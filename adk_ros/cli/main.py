# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The `adk` command: one module per verb, registered here.

Verbs import what they need when they run, so that help and completion are fast.
"""

from __future__ import annotations

import os
import shlex
import signal
import sys
from collections.abc import Callable, Sequence
from importlib import metadata
from typing import Annotated, Any

import typer

from adk_ros.api.provenance import COMMAND_LINE
from adk_ros.cli import (
    bench,
    check,
    demo,
    detectable,
    echo,
    export,
    fleet,
    import_files,
    info,
    mismatch,
    play,
    replay,
    rollout,
    simulate,
    train,
    watch,
)
from adk_ros.cli.command import COMPARE, DATA, INSTALL, MEASURE, PREDICT, VerbCommand, VerbGroup
from adk_ros.cli.compile import compile_code
from adk_ros.errors import AdkError
from adk_ros.shutdown import interruptible

app = typer.Typer(
    name="adk",
    cls=VerbGroup,
    help="Predict vehicle motion from rosbags, live or offline, and find what a simulation is "
    "missing.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(requested: bool) -> None:
    if requested:
        print(f"adk_ros {metadata.version('adk_ros')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", help="Show the version.", is_eager=True, callback=_print_version
        ),
    ] = False,
) -> None:
    """Declare the options of `adk` itself; the callback of --version has already run."""


VERBS: dict[str, tuple[str, Callable[..., Any]]] = {
    "info": (DATA, info.info),
    "import": (DATA, import_files.import_files),
    "export": (DATA, export.export),
    "check": (DATA, check.check),
    "simulate": (DATA, simulate.simulate),
    "play": (DATA, play.play),
    "train": (PREDICT, train.train),
    "replay": (PREDICT, replay.replay),
    "rollout": (PREDICT, rollout.rollout),
    "echo": (PREDICT, echo.echo),
    "demo": (PREDICT, demo.demo),
    "mismatch": (COMPARE, mismatch.mismatch),
    "detectable": (COMPARE, detectable.detectable),
    "watch": (COMPARE, watch.watch),
    "compile": (INSTALL, compile_code),
}
"""Verb -> (group in the help, function)."""

_INTERRUPTED = 128 + signal.SIGINT

for _name, (_group, _verb) in VERBS.items():
    app.command(_name, cls=VerbCommand, rich_help_panel=_group)(_verb)
for _command in bench.app.registered_commands:
    _command.cls = VerbCommand
for _command in fleet.app.registered_commands:
    _command.cls = VerbCommand
app.add_typer(fleet.app, name="fleet", rich_help_panel=COMPARE)
app.add_typer(bench.app, name="bench", rich_help_panel=MEASURE)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code: 0, 2 for wrong usage, 3 for unusable data."""
    given = sys.argv[1:] if arguments is None else arguments
    command_line = COMMAND_LINE.set(shlex.join(["adk", *given]))
    try:
        with interruptible():
            result = app(args=arguments, prog_name="adk", standalone_mode=False)
            sys.stdout.flush()
        if result == _INTERRUPTED:
            print("adk: interrupted", file=sys.stderr)
        return result if isinstance(result, int) else 0
    except AdkError as error:
        print(f"adk: {error}", file=sys.stderr)
        return error.exit_code
    except (KeyboardInterrupt, typer.Abort):
        print("adk: interrupted", file=sys.stderr)
        return _INTERRUPTED
    except typer.Exit as stop:
        return stop.exit_code
    except BrokenPipeError:
        # The reader closed the pipe: what is still buffered must not raise again at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        # An unwritable path or a full disk: a traceback would explain nothing.
        where = f"{error.filename}: " if error.filename else ""
        print(f"adk: {where}{error.strerror or error}", file=sys.stderr)
        return 2
    except Exception as error:
        if hasattr(error, "format_message"):
            return _print_usage_error(error)
        raise
    finally:
        COMMAND_LINE.reset(command_line)


def _print_usage_error(error: Any) -> int:
    """Print an error of the parser in one line; return the exit code."""
    text = error.format_message()
    if type(error).__name__ == "NoArgsIsHelpError":
        print(text, file=sys.stderr)
    elif text:
        context = getattr(error, "ctx", None)
        verb = context.command_path if context is not None else "adk"
        print(f"adk: {text} (see '{verb} --help')", file=sys.stderr)
    return int(getattr(error, "exit_code", 2))


def _verb_main(name: str) -> Callable[[], int]:
    """Return the entry point of a verb under its own name, for `ros2 run adk_ros VERB`."""

    def run() -> int:
        return main([name, *sys.argv[1:]])

    return run


train_main = _verb_main("train")
replay_main = _verb_main("replay")
play_main = _verb_main("play")
echo_main = _verb_main("echo")
rollout_main = _verb_main("rollout")
demo_main = _verb_main("demo")
info_main = _verb_main("info")
import_main = _verb_main("import")
export_main = _verb_main("export")
check_main = _verb_main("check")
simulate_main = _verb_main("simulate")
mismatch_main = _verb_main("mismatch")
detectable_main = _verb_main("detectable")
fleet_main = _verb_main("fleet")
watch_main = _verb_main("watch")
bench_main = _verb_main("bench")
compile_main = _verb_main("compile")

if __name__ == "__main__":
    sys.exit(main())
