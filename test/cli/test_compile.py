# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk compile: messages and exit codes; afterwards the commands and the node compile nothing."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import pytest
from helpers.train import bag, lines, refused, small

import adk_ros
from adk_ros.api import compilation
from adk_ros.api.compilation import Compilation
from adk_ros.cli.main import main
from adk_ros.numerics import runge_kutta

NOTHING = (partial(time.sleep, 0.0),)
FLOWS = """
import sys
from pathlib import Path

from adk_ros.cli.main import main
from adk_ros.model.artefact import load
from adk_ros.model.pipeline import PipelineSettings
from adk_ros.ros.core import warm_up

model, bag, out = sys.argv[1:]
warm_up(load(Path(model)).model, PipelineSettings())
for arguments in (
    ["simulate", "town", "--duration", "5", "--out", out + "/seven"],
    ["simulate", "gusts", "--duration", "60", "--out", out + "/fourteen"],
    ["replay", bag, "--model", model, "--out", out + "/replayed"],
    ["rollout", "--model", model, "--bag", bag, "--out", out + "/trained.csv"],
    ["rollout", "--model", "imdv", "--bag", bag, "--out", out + "/vehicle.csv"],
    ["mismatch", "--simulation", bag, "--recording", out + "/fourteen", "--vehicle", "imdv",
     "--out", out + "/report"],
    ["rollout", "--model", out + "/report/simulation.yaml", "--bag", bag,
     "--out", out + "/surrogate.csv"],
    ["simulate", "town", "--duration", "5", "--model", out + "/report/corrected.yaml",
     "--out", out + "/surrogate"],
):
    assert main(arguments) == 0, arguments
"""


@pytest.mark.parametrize(
    ("compiled", "text"),
    [(150, "150 functions compiled in 31 s"), (0, "the compiled code is up to date (31 s)")],
)
def test_the_closing_line_says_what_was_done(
    capsys, monkeypatch, compiled: int, text: str
) -> None:
    result = Compilation(compiled, 31.4)
    monkeypatch.setattr(compilation, "compile_kernels", lambda progress: result)
    assert main(["compile"]) == 0
    assert lines(capsys.readouterr().err) == [text]
    assert main(["compile", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"compiled": compiled, "seconds": 31.4}


def test_groups_run_in_worker_processes_and_report_progress(monkeypatch) -> None:
    monkeypatch.setattr(compilation, "GROUPS", (NOTHING, NOTHING * 2))
    monkeypatch.setattr(compilation, "AFTER_GROUPS", NOTHING)
    reported = []
    result = compilation.compile_kernels(lambda *report: reported.append(report))
    assert result.compiled == 0
    assert {stage for stage, *_ in reported} == {"compiling"}
    assert reported[-1][1] == reported[-1][2]


def test_a_killed_process_is_reported_in_one_line(capsys, monkeypatch) -> None:
    monkeypatch.setattr(compilation, "GROUPS", (NOTHING, (partial(os._exit, 1),)))
    assert "a process was killed" in refused(capsys, ["compile"], 3)


def test_without_a_writable_folder_nothing_is_compiled(capsys, monkeypatch) -> None:
    # What numba says of a kernel for which it found no folder.
    kernel = SimpleNamespace(stats=SimpleNamespace(cache_path=None))
    monkeypatch.setattr(runge_kutta, "clip", kernel)
    assert "set NUMBA_CACHE_DIR to a folder that is" in refused(capsys, ["compile"], 2)


def group_ends(number: int) -> bool:
    """Whether all processes of a group end within 5 s."""
    for _ in range(100):
        try:
            os.killpg(number, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.05)
    return False


@pytest.mark.parametrize(
    ("number", "code", "text"),
    [(signal.SIGTERM, 143, "adk: terminated"), (signal.SIGINT, 130, "adk: interrupted")],
)
def test_signals_end_all_processes(
    tmp_path: Path, number: signal.Signals, code: int, text: str
) -> None:
    script = f"""
import os, sys, time
from functools import partial
from adk_ros.api import compilation
from adk_ros.cli.main import main
note = partial(os.mkdir, {str(tmp_path / "begun")!r})
compilation.GROUPS = ((note, partial(time.sleep, 60.0)), (partial(time.sleep, 60.0),))
sys.exit(main(["compile"]))
"""
    process = subprocess.Popen(
        [sys.executable, "-c", script], text=True, stderr=subprocess.PIPE, start_new_session=True
    )
    try:
        deadline = time.monotonic() + 60.0
        while not (tmp_path / "begun").is_dir() and time.monotonic() < deadline:
            time.sleep(0.05)
        process.send_signal(number)
        _, err = process.communicate(timeout=60)
    finally:
        process.kill()
    assert (process.returncode, lines(err)) == (code, [text])
    assert group_ends(process.pid)


@pytest.mark.slow
def test_afterwards_commands_and_node_compile_nothing(tmp_path: Path) -> None:
    package = tmp_path / "adk_ros"
    source = Path(adk_ros.__file__).parent
    shutil.copytree(source, package, ignore=shutil.ignore_patterns("__pycache__"))
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])}
    environment.pop("NUMBA_CACHE_DIR", None)

    def run(*arguments: object) -> str:
        process = subprocess.run(
            [sys.executable, *map(str, arguments)], env=environment, cwd=tmp_path, text=True,
            capture_output=True, check=False,
        )  # fmt: skip
        assert process.returncode == 0, process.stderr
        return process.stderr

    def compiled() -> set[str]:
        return {path.name for path in package.rglob("*.nbc")}

    assert "functions compiled" in run("-m", "adk_ros.cli.main", "compile")
    before = compiled()
    assert len(before) > 50
    assert "up to date" in run("-m", "adk_ros.cli.main", "compile")
    run("-c", FLOWS, small().path, bag("town", 60.0), tmp_path)
    assert compiled() == before
