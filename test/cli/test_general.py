# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Behaviour common to all verbs: help, one-line errors, exit codes, completion, pipes."""

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

BENCHES = ("control", "latency", "learned", "live", "paper", "soak")
ALL = [[verb] for verb in VERBS] + [["bench", name] for name in BENCHES]
ADK = "import sys; sys.argv[0] = 'adk'; from adk_ros.cli.main import main; sys.exit(main())"


def adk(*arguments: str, **keywords) -> subprocess.CompletedProcess[str]:
    """Run `adk` in a process of its own, as a shell does."""
    return subprocess.run(
        [sys.executable, "-c", ADK, *arguments], text=True, timeout=120, check=False,
        stdin=subprocess.DEVNULL, **keywords,
    )  # fmt: skip


@pytest.mark.parametrize("verb", ALL, ids=" ".join)
@pytest.mark.parametrize("option", ["--help", "-h"])
def test_help_has_an_example(capsys, verb: list[str], option: str) -> None:
    assert main([*verb, option]) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    text = " ".join(printed.out.split())
    assert f"Example: adk {' '.join(verb)}" in text
    # Every option has a help text.
    for line in re.findall(r"(?m)^  --[a-z-]+ <[a-z]+>(?:\.\.\.)?[ ]*(.*)$", printed.out):
        assert re.match(r"[a-zA-Z']", line), printed.out


def test_help_describes_each_verb_in_a_complete_sentence(capsys) -> None:
    assert main(["--help"]) == 0
    text = capsys.readouterr().out
    for verb in (*VERBS, "bench"):
        assert re.search(rf"(?m)^  {verb} +[A-Z].*\.$", text), verb
    assert "..." not in text.replace("[ARGS]...", "")
    assert main(["bench", "--help"]) == 0
    text = capsys.readouterr().out
    assert all(re.search(rf"(?m)^  {name} +[A-Z].*\.$", text) for name in BENCHES)


def test_help_groups_the_verbs(capsys) -> None:
    assert main(["--help"]) == 0
    groups = dict(re.findall(r"(?m)^([A-Z][a-z]+):\n((?:  .*\n)+)", capsys.readouterr().out))
    verbs = {
        group: [line.split()[0] for line in text.splitlines()]
        for group, text in groups.items()
        if group != "Options"
    }
    assert verbs == {
        "Data": ["info", "import", "export", "check", "simulate", "play"],
        "Predict": ["train", "replay", "rollout", "echo", "demo"],
        "Compare": ["mismatch", "detectable", "watch", "fleet"],
        "Measure": ["bench"],
        "Install": ["compile"],
    }


@pytest.mark.parametrize("verb", ["train", "replay", "simulate", "demo", "mismatch", "compile"])
def test_help_of_a_long_running_verb_gives_its_duration(capsys, verb: str) -> None:
    assert main([verb, "--help"]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert re.search(r"[Tt]akes (about )?[\d.]+|Takes a few seconds|\(about \d+ min\)", text), text


def test_without_a_verb_the_help_is_printed(capsys) -> None:
    for arguments in ([], ["bench"]):
        assert main(arguments) == 2
        printed = capsys.readouterr()
        assert printed.out == ""
        assert printed.err.startswith("Usage: adk ")
        assert re.search(r"(?m)^(Measure|Commands):$", printed.err)


@pytest.mark.parametrize(
    ("arguments", "message"),
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
def test_wrong_usage_is_reported_in_one_line(capsys, arguments: list[str], message: str) -> None:
    line = refused(capsys, arguments, 2)
    assert message in line
    assert re.search(r"\(see 'adk( [a-z]+)* --help'\)$", line)


@pytest.mark.parametrize(
    "arguments",
    [
        ["mismatch", "--recording", "a", "--simulation", "s", "--simulation", "t", "--out", "o"],
        ["rollout", "--bag", "a", "--bag", "b", "--model", "m", "--out", "o"],
        ["replay", "a", "--model", "m", "--model", "n"],
        ["train", "a", "b", "--out", "o", "--out", "p"],
        ["train", "a", "--out", "o", "--report", "--no-report"],
        ["simulate", "town", "--out", "o", "--seed", "1", "--seed", "2"],
        ["play", "a", "--rate", "1", "--rate", "2"],
        ["echo", "--every", "1", "--every", "2"],
        ["demo", "--out", "o", "--out", "p"],
        ["bench", "latency", "--ticks", "1", "--ticks", "2"],
    ],
    ids=lambda arguments: arguments[0],
)
def test_a_repeated_option_is_refused(capsys, tmp_path: Path, arguments: list[str]) -> None:
    assert "is given 2 times: it takes one value" in refused(capsys, arguments, 2)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_options_that_collect_values_and_flags_may_be_repeated(capsys) -> None:
    remaps = ["--remap", "/a:=/b", "--remap", "/c:=/d", "--topic", "/a", "--topic", "/c"]
    assert "absent" in refused(capsys, ["play", "absent", *remaps], 2)
    assert main(["info", str(bag()), "--json", "--json"]) == 0
    capsys.readouterr()


def test_a_repeated_option_is_not_an_error_for_completion() -> None:
    words = {"_ADK_COMPLETE": "complete_bash", "COMP_CWORD": "5"}
    words["COMP_WORDS"] = "adk rollout --bag a --bag"
    assert adk(env=os.environ | words, capture_output=True).returncode == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["train", "absent", "--out", "{tmp}/m"], "bag absent does not exist"),
        (["replay", "absent", "--model", "{model}"], "bag absent does not exist"),
        (["replay", "{bag}", "--model", "absent"], "absent"),
        (["replay", "{bag}", "--model", "{tmp}"], "contains no manifest.json"),
        (["rollout", "--model", "{model}", "--bag", "absent", "--out", "{tmp}/r.csv"],
         "bag absent does not exist"),
        (["rollout", "--model", "absent", "--bag", "{bag}", "--out", "{tmp}/r.csv"],
         "model absent does not exist: give a model folder"),
        (["rollout", "--model", "{tmp}/car.yaml", "--bag", "{bag}", "--out", "{tmp}/r.csv"],
         "does not exist"),
        (["info", "absent"], "absent does not exist"),
        (["simulate", "absent", "--out", "{tmp}/b"], "no such scenario; give a YAML file or one "),
        (["train", "{bag}", "--out", "{tmp}/m", "--params", "absent.yaml"], "absent.yaml"),
        (["train", "{bag}", "--out", "{tmp}/m", "--paper", "lstm"],
         "--paper lstm is unknown: choose dk or aldk"),
        # No bag is read before the options are checked.
        (["train", "absent", "--out", "{tmp}/m", "--split", "rows"], "split 'rows' is unknown"),
        (["train", "absent", "--out", "{tmp}/m", "--split", "bags"], "at least two bags"),
        (["train", "{bag}", "--out", "{tmp}/m", "--steps", "3"], "steps is 3: choose 10 to"),
        (["train", "{bag}", "--out", "{tmp}/m", "--device", "abacus"], "device 'abacus'"),
        (["train", "{bag}", "--out", "{tmp}/m", "--imu", "/nope"], "/nope"),
        (["train", "{bag}", "--out", "{tmp}"], "is not empty and holds no earlier result"),
        (["train", "{bag}", "--out", "{file}/m"], "cannot be written"),
        (["replay", "{bag}", "--model", "{model}", "--method", "kalman"],
         "online method 'kalman' is unknown: choose one of constant, rls, ffrls, swls, windowed"),
        (["replay", "{bag}", "--model", "{model}", "--window", "0"], "window is 0 samples"),
        (["replay", "{bag}", "--model", "{model}", "--ridge", "0"], "ridge is 0"),
        (["replay", "{bag}", "--model", "{model}", "--horizon", "nan"], "--horizon nan is out of"),
        (["replay", "{bag}", "--model", "{model}", "--horizon", "-1"], "--horizon -1 is out of"),
        (["replay", "{bag}", "--model", "{model}", "--out", "{tmp}"],
         "is not empty and holds no earlier result"),
        (["replay", "{bag}", "--model", "{model}", "--out", "{bag}", "--force"],
         "is an input as well"),
        (["rollout", "--model", "imdv", "--bag", "{bag}", "--out", "{file}"],
         "a_file exists already: add --force to replace it"),
        (["rollout", "--model", "{file}", "--bag", "{bag}", "--out", "{file}", "--force"],
         "is an input as well"),
        (["rollout", "--model", "imdv", "--bag", "{bag}", "--out", "{tmp}", "--force"],
         "is a folder: name a file for --out"),
        (["simulate", "town", "--out", "{tmp}"], "is not empty and holds no earlier result"),
        (["simulate", "town", "--out", "{file}"], "is a file: name a folder for --out"),
        (["mismatch", "--simulation", "absent", "--recording", "absent", "--out", "{tmp}",
          "--force"], "is not empty and holds no earlier result"),
        (["demo", "--out", "{tmp}", "--train-bag", "{bag}", "--play-bag", "{bag}"],
         "is not empty and holds no earlier result"),
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
def test_an_impossible_request_is_reported_in_one_line(
    capsys, tmp_path: Path, arguments: list[str], message: str
) -> None:
    file = tmp_path / "a_file"
    file.write_text("text")
    paths = {"tmp": tmp_path, "model": small().path, "bag": bag(), "file": file}
    line = refused(capsys, [item.format(**paths) for item in arguments], 2)
    assert message.format(**paths) in line
    assert list(tmp_path.iterdir()) == [file]


def test_a_full_disk_is_reported_without_a_traceback(capsys, monkeypatch, tmp_path: Path) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device", "/data/out")

    monkeypatch.setattr(recording, "read_recording", full)
    arguments = ["train", bag(), "--out", tmp_path / "m"]
    assert refused(capsys, arguments, 2) == "adk: /data/out: No space left on device"


def test_an_interrupt_is_reported_without_a_traceback(capsys, monkeypatch, tmp_path: Path) -> None:
    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(recording, "read_recording", interrupt)
    assert main(["train", str(bag()), "--out", str(tmp_path / "m")]) == 130
    assert capsys.readouterr().err == "adk: interrupted\n"


def test_ctrl_c_ends_a_training_and_leaves_nothing_incomplete(tmp_path: Path) -> None:
    arguments = ["train", str(bag("handling", 60.0)), "--out", str(tmp_path / "m")]
    # In background jobs SIGINT is ignored, and child processes inherit that.
    heed_sigint = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
    process = subprocess.Popen(
        [sys.executable, "-c", f"{heed_sigint}; {ADK}", *arguments, "--steps", "1000000"],
        text=True, stderr=subprocess.PIPE, stdout=subprocess.PIPE, stdin=subprocess.DEVNULL,
    )  # fmt: skip
    assert process.stderr is not None
    try:
        # The first line is printed when the bag has been read.
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
    process = adk(env=os.environ | words, capture_output=True)
    assert (process.returncode, process.stdout.split(), process.stderr) == (0, ["replay"], "")
    words |= {"COMP_WORDS": "adk replay --me", "COMP_CWORD": "2"}
    assert adk(env=os.environ | words, capture_output=True).stdout.split() == ["--method"]
    shell_given = {"_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"}
    for shell, script in (
        ("bash", "complete -o default -F _adk_completion adk"),
        ("zsh", "#compdef adk"),
        ("fish", "complete --command adk"),
    ):
        environment = os.environ | shell_given
        process = adk("--show-completion", shell, env=environment, capture_output=True)
        assert process.returncode == 0
        assert script in process.stdout
        assert "_ADK_COMPLETE" in process.stdout


@pytest.mark.parametrize("arguments", [["info", "BAG"], ["info", "BAG", "--json"], ["--help"]])
def test_a_closed_pipe_is_not_an_error(arguments: list[str]) -> None:
    """The case of `adk info ... | head -0`."""
    reading, writing = os.pipe()
    os.close(reading)
    try:
        arguments = [item.replace("BAG", str(bag())) for item in arguments]
        process = adk(*arguments, stdout=writing, stderr=subprocess.PIPE)
    finally:
        os.close(writing)
    assert process.stderr == ""
    assert process.returncode in (0, 1)


def test_help_is_fast() -> None:
    """Completion imports the same modules at each press of the tab key."""
    script = (
        "import sys; sys.argv = ['adk', '--help']\n"
        "from adk_ros.cli.main import main; main()\n"
        "slow = {'torch', 'rosbags', 'numba', 'matplotlib', 'rclpy', 'scipy', 'jinja2'}\n"
        "slow |= {'pandas'}\n"
        "print('loaded:', *sorted(slow & set(sys.modules)))"
    )
    times = []
    for _ in range(2):
        started = time.monotonic()
        process = subprocess.run(
            [sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=60
        )
        times.append(time.monotonic() - started)
    assert process.stdout.splitlines()[-1] == "loaded:"
    assert min(times) < 2.0


def test_numbers_that_are_not_finite_become_null_in_json(capsys) -> None:
    console.print_json({"a": float("nan"), "b": [1.5, float("inf")], 3: {"c": None}})
    printed = json.loads(capsys.readouterr().out)
    assert printed == {"a": None, "b": [1.5, None], "3": {"c": None}}


class Clock:
    """A clock that advances by a second at each reading."""

    def __init__(self) -> None:
        self.now = 0.0

    def monotonic(self) -> float:
        self.now += 1.0
        return self.now


def test_progress_without_a_terminal_is_a_line_every_ten_seconds(capsys, monkeypatch) -> None:
    monkeypatch.setattr(console, "time", Clock())
    with console.progress("counting") as report:
        for number in range(45):
            report(number, 45, "so far so good")
    printed = lines(capsys.readouterr().err)
    assert 3 <= len(printed) <= 5
    assert all(re.fullmatch(r"counting: \d+ %  so far so good", line) for line in printed)
    with console.progress("quick") as report:
        report(1, 2)
    assert capsys.readouterr().err == ""


def test_each_stage_has_its_own_progress(capsys, monkeypatch) -> None:
    monkeypatch.setattr(console, "time", Clock())
    with console.stages() as progress:
        for stage in ("reading", "training"):
            for number in range(15):
                progress(stage, number, 15, "")
    printed = [line.split(":")[0] for line in lines(capsys.readouterr().err)]
    assert printed == ["reading", "training"]


def test_a_new_progress_bar_replaces_the_one_before(monkeypatch) -> None:
    """Older versions of rich refuse two bars at a time."""
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


@pytest.mark.slow
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


def test_linear_algebra_uses_one_thread_unless_told_otherwise() -> None:
    code = "import adk_ros.cli.main, os; print(os.environ['OPENBLAS_NUM_THREADS'])"
    without = {k: v for k, v in os.environ.items() if k != "OPENBLAS_NUM_THREADS"}
    for given, expected in (({}, "1"), ({"OPENBLAS_NUM_THREADS": "2"}, "2")):
        done = subprocess.run(
            [sys.executable, "-c", code],
            env={**without, **given}, capture_output=True, text=True, check=True,
        )  # fmt: skip
        assert done.stdout.strip() == expected
