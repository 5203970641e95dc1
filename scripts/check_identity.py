# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Show that a change of structure changes no result.

Runs this checkout and an earlier revision on the same inputs and compares them: the predictions of
one model folder on both sample bags, byte by byte, and `mismatch.json` on recordings with a known
effect: verdict, names, alternatives, values and interval limits.

Example: python scripts/check_identity.py 8313453 --cases ../shared/concealed/cases
"""

from __future__ import annotations

import argparse
import filecmp
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
BAGS = ("town", "handling")
TOLERANCE = 1e-6
"""Largest relative difference of a value that counts as none."""
_RUN = "import sys; sys.path.insert(0, sys.argv.pop(1)); from adk_ros.cli.main import main; main()"


def adk(tree: Path, *arguments: object) -> None:
    """Run the command line of the package in `tree` with this interpreter."""
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-c", _RUN, str(tree), *map(str, arguments)]
    done = subprocess.run(
        command, cwd=tree, env=environment, capture_output=True, text=True, check=False
    )
    if done.returncode:
        last = (done.stderr.strip().splitlines() or ["no message"])[-1]
        sys.exit(f"adk {' '.join(map(str, arguments))} in {tree} failed: {last}")


def replay_once(tree: Path, bag: str, model: Path, out: Path) -> Path:
    """
    Replay a sample bag unless `out` has it; return the file with the predictions.

    The file contains the name of its folder, which must therefore be the same for both revisions.
    """
    if not out.exists():
        adk(tree, "replay", ROOT / "bags" / bag, "--model", model, "--out", out, "--with-horizon")
    return next(out.glob("*.mcap"))


def explain_once(tree: Path, case: Path, out: Path) -> dict[str, Any]:
    """Analyse a case unless `out` has it; return the content of `mismatch.json`."""
    if not (out / "mismatch.json").exists():
        adk(
            tree, "mismatch", "--simulation", case / "simulation", "--recording",
            case / "recording", "--vehicle", case / "vehicle.yaml", "--out", out,
        )  # fmt: skip
    result: dict[str, Any] = json.loads((out / "mismatch.json").read_text())
    return result


def differences(before: dict[str, Any], after: dict[str, Any]) -> tuple[list[str], float, float]:
    """Return what differs in words, and the largest relative differences of values and limits."""
    texts = []
    if before["verdict"] != after["verdict"]:
        texts.append(f"verdict {before['verdict']} -> {after['verdict']}")
    names = [[e["name"] for e in result["effects"]] for result in (before, after)]
    if names[0] != names[1]:
        return [*texts, f"effects {names[0]} -> {names[1]}"], float("inf"), float("inf")
    values, limits = [0.0], [0.0]
    for old, new in zip(before["effects"], after["effects"], strict=True):
        if sorted(old["alternatives"]) != sorted(new["alternatives"]):
            texts.append(f"{old['name']}: {old['alternatives']} -> {new['alternatives']}")
        for name, one in old["parameters"].items():
            other = new["parameters"][name]
            size = max(abs(one["value"]), 1e-12)
            values.append(abs(one["value"] - other["value"]) / size)
            limits += [abs(one[k] - other[k]) / size for k in ("low", "high")]
    for key in ("before", "after"):
        for channel, one in before["fit"][key].items():
            other = after["fit"][key][channel]
            if (one is None) != (other is None):
                texts.append(f"held-out error of {channel}: {one} -> {other}")
            elif one is not None:
                values.append(abs(one - other) / max(abs(one), 1e-12))
    return texts, max(values), max(limits)


def main() -> int:
    """Compare and print; return 1 where anything differs by more than the tolerance."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument("revision", help="git revision to compare with")
    parser.add_argument("--cases", type=Path, help="folder of cases for adk mismatch")
    parser.add_argument("--only", nargs="*", help="names of the cases to compare")
    parser.add_argument("--out", type=Path, default=Path("identity_out"))
    options = parser.parse_args()
    out = options.out.resolve()
    tree = out / "revision"
    if not tree.exists():
        tree.mkdir(parents=True)
        archive = ["git", "-C", str(ROOT), "archive", options.revision]
        content = subprocess.run(archive, check=True, capture_output=True).stdout
        subprocess.run(["tar", "-x", "-C", str(tree)], input=content, check=True)
    model, failed = out / "model", False
    if not model.exists():
        adk(tree, "train", ROOT / "bags" / "handling", "--out", model, "--steps", 1500)
    for bag in BAGS:
        old = replay_once(tree, bag, model, out / "before" / bag)
        new = replay_once(ROOT, bag, model, out / "after" / bag)
        same = filecmp.cmp(old, new, shallow=False)
        failed |= not same
        print(f"predictions on bags/{bag}: {'bit-identical' if same else 'DIFFERENT'}")
    cases = sorted(p for p in options.cases.iterdir() if p.is_dir()) if options.cases else []
    for case in cases:
        if options.only and case.name not in options.only:
            continue
        old_result = explain_once(tree, case, out / "before" / case.name)
        new_result = explain_once(ROOT, case, out / "after" / case.name)
        texts, value, limit = differences(old_result, new_result)
        failed |= bool(texts) or value > TOLERANCE
        effects = ", ".join(e["name"] for e in new_result["effects"]) or "-"
        print(
            f"case {case.name}: {new_result['verdict']:9} {effects}: "
            f"values differ by {value:.1e}, interval limits by {limit:.1e} of the value"
            + "".join(f"; {text}" for text in texts)
        )
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
