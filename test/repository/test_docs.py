# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The documentation: generated parts are up to date, the site builds, what it names exists."""

from __future__ import annotations

import base64
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import draw_packages
import generate_docs
import numpy as np
import paper_report
import pytest
import typer
import yaml
from helpers.paper import good_board
from matplotlib import pyplot as plt

import adk_ros
from adk_ros.bench.paper.criteria import evaluate_paper_criteria
from adk_ros.bench.paper.headline import headline
from adk_ros.cli.main import app
from adk_ros.mismatch.library.catalogue import EFFECTS

ROOT = Path(__file__).resolve().parents[2]
DOC = ROOT / "doc"
PAGES = sorted(path for path in DOC.rglob("*.md") if "paper" not in path.relative_to(DOC).parts)
TEXTS = [
    *PAGES,
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md", "bags/README.md")),
]

SOURCES = [
    path.relative_to(ROOT).as_posix()
    for folder in ("adk_ros", "examples", "launch", "scripts", "test")
    for path in (ROOT / folder).rglob("*.py")
] + ["setup.py"]


def page_id(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


@pytest.fixture(scope="module")
def generated() -> dict[str, str]:
    return {page_id(path): text for path, text in generate_docs.files()}


@pytest.mark.parametrize("name", [*generate_docs.generated(), "doc/packages.svg"])
def test_generated_parts_are_up_to_date(generated: dict[str, str], name: str) -> None:
    assert (ROOT / name).read_text() == generated[name], "run: make docs"


def test_unmarked_page_is_refused() -> None:
    parts = {"parameters": "| a |"}
    marked = "before\n<!-- parameters -->\nold\n<!-- /parameters -->\nafter\n"
    filled = generate_docs.fill(marked, parts, "page.md")
    assert filled == "before\n<!-- parameters -->\n\n| a |\n\n<!-- /parameters -->\nafter\n"
    assert generate_docs.fill(filled, parts, "page.md") == filled
    for text in ("no marks", marked + marked):
        with pytest.raises(SystemExit, match=r"page\.md needs <!-- parameters -->"):
            generate_docs.fill(text, parts, "page.md")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the site as `make docs` does; a warning is an error."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "-d", str(folder)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


def test_site_has_every_page_and_loads_nothing_from_other_hosts(site: Path) -> None:
    assert (site / "paper" / "report.html").is_file()
    for path in PAGES:
        page = (site / path.relative_to(DOC)).with_suffix(".html")
        html = page.read_text()
        loaded = re.findall(r"<(?:script|img|iframe)[^>]*\bsrc=\"?([^\s\">]+)", html)
        loaded += re.findall(r"<link[^>]*rel=\"?stylesheet\"?[^>]*href=\"?([^\s\">]+)", html)
        assert loaded
        assert [link for link in loaded if link.startswith(("http", "//"))] == [], page


def test_build_reports_a_broken_link_and_a_broken_anchor(tmp_path: Path) -> None:
    options = yaml.safe_load(re.sub(r"(?m)^plugins:\n(?:  .*\n)+", "", text("mkdocs.yml")))
    options |= {"docs_dir": "pages", "nav": [{"Overview": "index.md"}], "extra_css": []}
    (tmp_path / "pages").mkdir()
    (tmp_path / "mkdocs.yml").write_text(yaml.safe_dump(options))
    for link in ("missing.md", "index.md#missing", "#missing"):
        (tmp_path / "pages" / "index.md").write_text(f"# Page\n\n[link]({link})\n")
        command = [sys.executable, "-m", "mkdocs", "build", "--strict"]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode != 0, link
        assert link in done.stderr


def text(name: str) -> str:
    return (ROOT / name).read_text()


def test_every_effect_is_listed() -> None:
    listed = re.findall(r"^\| `(\w+)` \|", text("doc/reference/effects.md"), re.MULTILINE)
    assert sorted(listed) == sorted(EFFECTS)


def test_every_public_name_is_documented() -> None:
    page = text("doc/reference/python.md")
    documented = {
        line.rsplit(".", 1)[1] for line in re.findall(r"^::: (\S+)$", page, re.MULTILINE)
    }
    assert documented == set(adk_ros.__all__)


def test_every_package_is_listed_for_contributors() -> None:
    folders = {
        path.parent.relative_to(ROOT).as_posix()
        for path in (ROOT / "adk_ros").rglob("*.py")
        if path.parent != ROOT / "adk_ros"
    }
    table = text("CONTRIBUTING.md")
    assert [folder for folder in sorted(folders) if f"| `{folder}` |" not in table] == []


def small_package(root: Path, **modules: str) -> None:
    """Write the packages of a small adk_ros below `root`."""
    (root / "adk_ros").mkdir(parents=True)
    (root / "adk_ros" / "__init__.py").write_text('"""Package."""\n')
    for name, imports in modules.items():
        folder = root / "adk_ros" / name
        folder.mkdir()
        (folder / "__init__.py").write_text(f'"""Purpose of {name}. More."""\n')
        (folder / "code.py").write_text(f'"""Code."""\n{imports}\n')


def test_packages_are_drawn_with_direct_imports(tmp_path: Path) -> None:
    small_package(
        tmp_path,
        cli="from adk_ros.model import code\nfrom ..signals import code as other",
        model="import adk_ros.signals.code",
        signals="import math",
    )
    counts = draw_packages.graph(tmp_path)
    assert set(counts) == {("cli", "model"), ("cli", "signals"), ("model", "signals")}
    assert draw_packages.direct(counts) == [("cli", "model"), ("model", "signals")]
    picture = draw_packages.drawing(tmp_path)
    assert picture.count('class="arc"') == 2
    assert "Purpose of signals<" in picture
    assert draw_packages.table(tmp_path).splitlines()[-1] == (
        "| `adk_ros/signals` | Purpose of signals |"
    )


def test_uphill_import_and_unknown_package_are_not_drawn(tmp_path: Path) -> None:
    small_package(tmp_path / "a", cli="", signals="from adk_ros.cli import code")
    with pytest.raises(SystemExit, match="adk_ros/signals imports adk_ros/cli"):
        draw_packages.drawing(tmp_path / "a")
    small_package(tmp_path / "b", novelty="")
    with pytest.raises(SystemExit, match="novelty"):
        draw_packages.drawing(tmp_path / "b")


@pytest.mark.parametrize("name", ["packages.svg", "pipeline.svg"])
def test_pictures_follow_light_and_dark_mode(name: str) -> None:
    picture = text(f"doc/{name}")
    light, dark = picture.split("prefers-color-scheme: dark")
    assert ".page { fill: #ffffff }" in light
    assert ".page {" in dark


def test_decision_records_are_numbered_and_complete() -> None:
    records = sorted(path.name for path in (DOC / "decisions").glob("0*.md"))
    assert len(records) >= 10
    assert [int(name[:4]) for name in records] == list(range(1, len(records) + 1))
    index = text("doc/decisions/index.md")
    for name in records:
        assert f"({name})" in index
        sections = re.findall(r"^## (\w+)$", text(f"doc/decisions/{name}"), re.MULTILINE)
        assert sections == ["Context", "Decision", "Consequences"], name


@pytest.mark.parametrize("path", TEXTS, ids=page_id)
def test_named_source_files_exist(path: Path) -> None:
    for name in re.findall(r"`([\w/.]+\.py)`", path.read_text()):
        assert any(f"/{file}".endswith(f"/{name}") for file in SOURCES), name


def commands() -> dict[str, Any]:
    """Return command -> definition, those of groups as `bench NAME`."""
    root: Any = typer.main.get_command(app)
    found = {}
    for name, command in root.commands.items():
        inner = getattr(command, "commands", None)
        if inner is None:
            found[name] = command
        else:
            found |= {f"{name} {verb}": definition for verb, definition in inner.items()}
    return found


@pytest.mark.parametrize("path", TEXTS, ids=page_id)
def test_commands_in_code_exist_with_their_options(path: Path) -> None:
    known = commands()
    content = path.read_text().replace("\\\n", " ")
    lines = [
        line for block in re.findall(r"```\w*\n(.*?)```", content, re.DOTALL)
        for line in block.splitlines()
    ]  # fmt: skip
    lines += re.findall(r"`(adk [a-z][^`]+)`", content)
    for line in lines:
        call = re.match(r"[\s$]*(?:\.venv/bin/)?adk ((?:(?:bench|fleet) )?[a-z]+)(.*)", line)
        if call is None:
            continue
        verb, arguments = call[1], call[2].split(" #")[0].split("or `")[0]
        if verb in {"bench", "fleet"}:
            continue
        assert verb in known, line
        options = {name for p in known[verb].params for name in (*p.opts, *p.secondary_opts)}
        used = re.findall(r"(?<!\S)(--[a-z-]+)", arguments)
        assert set(used) <= options | {"--help"}, line


def test_configuration_files_are_valid() -> None:
    citation = yaml.safe_load(text("CITATION.cff"))
    version = re.search(r"<version>(.*)</version>", text("package.xml"))
    assert version is not None
    assert citation["version"] == version[1]
    workflow = yaml.safe_load(text(".github/workflows/test.yml"))
    steps = [step.get("run", "") for job in workflow["jobs"].values() for step in job["steps"]]
    assert any(step.startswith("make test ") for step in steps)
    assert any(step.startswith("make test-all ") for step in steps)
    for form in (ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml"):
        assert yaml.safe_load(form.read_text()), form
    (hooks,) = yaml.safe_load(text(".pre-commit-config.yaml"))["repos"]
    assert {hook["id"] for hook in hooks["hooks"]} >= {"ruff-check", "ruff-format", "mypy"}


def test_maintainer_address_is_not_an_example() -> None:
    for name in ("package.xml", "setup.py"):
        addresses = re.findall(r"[\w.+-]+@[\w.-]+", text(name))
        assert addresses
        assert [a for a in addresses if "example" in a] == [], name


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """Return a folder as `adk bench paper` writes it, with one figure and one table."""
    folder = tmp_path / "run"
    for name in ("tables", "figures"):
        (folder / name).mkdir(parents=True)
    board = good_board()
    headline(board, "One seed.").write(folder)
    (folder / "criteria.txt").write_text(
        "".join(f"{criterion}\n" for criterion in evaluate_paper_criteria(board, None))
    )
    figure, axis = plt.subplots()
    axis.plot(np.random.default_rng(1).standard_normal((500, 3)))
    figure.savefig(folder / "figures" / "summary.png")
    plt.close(figure)
    picture = base64.b64encode((folder / "figures" / "summary.png").read_bytes()).decode()
    (folder / "report.html").write_text(f'<img src="data:image/png;base64,{picture}">')
    (folder / "claims.md").write_text("# The paper's claims\n")
    (folder / "tables" / "summary.md").write_text("### Summary\n")
    (folder / "scores.csv").write_text("not for the repository\n")
    return folder


def results_page(paper: Path) -> str:
    name = "doc/results.md"
    return generate_docs.fill(text(name), generate_docs.generated(paper)[name], name)


def test_report_is_copied_and_summarised(run: Path, tmp_path: Path) -> None:
    paper = tmp_path / "paper"
    without_report = results_page(paper)
    assert "<!-- paper -->\n<!-- /paper -->" in without_report
    (paper / "tables").mkdir(parents=True)
    (paper / "tables" / "old.md").write_text("of the previous report")
    size = paper_report.take_report(run, paper)
    files = {path.relative_to(paper).as_posix() for path in paper.rglob("*") if path.is_file()}
    assert files == {
        "report.html", "headline.md", "headline.csv", "claims.md", "criteria.txt",
        "tables/summary.md", "figures/summary.png",
    }  # fmt: skip
    assert size == sum((paper / name).stat().st_size for name in files)
    picture = (paper / "figures" / "summary.png").read_bytes()
    assert len(picture) < 0.8 * (run / "figures" / "summary.png").stat().st_size
    assert base64.b64encode(picture).decode() in (paper / "report.html").read_text()
    page = results_page(paper)
    assert "| **adk_ros** | **0.100** |" in page
    assert "- **PASS** `geometric-mean`: 0.100 of" in page
    assert "paper/figures/summary.png" in page
    (paper / "headline.md").unlink()
    assert results_page(paper) == without_report


def test_criteria_of_an_earlier_report_have_their_present_names(run: Path) -> None:
    now = paper_report.paper_summary(run)
    assert "`no-combination-above-1`" in now
    assert "`coverage-by-combination`" in now
    criteria = (run / "criteria.txt").read_text()
    for before, name in paper_report.RENAMED_CRITERIA.items():
        assert f" {name} " in criteria
        criteria = criteria.replace(f" {name} ", f" {before} ")
    (run / "criteria.txt").write_text(criteria)
    assert paper_report.paper_summary(run) == now


def test_an_earlier_report_is_copied_under_the_present_names(run: Path, tmp_path: Path) -> None:
    now = paper_report.paper_summary(run)
    (run / "criteria.txt").rename(run / "bars.txt")
    assert paper_report.paper_summary(run) == now
    paper = tmp_path / "paper"
    paper.mkdir()
    (paper / "bars.txt").write_text("of the previous report\n")
    paper_report.take_report(run, paper)
    assert not (paper / "bars.txt").exists()
    assert paper_report.paper_summary(paper) == now


def test_incomplete_or_large_report_changes_nothing(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    paper = tmp_path / "paper"
    with pytest.raises(SystemExit, match=r"it has no report\.html"):
        paper_report.take_report(tmp_path / "nothing", paper)
    monkeypatch.setattr(paper_report, "MAX_BYTES", 1000)
    with pytest.raises(SystemExit, match="MB for doc/paper"):
        paper_report.take_report(run, paper)
    assert not paper.exists()
