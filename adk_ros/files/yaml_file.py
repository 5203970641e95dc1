# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Parameter files: YAML into a frozen typed model, or one line that says what is wrong where."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from difflib import get_close_matches
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar

import yaml  # type: ignore[import-untyped, unused-ignore]
from pydantic import BaseModel, ConfigDict, ValidationError

from adk_ros.errors import UsageError

_SHOWN = 40
"""Characters of a wrong value that its error repeats."""

M = TypeVar("M", bound="FileModel")


class FileModel(BaseModel):
    """Base of all that is read from a parameter file: frozen, no unknown keys, finite numbers."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


class _Loader(yaml.SafeLoader):  # type: ignore[misc, unused-ignore]
    """Safe YAML in which a key given twice is an error instead of a silent choice."""

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Hashable, Any]:
        seen: set[str] = set()
        for key_node, _ in node.value:
            if not isinstance(key_node, yaml.ScalarNode):
                continue
            key = key_node.value
            if key in seen and key != "<<":
                raise yaml.constructor.ConstructorError(
                    None, None, f"key '{key}' is given twice", key_node.start_mark
                )
            seen.add(key)
        mapping: dict[Hashable, Any] = super().construct_mapping(node, deep)
        return mapping


def packaged(kind: str) -> list[str]:
    """Return the names of the parameter files of a kind that come with the package, sorted."""
    ending = f".{kind}.yaml"
    folder = resources.files("adk_ros.plant") / "data"
    names = [item.name for item in folder.iterdir()]
    return sorted(name.removesuffix(ending) for name in names if name.endswith(ending))


def _text(source: str | Path, kind: str) -> tuple[str, str]:
    path = Path(source)
    if path.suffix not in {".yaml", ".yml"} and not path.is_file():
        known = packaged(kind)
        if str(source) not in known:
            raise UsageError(
                f"{source}: no such {kind}; give a YAML file"
                + (f" or one of: {', '.join(known)}" if known else "")
            )
        name = f"{source}.{kind}.yaml"
        file = resources.files("adk_ros.plant") / "data" / name
        return name, file.read_text(encoding="utf-8")
    try:
        return str(path), path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise UsageError(f"{path}: no such {kind} file") from None
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise UsageError(f"{path}: cannot read the {kind} file: {reason}") from None


def read(source: str | Path, kind: str) -> tuple[str, dict[str, Any]]:
    """
    Return a parameter file's name, for messages, and its content as it stands there.

    `source` as for `load`; raises `UsageError` naming the file.
    """
    name, text = _text(source, kind)
    try:
        content = yaml.load(text, Loader=_Loader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        place = f" at line {mark.line + 1}" if mark is not None else ""
        problem = getattr(error, "problem", None) or "not valid YAML"
        raise UsageError(f"{name}: {problem}{place}") from None
    except (ValueError, RecursionError):
        raise UsageError(f"{name}: not valid YAML") from None
    if not isinstance(content, dict):
        raise UsageError(f"{name}: expected a mapping of {kind} parameters at the top level")
    return name, content


def load(source: str | Path, kind: str, model: type[M]) -> M:
    """
    Read a parameter file into `model`.

    `source` is a YAML file's path, or the bare name of one that comes with the package
    (`data/<name>.<kind>.yaml`). Raises `UsageError` naming the file and the first bad key.
    """
    return validate(*read(source, kind), model)


def with_replacements(base: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """Return `base` with the keys of `changes` replacing its values; mappings key by key."""
    out = dict(base)
    for key, value in changes.items():
        old = out.get(key)
        if isinstance(old, dict) and isinstance(value, dict):
            out[key] = with_replacements(old, value)
        else:
            out[key] = value
    return out


def validate(name: str, content: Any, model: type[M]) -> M:
    """Return `content` as `model`; raises `UsageError` naming `name` and the first bad key."""
    try:
        return model.model_validate(content)
    except UnicodeEncodeError:
        raise UsageError(f"{name}: a text is not valid Unicode") from None
    except ValidationError as error:
        problems = error.errors(include_url=False)
        # A misspelt key is also a missing one: the misspelling is what to say.
        unknown = [x for x in problems if x["type"] in {"extra_forbidden", "invalid_key"}]
        first = (unknown or problems)[0]
        key = ".".join(str(part) for part in first["loc"])
        key = " ".join(key.split()) or "(top level)"
        suggestion = _suggestion(first, problems) if first in unknown else ""
        if first["type"] == "extra_forbidden":
            message = "no such parameter" + suggestion
        elif first["type"] == "missing":
            message = "is missing"
        else:
            message = first["msg"].removeprefix("Value error, ")
            if not isinstance(first["input"], dict | list):
                shown = repr(first["input"])
                message += f", got {shown if len(shown) < _SHOWN else shown[:_SHOWN] + '...'}"
        others = len(problems) - (2 if suggestion else 1)
        more = f" (and {others} more)" if others else ""
        raise UsageError(f"{name}: {key}: {message}{more}") from None


def _suggestion(unknown: Mapping[str, Any], problems: Sequence[Mapping[str, Any]]) -> str:
    """Return the missing key that a misspelt one stands for, as a question, or ""."""
    key = str(unknown["loc"][-1])
    missing = [str(x["loc"][-1]) for x in problems if x["type"] == "missing"]
    near = get_close_matches(key, missing, 1)
    return f", did you mean {near[0]}?" if near else ""
