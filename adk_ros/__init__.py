# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Vehicle-state prediction from rosbags, and explanation of differences to a simulation.

The Python interface, for notebooks and scripts::

    import adk_ros

    recording = adk_ros.read_recording("bags/town")
    model = adk_ros.train_model("bags/handling", out="model")
    replayed = adk_ros.replay(recording, model)
    rollouts = adk_ros.rollout(recording, model, horizon_s=1.0)
    result = adk_ros.explain(simulation="bags/handling", recording="real", vehicle="imdv")

Results have data frames (`.frame`, `.scores`, `.errors`, `.effects`), in SI units with the unit of
each column in `frame.attrs["units"]`, and figures (`.figure()`). Names are loaded when they are
first used: `import adk_ros` itself is fast.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from adk_ros.api.explain import MismatchExplanation as MismatchExplanation
    from adk_ros.api.explain import explain as explain
    from adk_ros.api.exporting import ExportResult as ExportResult
    from adk_ros.api.exporting import export as export
    from adk_ros.api.importing import ImportResult as ImportResult
    from adk_ros.api.importing import import_recording as import_recording
    from adk_ros.api.importing import propose_map as propose_map
    from adk_ros.api.model import TrainedModel as TrainedModel
    from adk_ros.api.model import load_model as load_model
    from adk_ros.api.planning import adapted_predictor as adapted_predictor
    from adk_ros.api.progress import Progress as Progress
    from adk_ros.api.recording import BagRecording as BagRecording
    from adk_ros.api.recording import read_recording as read_recording
    from adk_ros.api.recording import recording_options as recording_options
    from adk_ros.api.replay import ReplayResult as ReplayResult
    from adk_ros.api.replay import replay as replay
    from adk_ros.api.rollout import RolloutResult as RolloutResult
    from adk_ros.api.rollout import rollout as rollout
    from adk_ros.api.simulate import SimulationResult as SimulationResult
    from adk_ros.api.simulate import simulate as simulate
    from adk_ros.api.training import train_model as train_model
    from adk_ros.bags.recording import RecordingOptions as RecordingOptions
    from adk_ros.errors import AdkError as AdkError
    from adk_ros.errors import DataError as DataError
    from adk_ros.errors import UsageError as UsageError
    from adk_ros.importing.map_text import Proposal as Proposal
    from adk_ros.model.linearization import LinearizedRollout as LinearizedRollout
    from adk_ros.model.predictor import Predictor as Predictor
    from adk_ros.train.train_settings import PaperSettings as PaperSettings
    from adk_ros.train.train_settings import TrainSettings as TrainSettings

_MODULE_OF = {
    "AdkError": "errors",
    "BagRecording": "api.recording",
    "DataError": "errors",
    "ExportResult": "api.exporting",
    "ImportResult": "api.importing",
    "MismatchExplanation": "api.explain",
    "LinearizedRollout": "model.linearization",
    "PaperSettings": "train.train_settings",
    "Predictor": "model.predictor",
    "Progress": "api.progress",
    "Proposal": "importing.map_text",
    "RecordingOptions": "bags.recording",
    "ReplayResult": "api.replay",
    "RolloutResult": "api.rollout",
    "SimulationResult": "api.simulate",
    "TrainSettings": "train.train_settings",
    "TrainedModel": "api.model",
    "UsageError": "errors",
    "adapted_predictor": "api.planning",
    "explain": "api.explain",
    "export": "api.exporting",
    "import_recording": "api.importing",
    "load_model": "api.model",
    "propose_map": "api.importing",
    "read_recording": "api.recording",
    "recording_options": "api.recording",
    "replay": "api.replay",
    "rollout": "api.rollout",
    "simulate": "api.simulate",
    "train_model": "api.training",
}

__all__ = sorted(_MODULE_OF)  # noqa: PLE0605


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_MODULE_OF[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_MODULE_OF})
