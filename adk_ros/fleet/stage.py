# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a stage is: the work on one recording, with rows as its result; and its version."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol, TypeGuard, runtime_checkable

from adk_ros.files.code_digest import code_digest


@runtime_checkable
class Stage(Protocol):
    """
    The work on one recording. It is sent to other processes: a frozen dataclass of plain values.

    `name`: of letters and underscores; the partition of the dataset. `inputs_hash`: hash of all
    that the rows depend on besides the recording and the code, such as the model; hexadecimal.
    `shared_paths`: files and folders besides the recording that `run` reads or writes.
    """

    @property
    def name(self) -> str:
        """Name of the stage."""

    @property
    def inputs_hash(self) -> str:
        """Hash of the inputs besides the recording."""

    @property
    def shared_paths(self) -> tuple[str, ...]:
        """Paths that exist on all machines: absolute, since workers run in other folders."""

    def run(self, path: Path, recording: str) -> list[dict[str, Any]]:
        """
        Return the findings of a recording, one row each, with columns of `columns.FINDING`.

        :param path: the recording on the local disk. :param recording: its name in the fleet.
        :raises AdkError: the recording is unusable; the text becomes the reason of its row.
        """


@runtime_checkable
class StagePerRecording(Protocol):
    """A stage with inputs that differ between recordings, such as where each is linearised."""

    def recording_inputs(self) -> Callable[[str], str]:
        """Return a function: name of a recording -> hash of its inputs, "" for none."""


@runtime_checkable
class StageOfContent(Protocol):
    """A stage that writes files which belong to the content of a recording."""

    def of_content(self, content_hash: str) -> Stage:
        """Return the stage for a recording with this hash of its content."""


class KeepingStage(Stage, Protocol):
    """A stage that keeps what it has read, so that it reads a recording once for several runs."""

    def of_content(self, content_hash: str) -> KeepingStage:
        """Return the stage for a recording with this hash of its content."""

    def run_kept(self, recording: str) -> list[dict[str, Any]] | None:
        """
        Return the findings from what was kept, as `Stage.run`; None if nothing was.

        :raises AdkError: the recording is unusable.
        """


class ModelStage(Stage, Protocol):
    """A stage that compares recordings with a model or a simulation."""

    @property
    def model_hash(self) -> str:
        """Hash of the model or simulation, by which its results are selected."""

    def inputs_of_model(self, model_hash: str) -> str:
        """Return `inputs_hash`, given that of the model: a bag of gigabytes is read once."""


def has_model(stage: Stage) -> TypeGuard[ModelStage]:
    """Whether a stage is a `ModelStage`, by its class: see `keeps_recordings`."""
    return hasattr(type(stage), "inputs_of_model")


def keeps_recordings(stage: Stage) -> TypeGuard[KeepingStage]:
    """
    Whether a stage is a `KeepingStage`.

    By its class: until Python 3.12, isinstance with a protocol reads the properties of the object,
    and the hash of the inputs reads all their files.
    """
    return hasattr(type(stage), "run_kept")


def _no_inputs(recording: str) -> str:
    return ""


@dataclass(frozen=True)
class StageVersion:
    """
    Stage, code and inputs: all that the results of a run depend on besides the recordings.

    `recording_inputs`: name of a recording -> hash of the inputs of this one, "" for none.
    `model_hash`: of the model or simulation, which is part of `inputs_hash`; "" without one.
    """

    name: str
    code_version: str
    inputs_hash: str
    recording_inputs: Callable[[str], str] = _no_inputs
    model_hash: str = ""

    def inputs_of(self, recording: str) -> str:
        """
        Return the inputs of a recording: `inputs_hash`, then "-" and a hash of its separate ones.

        The first part is that of the whole stage.
        """
        separate = self.recording_inputs(recording)
        return f"{self.inputs_hash}-{separate[:16]}" if separate else self.inputs_hash

    def key(self, content_hash: str, recording: str) -> str:
        """Return the key of a result: equal exactly if all that it depends on is equal."""
        parts = (content_hash, self.code_version, self.name, self.inputs_of(recording))
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def version_of(stage: Stage) -> StageVersion:
    """
    Return the version of a stage, once for a run: the hash reads all files of the inputs.

    :raises UsageError: an input cannot be read.
    """
    if has_model(stage):
        model = stage.model_hash
        inputs = stage.inputs_of_model(model)
        version = StageVersion(stage.name, code_digest(), inputs, model_hash=model)
    else:
        version = StageVersion(stage.name, code_digest(), stage.inputs_hash)
    if isinstance(stage, StagePerRecording):
        return replace(version, recording_inputs=stage.recording_inputs())
    return version


def hash_of(values: Iterable[object]) -> str:
    """Return a hash (64 hexadecimal digits) of values, by their text."""
    return hashlib.sha256("\n".join(map(repr, values)).encode()).hexdigest()
