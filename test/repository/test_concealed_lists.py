# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the documents state over all lists of concealed effects is the sum of their output."""

from __future__ import annotations

from pathlib import Path

from concealed_lists import CRITERIA, LISTS, figures_of, table

ROOT = Path(__file__).parents[2]


def test_the_table_in_the_documentation_is_made_from_the_lists() -> None:
    page = ROOT / "doc" / "mismatch-validation.md"
    assert "\n".join(table(LISTS)) in page.read_text(encoding="utf-8")


def test_the_readme_states_the_same_sums() -> None:
    together = {line.split(" | ")[0]: line.split(" | ")[-2] for line in table(LISTS)[2:]}
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    (row,) = (x for x in readme.splitlines() if x.startswith("| all of fourteen such lists"))
    for name in ("singles-strength-1", "singles-strength-0.3", "unlisted-unknown", "false-alarms"):
        assert together[f"| {CRITERIA[name][0]}"] in row


def test_the_last_list_is_the_output_that_the_documentation_links() -> None:
    last = max(LISTS.glob("seed_*.txt"), key=lambda path: int(path.stem.split("_")[1]))
    assert last.read_text() == (ROOT / "doc" / "concealed" / "criteria.txt").read_text()


def test_a_wrong_claim_is_subtracted_from_its_list_alone() -> None:
    text = "PASS confident-claims-right 1.000 of 159 claims (at least 0.95)\n"
    assert figures_of(text, 11)["confident-claims-right"].value == 1.0 - 1.0 / 159.0
    assert figures_of(text, 12)["confident-claims-right"].value == 1.0
