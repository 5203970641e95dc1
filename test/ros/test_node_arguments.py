# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Refusal of wrong arguments and unusable models by the node, and its help text.

Most tests call the main function of the node, since a process needs 3 s to import PyTorch. At each
stage of the start, one refusal is tested with the process.
"""

import json
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from helpers.node import write_model

from adk_ros.ros import node
from adk_ros.ros.parameter_table import TABLE


@pytest.fixture
def refused(capfd: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Return a function that calls the node with arguments, which it must refuse."""

    def call(*arguments: str) -> str:
        code = node.main(["predictor", *arguments])
        # Signals have their usual effect again.
        assert signal.pthread_sigmask(signal.SIG_BLOCK, ()) == set()
        return only_line(code, *capfd.readouterr())

    return call


def refused_by_process(*arguments: str) -> str:
    """Start the node, which must refuse its arguments; return its one-line message."""
    done = subprocess.run(
        [sys.executable, "-m", "adk_ros.ros.node", *arguments],
        capture_output=True, text=True, timeout=60.0, check=False,
    )  # fmt: skip
    return only_line(done.returncode, done.stdout, done.stderr)


def only_line(code: int, out: str, errors: str) -> str:
    """Require exit code 2 and one line of the node on stderr; return the line."""
    assert code == 2, errors
    assert "Traceback" not in errors + out
    (only,) = [text for text in errors.splitlines() if not text.startswith("[")]
    assert only.startswith("predictor: ")
    return only


def truncated(folder: Path) -> None:
    content = (folder / "encoder.pt").read_bytes()
    (folder / "encoder.pt").write_bytes(content[: len(content) // 2])


def with_another_version(folder: Path) -> None:
    manifest = json.loads((folder / "manifest.json").read_text())
    manifest["version"] = 99
    (folder / "manifest.json").write_text(json.dumps(manifest))


def without_manifest(folder: Path) -> None:
    (folder / "manifest.json").unlink()


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (truncated, "does not match its hash"),
        (with_another_version, "version is 99"),
        (without_manifest, "it is not a model folder"),
    ],
)
def test_unusable_model_is_refused(
    tmp_path: Path, refused: Callable[..., str], damage: Callable[[Path], None], message: str
) -> None:
    folder = write_model(tmp_path / "model")
    damage(folder)
    assert message in refused("--ros-args", "-p", f"model:={folder}")


def test_unusable_model_is_refused_by_the_process(tmp_path: Path) -> None:
    folder = write_model(tmp_path / "model")
    truncated(folder)
    said = refused_by_process("--ros-args", "-p", f"model:={folder}")
    assert "does not match its hash" in said


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["--ros-args", "-p", "model:=/nowhere"], "model /nowhere is not a folder"),
        (["--ros-args"], "parameter 'model' is not given"),
        (["--ros-args", "-p", "model:=m", "-p", "method:=best"], "'method' is 'best'"),
        (["--ros-args", "-p", "model:=m", "-p", "ridge:=[1, 2]"], "'ridge' is [1, 2]"),
        (["--ros-args", "-p", "use_sim_time:=3"], "use_sim_time"),
    ],
)
def test_wrong_parameters_are_refused(
    refused: Callable[..., str], given: list[str], message: str
) -> None:
    assert message in refused(*given)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["--ros-args"], "parameter 'model' is not given"),
        (["--ros-args", "-p", "a:=[0, 0.5]"], "Sequence should be of same type"),
        (["--ros-args", "--params-file", "/nowhere.yaml"], "/nowhere.yaml"),
        (["bag.mcap"], "argument 'bag.mcap' is not understood"),
    ],
)
def test_wrong_arguments_are_refused_by_the_process(given: list[str], message: str) -> None:
    assert message in refused_by_process(*given)


def test_help_names_every_parameter(capfd: pytest.CaptureFixture[str]) -> None:
    assert node.main(["predictor", "--help"]) == 0
    out, _ = capfd.readouterr()
    assert all(f"\n  {spec.name} " in out for spec in TABLE)
    assert "Example: predictor --ros-args" in out
    assert max(map(len, out.splitlines())) < 100


def test_help_ends_quietly_with_its_reader() -> None:
    command = f"{sys.executable} -m adk_ros.ros.node --help | head -1"
    done = subprocess.run(
        ["sh", "-c", command], capture_output=True, text=True, timeout=60.0, check=True
    )
    assert done.stdout.startswith("usage: predictor")
    assert done.stderr == ""


def test_command_type_that_is_not_installed(tmp_path: Path, refused: Callable[..., str]) -> None:
    model = write_model(tmp_path / "model")
    text = refused(
        "--ros-args", "-p", f"model:={model}", "-p", "command_type:=ackermann",
        "-p", "mass:=1500.0", "-p", "wheel_radius:=0.3",
    )  # fmt: skip
    assert "ackermann_msgs is not installed" in text
