# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Who may import whom, read from the sources.

`signals` <- `model` <- `train`, `ros`; `signals` <- `plant`; nothing imports `ros` or `cli`.

The core (`signals`, `model`, `plant`, `train`) knows no ROS, never logs, never reads a clock and
never exits: whatever it is told comes in with the data, whatever it has to say comes back as a
value or as an exception.
"""

import ast
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).resolve().parents[2]

# Layer -> what it may import from the package, itself apart. A layer is a folder or a module of
# the package's first level.
MAY_IMPORT = {
    "errors": set(),
    "compiled": set(),
    "finite": set(),
    "report_folder": {"errors"},
    "signals": {"errors"},
    "plant": {"errors", "compiled", "signals"},
    "model": {"errors", "compiled", "signals"},
    "train": {"errors", "signals", "model"},
    "bags": {"errors", "signals"},
    "drives": {"errors", "signals", "bags"},
    "replay": {"errors", "signals", "model", "bags", "drives"},
    "mismatch": {"errors", "compiled", "report_folder", "signals", "plant", "bags"},
    "rollouts": {"errors", "signals", "model", "plant", "bags", "drives", "mismatch"},
    "bag_export": {"errors", "signals", "plant", "bags"},
    "ros": {"errors", "signals", "model", "bags", "drives"},
}
# The top of the house: nobody below imports it. The demonstration prints as the verbs do.
TOP = {"bench", "demo", "cli"}
MAY_IMPORT |= {"bench": {*MAY_IMPORT}, "demo": {*MAY_IMPORT, "cli"}, "cli": {*MAY_IMPORT, *TOP}}
CORE = {"errors", "compiled", "signals", "model", "plant", "train", "mismatch"}

ROS_MODULES = {"rclpy", "rosgraph_msgs", "builtin_interfaces", "rcl_interfaces", "std_srvs"}
ROS_MODULES |= {"ament_index_python", "rosidl_runtime_py", "launch", "launch_ros"}
TORCH_FILES = {"model/lifting.py", "model/artefact.py"}
TERMINAL = {"typer", "rich", "click"}
PAPER = {"matplotlib", "jinja2"}
PICKLES = {"pickle", "cPickle", "dill", "joblib", "shelve", "marshal", "cloudpickle"}

# What the signals and the plant are made of; the rest is chosen more freely.
LEAN = {"signals": {"numpy"}, "plant": {"numpy", "numba", "yaml", "pydantic"}}

EXITS = {"sys.exit", "os._exit", "os.abort", "exit", "quit"}
OUTPUT = {"print", "input", "sys.stdout", "sys.stderr", "warnings.warn"}
CLOCKS = {
    f"{owner}.{name}"
    for owner in ("datetime", "datetime.datetime", "date", "datetime.date")
    for name in ("now", "utcnow", "today")
}


class Module(NamedTuple):
    """A source file: its path below adk_ros, its dotted name, its layer, its syntax tree."""

    path: str
    name: str
    layer: str
    tree: ast.Module


def parse(path: Path, package: Path) -> Module:
    relative = path.relative_to(package)
    parts = relative.with_suffix("").parts
    layer = parts[0]
    # demo.py, demo_report.py, demo/...: one layer, like bench.
    for family in ("demo", "bench"):
        layer = family if layer.startswith(family) else layer
    name = ".".join(("adk_ros", *(part for part in parts if part != "__init__")))
    return Module(relative.as_posix(), name, layer, ast.parse(path.read_text(), str(path)))


def modules_of(package: Path) -> list[Module]:
    return [parse(path, package) for path in sorted(package.rglob("*.py"))]


MODULES = modules_of(ROOT / "adk_ros")


def imports(module: Module) -> Iterator[str]:
    """Yield dotted names that `module` imports, wherever in the file; `from a import b` as a.b."""
    is_package = module.path.endswith("__init__.py")
    for node in ast.walk(module.tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                parts = module.name.split(".")
                parts = parts[: len(parts) - node.level + (1 if is_package else 0)]
                base = ".".join([*parts, base] if base else parts)
            yield from (f"{base}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Call) and dotted(node.func).endswith("import_module"):
            yield from (str(arg.value) for arg in node.args[:1] if isinstance(arg, ast.Constant))


def dotted(node: ast.AST) -> str:
    """`a.b.c` as written, or "" for what is no plain name."""
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Attribute):
        owner = dotted(node.value)
        return f"{owner}.{node.attr}" if owner else ""
    return ""


def is_ros(name: str) -> bool:
    top = name.split(".")[0]
    return top in ROS_MODULES or top.endswith("_msgs")


def internal_faults(module: Module) -> list[str]:
    allowed = MAY_IMPORT.get(module.layer)
    if allowed is None:
        return [f"{module.path}: the layer table has no {module.layer}"]
    faults = []
    for name in imports(module):
        parts = name.split(".")
        if parts[0] != "adk_ros" or len(parts) < 2:
            continue
        target = parts[1]
        for family in ("demo", "bench"):
            target = family if target.startswith(family) else target
        if target != module.layer and target not in allowed:
            faults.append(f"{module.path} imports {name}: {module.layer} may not use {target}")
    return faults


def external_faults(module: Module) -> list[str]:
    faults = []
    for name in imports(module):
        top = name.split(".")[0]
        wrong = (
            (is_ros(name) and module.layer != "ros")
            or (top == "rosbags" and module.layer != "bags")
            or (
                top in {"torch", "tensorboard"}
                and module.layer != "train"
                and module.path not in TORCH_FILES
                # What `adk train` hands a run's scalars to.
                and not (module.layer == "cli" and name.startswith("torch.utils.tensorboard"))
            )
            or (top in TERMINAL and module.layer not in TOP)
            or (
                top in PAPER
                and module.layer not in TOP | {"train"}
                and not module.path.startswith("mismatch/report/")
            )
            or top in PICKLES
            or (
                module.layer in LEAN
                and top not in sys.stdlib_module_names
                and top not in LEAN[module.layer] | {"adk_ros"}
            )
        )
        if wrong:
            faults.append(f"{module.path} imports {name}")
    return faults


def conduct_faults(module: Module) -> list[str]:
    """Clocks, logs, output and exits: none of them in the core."""
    faults = []
    for name in imports(module):
        if name.split(".")[0] in {"logging", "time", "atexit", "signal"} or name in EXITS | OUTPUT:
            faults.append(f"{module.path} imports {name}")
    for node in ast.walk(module.tree):
        line = getattr(node, "lineno", 0)
        if isinstance(node, ast.Name | ast.Attribute):
            name = dotted(node)
            if name in EXITS | OUTPUT | CLOCKS or name == "SystemExit":
                faults.append(f"{module.path}:{line} uses {name}")
    return faults


def unpickling_faults(module: Module) -> list[str]:
    """Calls that would run a stranger's code to read data."""
    faults = []
    safe_loaders = {"yaml.SafeLoader", "yaml.CSafeLoader"}
    for node in ast.walk(module.tree):
        if isinstance(node, ast.ClassDef) and {dotted(base) for base in node.bases} & safe_loaders:
            safe_loaders.add(node.name)
    for node in ast.walk(module.tree):
        if not isinstance(node, ast.Call):
            continue
        options = {keyword.arg: keyword.value for keyword in node.keywords}

        def is_true(name: str, options: dict[str | None, ast.expr] = options) -> bool:
            value = options.get(name)
            return isinstance(value, ast.Constant) and value.value is True

        called = dotted(node.func)
        if is_true("allow_pickle"):
            faults.append(f"{module.path}:{node.lineno} {called}(allow_pickle=True)")
        if called == "torch.load" and not is_true("weights_only"):
            faults.append(f"{module.path}:{node.lineno} torch.load without weights_only=True")
        if called == "yaml.load" and dotted(options.get("Loader", node)) in safe_loaders:
            continue
        if called in {"yaml.load", "yaml.unsafe_load", "yaml.full_load"}:
            faults.append(f"{module.path}:{node.lineno} {called} with a loader that is not safe")
    return faults


def test_there_is_something_to_read() -> None:
    layers = {module.layer for module in MODULES}
    assert {"signals", "model", "train", "plant", "ros", "cli", "bags"} <= layers


@pytest.mark.parametrize("module", MODULES, ids=lambda module: module.path)
def test_layers(module: Module) -> None:
    if module.path == "__init__.py":
        assert not [name for name in imports(module) if name.startswith("adk_ros")]
        return
    assert internal_faults(module) + external_faults(module) == []


@pytest.mark.parametrize(
    "module", [m for m in MODULES if m.layer in CORE], ids=lambda module: module.path
)
def test_the_core_neither_logs_nor_waits_nor_exits(module: Module) -> None:
    assert conduct_faults(module) == []


@pytest.mark.parametrize("module", MODULES, ids=lambda module: module.path)
def test_nothing_is_unpickled(module: Module) -> None:
    assert unpickling_faults(module) == []


def test_no_cycles_between_layers() -> None:
    """The table itself must be free of them, else it would allow what it is to prevent."""
    remaining = {layer: set(below) - {layer} for layer, below in MAY_IMPORT.items()}
    remaining["demo"] -= {"cli"}
    while remaining:
        free = {layer for layer, below in remaining.items() if not below & set(remaining)}
        assert free, f"cycle among {sorted(remaining)}"
        for layer in free:
            del remaining[layer]


@pytest.mark.parametrize(
    ("path", "source", "fault"),
    [
        ("signals/bad.py", "from adk_ros.model import predictor", "may not use model"),
        ("signals/bad.py", "from ..model.predictor import Predictor", "may not use model"),
        ("plant/bad.py", "import adk_ros.ros.node", "may not use ros"),
        ("model/bad.py", "def f():\n    import adk_ros.cli.main", "may not use cli"),
        ("train/bad.py", "from adk_ros import bags", "may not use bags"),
        ("novelty.py", "import math", "layer table"),
        ("cli/bad.py", "import rclpy", "imports rclpy"),
        ("cli/bad.py", "from sensor_msgs.msg import Imu", "imports sensor_msgs"),
        ("ros/bad.py", "from rosbags.rosbag2 import Reader", "imports rosbags"),
        ("model/predictor.py", "import torch", "imports torch"),
        ("cli/bad.py", "import importlib\nimportlib.import_module('torch')", "imports torch"),
        ("bags/bad.py", "from rich.progress import track", "imports rich"),
        ("ros/bad.py", "from rich.live import Live", "imports rich"),
        ("model/bad.py", "import matplotlib.pyplot", "imports matplotlib"),
        ("mismatch/bad.py", "import matplotlib.pyplot", "imports matplotlib"),
        ("bench/bad.py", "from adk_ros.cli import main", "may not use cli"),
        ("cli/bad.py", "import pickle", "imports pickle"),
        ("signals/bad.py", "import scipy.signal", "imports scipy"),
        ("model/bad.py", "import logging", "imports logging"),
        ("model/bad.py", "from time import monotonic", "imports time"),
        ("model/bad.py", "import sys\nsys.exit(2)", "uses sys.exit"),
        ("model/bad.py", "raise SystemExit(2)", "uses SystemExit"),
        ("plant/bad.py", "print(1)", "uses print"),
        ("train/bad.py", "import datetime\ndatetime.datetime.now()", "uses datetime.datetime.now"),
        ("model/bad.py", "import numpy\nnumpy.load('a', allow_pickle=True)", "allow_pickle"),
        ("train/bad.py", "import torch\ntorch.load('a')", "weights_only"),
        ("plant/bad.py", "import yaml\nyaml.load('a', Loader=yaml.Loader)", "not safe"),
        ("plant/bad.py", "import yaml\nyaml.unsafe_load('a')", "not safe"),
    ],
)
def test_faults_are_seen(tmp_path: Path, path: str, source: str, fault: str) -> None:
    """The reader of the sources, on sources that break each rule."""
    file = tmp_path / path
    file.parent.mkdir(exist_ok=True)
    file.write_text(source)
    module = parse(file, tmp_path)
    found = internal_faults(module) + external_faults(module) + unpickling_faults(module)
    if module.layer in CORE:
        found += conduct_faults(module)
    assert any(fault in line for line in found), found
