# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Imports, read from the sources: they run downhill, and no cycle exists between files or folders.

The core knows no ROS, never logs, prints, reads a clock or exits: what it needs comes in with the
data, what it has to say comes back as a value or as an exception.
"""

import ast
import sys
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).resolve().parents[2]

# From low to high: a module may import from lower entries and from its own folder alone. An entry
# is a folder or a module, relative to its parent; "" is the parent's own modules.
ORDER: dict[str, tuple[str, ...]] = {
    "": (
        "errors", "numerics", "files", "shutdown", "signals", "plant", "model", "train", "bags",
        "road", "calibration", "mismatch", "importing", "offline", "exporting", "fleet", "ros",
        "api", "bench", "cli", "",
    ),
    "plant": (
        "environment", "vehicle", "identification", "scenario", "injection", "",
    ),
    "model": ("lifting", "estimation", "adaptation", "uncertainty", ""),
    "mismatch": (
        "library", "recording", "surrogate", "inference", "deployment", "report", "watch",
        "",
    ),
    "bench": (
        "fleet", "control", "vehicles", "paper", "runtime", "mismatch", "real", "learned", "",
    ),
}  # fmt: skip
CORE = {"errors", "numerics", "signals", "model", "plant", "train", "road", "calibration"}
CORE |= {"mismatch"}
BENCH_VERBS = "cli/bench"
"""Beginning of the only product files that may import from the benchmarks."""

ROS_MODULES = {"rclpy", "rosgraph_msgs", "builtin_interfaces", "rcl_interfaces", "std_srvs"}
ROS_MODULES |= {"ament_index_python", "rosidl_runtime_py", "launch", "launch_ros"}
TORCH_FILES = {"model/lifting/encoder.py", "model/artefact.py"}
# Runs the networks of others, in their environment.
TORCH_FILES |= {"bench/learned/learned_model_worker.py"}
TERMINAL = {"typer", "rich", "click"}
TABLES = {"pandas"}
TABLE_LAYERS = {"importing", "exporting", "api", "cli"}
PAGES = {"matplotlib", "jinja2"}
PAGE_LAYERS = {"files", "train", "api", "bench", "cli"}
PICKLES = {"pickle", "cPickle", "dill", "joblib", "shelve", "marshal", "cloudpickle"}

# Third-party modules that the lowest layers are made of; the rest is chosen more freely.
LEAN = {
    "numerics": {"numpy", "numba"},
    "signals": {"numpy"},
    "plant": {"numpy", "numba", "yaml", "pydantic"},
}

EXITS = {"sys.exit", "os._exit", "os.abort", "exit", "quit"}
OUTPUT = {"print", "input", "sys.stdout", "sys.stderr", "warnings.warn"}
CLOCKS = {
    f"{owner}.{name}"
    for owner in ("datetime", "datetime.datetime", "date", "datetime.date")
    for name in ("now", "utcnow", "today")
}


READ = (ast.Import, ast.ImportFrom, ast.Call, ast.Name, ast.Attribute, ast.ClassDef)
"""Kinds of nodes that the rules look at."""


class Module(NamedTuple):
    """A source file: path below adk_ros, dotted name, layer, nodes of `READ`, imported names."""

    path: str
    name: str
    layer: str
    nodes: tuple[ast.AST, ...]
    imports: tuple[str, ...]


def parse(path: Path, package: Path) -> Module:
    relative = path.relative_to(package)
    parts = relative.with_suffix("").parts
    name = ".".join(("adk_ros", *(part for part in parts if part != "__init__")))
    layer = "" if parts == ("__init__",) else parts[0]
    tree = ast.parse(path.read_text(), str(path))
    nodes = tuple(node for node in ast.walk(tree) if isinstance(node, READ))
    is_package = path.name == "__init__.py"
    return Module(relative.as_posix(), name, layer, nodes, tuple(imports(name, is_package, nodes)))


@cache
def modules() -> list[Module]:
    package = ROOT / "adk_ros"
    return [parse(path, package) for path in sorted(package.rglob("*.py"))]


@cache
def known_modules() -> dict[str, Module]:
    return {module.name: module for module in modules()}


def imports(name: str, is_package: bool, nodes: Iterable[ast.AST]) -> Iterator[str]:
    """Yield dotted names that a module imports, wherever in the file; `from a import b` as a.b."""
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                parts = name.split(".")
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


def resolved(name: str, known: Mapping[str, Module]) -> str:
    """The module that a dotted name, perhaps of something inside it, belongs to; "" if none."""
    while name and name not in known:
        name = name.rpartition(".")[0]
    return name


def internal_imports(module: Module, known: Mapping[str, Module]) -> set[str]:
    """The package's modules that `module` imports, itself apart."""
    names = {
        # What is not there yet counts by its name: a fault must not hide behind a typing error.
        resolved(name, known) if resolved(name, known) not in {"", "adk_ros"} else name
        for name in module.imports
        if name == "adk_ros" or name.startswith("adk_ros.")
    }
    return names - {module.name}


def rank(path: tuple[str, ...], parent: str) -> tuple[str, int]:
    """The entry of `ORDER[parent]` that a module below it belongs to, and its place there."""
    order = ORDER[parent]
    entry = path[0] if path and path[0] in order else ""
    if not parent and entry == "" and path:
        raise KeyError(path[0])
    return entry, order.index(entry)


def internal_faults(module: Module, known: Mapping[str, Module]) -> list[str]:
    """Imports that run uphill, at any level of the tree."""
    own = tuple(module.name.split(".")[1:])
    faults = []
    for name in sorted(internal_imports(module, known)):
        target, here, parent = tuple(name.split(".")[1:]), own, ""
        try:
            while parent in ORDER:
                (above, at), (below, to) = rank(here, parent), rank(target, parent)
                if above != below or not above:
                    if to > at:
                        faults.append(f"{module.path} imports {name}: {above} may not use {below}")
                    break
                here, target, parent = here[1:], target[1:], f"{parent}.{above}".strip(".")
        except KeyError as error:
            faults.append(f"{module.path}: the order of layers has no {error}")
        if (
            name.startswith("adk_ros.bench")
            and module.layer != "bench"
            and not (module.path.startswith(BENCH_VERBS))
        ):
            faults.append(f"{module.path} imports {name}: the product may not use bench")
    return faults


def cycle(graph: Mapping[str, set[str]]) -> set[str]:
    """The nodes of a graph that are left when all that lead nowhere are taken away in turn."""
    left = {node: set(below) - {node} for node, below in graph.items()}
    while free := [node for node, below in left.items() if not below & set(left)]:
        for node in free:
            del left[node]
    return set(left)


def folder_of(name: str, known: Mapping[str, Module]) -> str:
    """The folder of a module; a module directly in adk_ros is a layer of its own, as in ORDER."""
    folder = name.rpartition(".")[0]
    is_folder = known[name].path.endswith("__init__.py")
    return name if is_folder or folder == "adk_ros" else folder


def graphs(known: Mapping[str, Module]) -> tuple[dict[str, set[str]], dict[str, set[str]]]:
    """Import graphs of the files, and of the folders that they lie in."""
    files = {n: {i for i in internal_imports(m, known) if i in known} for n, m in known.items()}
    folders: dict[str, set[str]] = {}
    for name, below in files.items():
        here = folders.setdefault(folder_of(name, known), set())
        here |= {folder_of(other, known) for other in below}
    return files, folders


def external_faults(module: Module) -> list[str]:
    faults = []
    for name in module.imports:
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
            or (top in TERMINAL and module.layer not in {"bench", "cli"})
            or (top in TABLES and module.layer not in TABLE_LAYERS)
            or (
                top in PAGES
                and module.layer not in PAGE_LAYERS
                and not module.path.startswith(("mismatch/report/", "fleet/report/"))
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
    for name in module.imports:
        if name.split(".")[0] in {"logging", "time", "atexit", "signal"} or name in EXITS | OUTPUT:
            faults.append(f"{module.path} imports {name}")
    for node in module.nodes:
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
    for node in module.nodes:
        if isinstance(node, ast.ClassDef) and {dotted(base) for base in node.bases} & safe_loaders:
            safe_loaders.add(node.name)
    for node in module.nodes:
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


def test_the_sources_are_found() -> None:
    layers = {module.layer for module in modules()}
    assert {*ORDER[""]} - {"api"} <= layers


def test_imports_run_downhill() -> None:
    known = known_modules()
    assert not [
        fault for module in modules()
        for fault in (*internal_faults(module, known), *external_faults(module))
    ]  # fmt: skip


def test_no_import_cycle_between_files_or_folders() -> None:
    files, folders = graphs(known_modules())
    assert len(files) == len(modules())
    assert cycle(files) == set()
    assert cycle(folders) == set()


def test_cycles_are_seen() -> None:
    assert cycle({"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}, "e": set()}) >= {"a", "b", "c"}
    assert cycle({"a": {"b"}, "b": {"c"}, "c": set()}) == set()


def test_the_core_neither_logs_nor_waits_nor_exits() -> None:
    core = [module for module in modules() if module.layer in CORE]
    assert not [fault for module in core for fault in conduct_faults(module)]


def test_nothing_is_unpickled() -> None:
    assert not [fault for module in modules() for fault in unpickling_faults(module)]


@pytest.mark.parametrize(
    ("path", "source", "fault"),
    [
        ("signals/bad.py", "from adk_ros.model import predictor", "may not use model"),
        ("signals/bad.py", "from ..model.predictor import Predictor", "may not use model"),
        ("plant/bad.py", "import adk_ros.ros.node", "may not use ros"),
        ("model/bad.py", "def f():\n    import adk_ros.cli.main", "may not use cli"),
        ("train/bad.py", "from adk_ros import bags", "may not use bags"),
        ("novelty.py", "import adk_ros.errors", "order of layers"),
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
        ("cli/train.py", "from adk_ros.bench.paper import cases", "may not use bench"),
        ("bags/bad.py", "import adk_ros", "may not use"),
        ("mismatch/library/bad.py", "import adk_ros.mismatch.inference", "may not use inference"),
        (
            "mismatch/surrogate/bad.py",
            "from adk_ros.mismatch import analysis",
            "surrogate may not",
        ),
        ("api/bad.py", "from torch import nn", "imports torch"),
        ("offline/bad.py", "import pandas", "imports pandas"),
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
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(source)
    module = parse(file, tmp_path)
    found = (
        internal_faults(module, known_modules())
        + external_faults(module)
        + unpickling_faults(module)
    )
    if module.layer in CORE:
        found += conduct_faults(module)
    assert any(fault in line for line in found), found
