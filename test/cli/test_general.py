# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What all verbs have in common: help, refusals in one line, exit codes, completion, pipes."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from helpers.train import bag, lines, refused, small

from adk_ros.bags import recording
from adk_ros.cli import console
from adk_ros.cli.main import VERBS, main

BENCHES = ("latency", "live", "paper", "soak")
ALL = [[verb] for verb in VERBS] + [["bench", name] for name in BENCHES]
ADK = "import sys; sys.argv[0] = 'adk'; from adk_ros.cli.main import main; sys.exit(main())"


def adk(*arguments: str, **keywords) -> subprocess.CompletedProcess[str]:
    """`adk` in a process of its own, as a shell runs it."""
    return subprocess.run(
        [sys.executable, "-c", ADK, *arguments], text=True, timeout=120, check=False,
        stdin=subprocess.DEVNULL, **keywords,
    )  # fmt: skip


@pytest.mark.parametrize("verb", ALL, ids=" ".join)
@pytest.mark.parametrize("option", ["--help", "-h"])
def test_help_has_an_example(capsys, verb: list[str], option: str) -> None:
    assert main([*verb, option]) == 0
    said = capsys.readouterr()
    assert said.err == ""
    text = " ".join(said.out.split())
    assert f"Example: adk {' '.join(verb)}" in text
    # Each option says what it is for.
    for line in re.findall(r"(?m)^  --[a-z-]+ <[a-z]+>[ ]*(.*)$", said.out):
        assert re.match(r"[a-zA-Z']", line), said.out


def test_help_of_all_names_each_verb_in_a_whole_sentence(capsys) -> None:
    assert main(["--help"]) == 0
    said = capsys.readouterr().out
    for verb in (*VERBS, "bench"):
        assert re.search(rf"(?m)^  {verb} +[A-Z].*\.$", said), verb
    assert "..." not in said.replace("[ARGS]...", "")
    assert main(["bench", "--help"]) == 0
    said = capsys.readouterr().out
    assert all(re.search(rf"(?m)^  {name} +[A-Z].*\.$", said) for name in BENCHES)


def test_without_a_verb_there_is_help(capsys) -> None:
    for arguments in ([], ["bench"]):
        assert main(arguments) == 2
        said = capsys.readouterr()
        assert said.out == ""
        assert said.err.startswith("Usage: adk ")
        assert "Commands:" in said.err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["trian"], "Did you mean 'train'?"),
        (["--frobnicate"], "No such option: --frobnicate"),
        (["train"], "Missing argument 'bags'"),
        (["train", "x"], "Missing option '--out'"),
        (["train", "x", "--out", "y", "--sped"], "--sped"),
        (["train", "x", "--out", "y", "--steps", "many"], "'--steps': Input should be a valid in"),
        (["replay", "x"], "Missing option '--model'"),
        (["rollout", "--model", "x", "--bag", "y"], "Missing option '--out'"),
        (["info"], "Missing argument 'path'"),
        (["info", "a", "b"], "unexpected extra argument"),
        (["bench", "sleep"], "No such command 'sleep'"),
        (["play", "x", "--rate", "fast"], "'--rate': Input should be a valid number"),
        (["simulate", "town"], "Missing option '--out'"),
    ],
)
def test_a_mistake_on_the_command_line_is_one_line(
    capsys, arguments: list[str], said: str
) -> None:
    line = refused(capsys, arguments, 2)
    assert said in line
    assert re.search(r"\(see 'adk( [a-z]+)* --help'\)$", line)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["train", "absent", "--out", "{tmp}/m"], "bag absent does not exist"),
        (["replay", "absent", "--model", "{model}"], "bag absent does not exist"),
        (["replay", "{bag}", "--model", "absent"], "absent"),
        (["replay", "{bag}", "--model", "{tmp}"], "holds no manifest.json"),
        (["rollout", "--model", "{model}", "--bag", "absent", "--out", "{tmp}/r.csv"],
         "bag absent does not exist"),
        (["rollout", "--model", "absent", "--bag", "{bag}", "--out", "{tmp}/r.csv"],
         "model absent does not exist: give the folder that 'adk train' wrote, a vehicle's YAML "),
        (["rollout", "--model", "{tmp}/car.yaml", "--bag", "{bag}", "--out", "{tmp}/r.csv"],
         "does not exist"),
        (["info", "absent"], "absent does not exist"),
        (["simulate", "absent", "--out", "{tmp}/b"], "no such scenario; give a YAML file or one "),
        (["train", "{bag}", "--out", "{tmp}/m", "--params", "absent.yaml"], "absent.yaml"),
        (["train", "{bag}", "--out", "{tmp}/m", "--paper", "lstm"],
         "--paper lstm is unknown: choose dk or aldk"),
        (["train", "{bag}", "--out", "{tmp}/m", "--split", "rows"], "split 'rows' is unknown"),
        (["train", "{bag}", "--out", "{tmp}/m", "--split", "bags"], "at least two bags"),
        (["train", "{bag}", "--out", "{tmp}/m", "--steps", "3"], "steps is 3: choose 10 to"),
        (["train", "{bag}", "--out", "{tmp}/m", "--device", "abacus"], "device 'abacus'"),
        (["train", "{bag}", "--out", "{tmp}/m", "--imu", "/nope"], "/nope"),
        (["train", "{bag}", "--out", "{tmp}"], "exists and is no model"),
        (["train", "{bag}", "--out", "{file}/m"], "cannot be written"),
        (["replay", "{bag}", "--model", "{model}", "--method", "kalman"],
         "online method 'kalman' is unknown: choose one of constant, rls, ffrls, swls, windowed"),
        (["replay", "{bag}", "--model", "{model}", "--window", "0"], "window is 0 samples"),
        (["replay", "{bag}", "--model", "{model}", "--ridge", "0"], "ridge is 0"),
        (["replay", "{bag}", "--model", "{model}", "--horizon", "nan"], "--horizon nan is out of"),
        (["replay", "{bag}", "--model", "{model}", "--horizon", "-1"], "--horizon -1 is out of"),
        (["replay", "{bag}", "--model", "{model}", "--out", "{tmp}"], "exists already"),
        (["replay", "{bag}", "--model", "{model}", "--out", "{file}/b"], "{file}"),
        (["rollout", "--model", "imdv", "--bag", "{bag}", "--out", "{tmp}/r", "--horizon", "inf"],
         "--horizon inf is out of range: choose 0.025 to 10 s"),
        (["rollout", "--model", "imdv", "--bag", "{bag}", "--out", "{tmp}/r", "--stride", "inf"],
         "--stride inf is out of range"),
        (["rollout", "--model", "imdv", "--bag", "{bag}", "--out", "{tmp}/r", "--stride", "nan"],
         "--stride nan is out of range"),
        (["rollout", "--model", "imdv", "--bag", "{bag}", "--out", "{file}/r.csv"],
         "cannot be written"),
        (["bench", "soak", "--model", "{model}", "--ticks", "0"], "--ticks 0 is too few"),
        (["bench", "latency", "--model", "{model}", "--ticks", "9"], "--ticks 9 is too few"),
        (["simulate", "town", "--out", "{tmp}/b", "--duration", "0"], "duration must be 0.1 to"),
    ],
)  # fmt: skip
def test_a_request_that_cannot_be_met_is_one_line(
    capsys, tmp_path: Path, arguments: list[str], said: str
) -> None:
    file = tmp_path / "a_file"
    file.write_text("text")
    places = {"tmp": tmp_path, "model": small().path, "bag": bag(), "file": file}
    line = refused(capsys, [item.format(**places) for item in arguments], 2)
    assert said.format(**places) in line
    assert list(tmp_path.iterdir()) == [file]


def test_a_full_disk_is_told_without_a_traceback(capsys, monkeypatch, tmp_path: Path) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device", "/data/out")

    monkeypatch.setattr(recording, "read_recording", full)
    arguments = ["train", bag(), "--out", tmp_path / "m"]
    assert refused(capsys, arguments, 2) == "adk: /data/out: No space left on device"


def test_an_interrupt_is_no_traceback(capsys, monkeypatch, tmp_path: Path) -> None:
    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(recording, "read_recording", interrupt)
    assert main(["train", str(bag()), "--out", str(tmp_path / "m")]) == 130
    assert capsys.readouterr().err == "adk: interrupted\n"


def test_ctrl_c_ends_a_training_and_keeps_nothing_half_done(tmp_path: Path) -> None:
    arguments = ["train", str(bag("handling", 60.0)), "--out", str(tmp_path / "m")]
    # Where tests run in the background SIGINT is ignored, and children inherit that.
    heeding = f"import signal; signal.signal(signal.SIGINT, signal.default_int_handler); {ADK}"
    process = subprocess.Popen(
        [sys.executable, "-c", heeding, *arguments, "--steps", "1000000"], text=True,
        stderr=subprocess.PIPE, stdout=subprocess.PIPE, stdin=subprocess.DEVNULL,
    )  # fmt: skip
    assert process.stderr is not None
    try:
        # The first line is told when the bag has been read.
        assert process.stderr.readline().startswith(str(bag("handling", 60.0)))
        time.sleep(1.0)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=120)
    finally:
        process.kill()
    assert process.returncode == 130
    assert out == ""
    assert lines(err)[-1] == "adk: interrupted"
    assert "Traceback" not in err
    assert not (tmp_path / "m").exists()


def test_completion() -> None:
    words = {"_ADK_COMPLETE": "complete_bash", "COMP_WORDS": "adk re", "COMP_CWORD": "1"}
    told = adk(env=os.environ | words, capture_output=True)
    assert (told.returncode, told.stdout.split(), told.stderr) == (0, ["replay"], "")
    words |= {"COMP_WORDS": "adk replay --me", "COMP_CWORD": "2"}
    assert adk(env=os.environ | words, capture_output=True).stdout.split() == ["--method"]
    named = {"_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"}
    for shell, said in (
        ("bash", "complete -o default -F _adk_completion adk"),
        ("zsh", "#compdef adk"),
        ("fish", "complete --command adk"),
    ):
        told = adk("--show-completion", shell, env=os.environ | named, capture_output=True)
        assert told.returncode == 0
        assert said in told.stdout
        assert "_ADK_COMPLETE" in told.stdout


@pytest.mark.parametrize("arguments", [["info", "BAG"], ["info", "BAG", "--json"], ["--help"]])
def test_a_reader_that_has_gone_is_no_fault(arguments: list[str]) -> None:
    """As `adk info ... | head -0`."""
    reading, writing = os.pipe()
    os.close(reading)
    try:
        arguments = [item.replace("BAG", str(bag())) for item in arguments]
        told = adk(*arguments, stdout=writing, stderr=subprocess.PIPE)
    finally:
        os.close(writing)
    assert told.stderr == ""
    assert told.returncode in (0, 1)


def test_help_comes_at_once() -> None:
    """Completion runs all of this at each press of the tab key."""
    script = (
        "import sys; sys.argv = ['adk', '--help']\n"
        "from adk_ros.cli.main import main; main()\n"
        "slow = {'torch', 'rosbags', 'numba', 'matplotlib', 'rclpy', 'scipy', 'jinja2'}\n"
        "print('loaded:', *sorted(slow & set(sys.modules)))"
    )
    times = []
    for _ in range(2):
        started = time.monotonic()
        told = subprocess.run(
            [sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=60
        )
        times.append(time.monotonic() - started)
    assert told.stdout.splitlines()[-1] == "loaded:"
    assert min(times) < 2.0


def test_numbers_that_json_lacks_become_null(capsys) -> None:
    console.print_json({"a": float("nan"), "b": [1.5, float("inf")], 3: {"c": None}})
    told = json.loads(capsys.readouterr().out)
    assert told == {"a": None, "b": [1.5, None], "3": {"c": None}}


class Clock:
    """Time that goes on by a second whenever somebody looks."""

    def __init__(self) -> None:
        self.now = 0.0

    def monotonic(self) -> float:
        self.now += 1.0
        return self.now


def test_progress_elsewhere_than_on_a_terminal_is_a_line_now_and_then(capsys, monkeypatch) -> None:
    monkeypatch.setattr(console, "time", Clock())
    with console.progress("counting") as report:
        for number in range(45):
            report(number, 45, "so far so good")
    said = lines(capsys.readouterr().err)
    assert 3 <= len(said) <= 5
    assert all(re.fullmatch(r"counting: \d+ %  so far so good", line) for line in said)
    with console.progress("quick") as report:
        report(1, 2)
    assert capsys.readouterr().err == ""


def test_a_bar_that_begins_ends_the_one_before(monkeypatch) -> None:
    """Older versions of rich refuse two at a time."""
    monkeypatch.setattr(console, "time", Clock())
    monkeypatch.setattr(console.errors, "_force_terminal", True)
    assert console.errors.is_terminal
    with console.progress("first") as first, console.progress("second") as second:
        for number in range(4):
            first(number, 4)
        assert len(console._live) == 1
        before = console._live[0]
        for number in range(4):
            second(number, 4)
        assert len(console._live) == 1
        assert console._live[0] is not before
        first(4, 4)
    assert console._live == []


def test_the_score_table_fits_80_columns(capsys) -> None:
    from adk_ros.train.held_out import HELD_INPUTS, MODEL

    test = small().run.test
    assert test is not None
    console.print_table(console.score_table(test.scores, (MODEL, HELD_INPUTS), "RMSE"))
    printed = [line.rstrip() for line in capsys.readouterr().out.splitlines()]
    assert max(map(len, printed)) <= 80
    text = "\n".join(printed)
    for word in ("persistence", "integration", "commands", "yaw_rate", "deg/s", "0.025 s"):
        assert word in text
    assert "…" not in text
