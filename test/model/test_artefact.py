# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Model folders: saving, loading, atomic writes, and every reason to refuse a folder."""

import hashlib
import io
import json
import math
import os
import pickle
import shutil
import zipfile
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pytest
import torch
from helpers.model import (
    make_model,
    paper_model,
    plain_program,
    program,
    random_lift,
    slalom,
    slow,
)

from adk_ros.errors import UsageError
from adk_ros.model import artefact, stored_model
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.lifting.encoder import Lifting, input_size
from adk_ros.model.manifest import MANIFEST, read_manifest
from adk_ros.model.predictor import Predictor
from adk_ros.model.stored_model import ARRAYS, ENCODER
from adk_ros.model.uncertainty.fallback import Fallback

FACTS = {"data": [{"name": "town", "seconds": 60.0}], "seed": 3}
Change = Callable[[Path], object]


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("models") / "model"
    artefact.save(folder, program(), make_model(), FACTS)
    return folder


@pytest.fixture
def folder(written: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(written, tmp_path / "model"))


def predictions(model: KoopmanModel) -> list[np.ndarray]:
    predictor = Predictor(model, horizon_steps=20)
    made = [predictor.step(item) for item in slalom(80)]
    return [array for p in made if p is not None for array in (p.horizon, p.covariance)]


def paper() -> tuple[bytes, KoopmanModel]:
    return program(history=0), paper_model()


def with_naive() -> tuple[bytes, KoopmanModel]:
    weights = np.random.default_rng(0).uniform(0.0, 1.0 / 3.0, (2, 3, 80, 3))
    return program(), make_model(fallback=Fallback(weights))


def not_compiled() -> tuple[bytes, KoopmanModel]:
    content = plain_program(input_size(2))
    return content, make_model(lifting=Lifting(content, input_size(2), 4))


@pytest.mark.parametrize(
    "made",
    [lambda: (program(), make_model()), paper, with_naive, not_compiled,
     lambda: (program(history=0), make_model(history=0, residual=False))],
    ids=["default", "paper", "naive predictors", "not compiled", "not residual"],
)  # fmt: skip
def test_loaded_model_predicts_as_the_saved_one(
    made: Callable[[], tuple[bytes, KoopmanModel]], tmp_path: Path
) -> None:
    content, model = made()
    artefact.save(tmp_path / "model", content, model, FACTS)
    loaded = artefact.load(tmp_path / "model")
    for one, other in zip(predictions(model), predictions(loaded.model), strict=True):
        np.testing.assert_array_equal(one, other)
    assert loaded.path == tmp_path / "model"
    assert loaded.manifest["training"] == FACTS
    assert loaded.manifest == read_manifest(tmp_path / "model")
    assert loaded.model.online == model.online
    np.testing.assert_array_equal(loaded.model.fallback.weights, model.fallback.weights)
    for name in ("history", "residual", "affine", "relift", "uses_imu", "n_z"):
        assert getattr(loaded.model, name) == getattr(model, name)


def test_content_of_the_folder(written: Path) -> None:
    assert sorted(p.name for p in written.iterdir()) == [ARRAYS, ENCODER, MANIFEST]
    assert written.stat().st_mode & 0o777 == 0o755
    manifest = json.loads((written / MANIFEST).read_text())
    assert manifest["format"] == "adk_ros.model"
    assert manifest["dt_s"] == 0.025
    assert manifest["channels"]["state"] == {"v_x": "m/s", "v_y": "m/s", "yaw_rate": "rad/s"}
    assert manifest["channels"]["input"] == {"torque": "N m", "delta": "rad"}
    for name in (ENCODER, ARRAYS):
        content = (written / name).read_bytes()
        assert manifest["sha256"][name] == hashlib.sha256(content).hexdigest()


def test_model_of_the_last_release_loads(folder: Path) -> None:
    """Arrays, buffers and manifest fields by the names that version 3 of the format has."""
    random = np.random.default_rng(0)
    stored = {
        "x_mean": random.normal(size=3), "x_scale": np.ones(3), "u_mean": random.normal(size=2),
        "u_scale": np.ones(2), "step_scale": np.full(3, 0.1),
        "theta0": random.normal(0.0, 0.01, (7, 10)),
        "horizon_covariance": np.tile(np.eye(3), (80, 1, 1)),
        "held_covariance": np.tile(2.0 * np.eye(3), (80, 1, 1)),
        "usual_change": random.uniform(1.0, 2.0, (80, 3)),
        "observer_gain": np.full(3, 0.5), "slow_gain": np.full(3, 0.1),
        "slow_decay": np.full(3, 0.9), "fast_gain": np.full(3, 0.3), "fast_decay": np.full(3, 0.8),
    }  # fmt: skip
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **stored)
    online = {
        "method": "windowed", "window": 400, "ridge": 100.0, "forgetting": 0.98,
        "initial_covariance": 1.0,
    }  # fmt: skip
    manifest = {
        "format": "adk_ros.model", "version": 3, "dt_s": 0.025,
        "reference_point": "centre_of_gravity",
        "channels": {
            "state": {"v_x": "m/s", "v_y": "m/s", "yaw_rate": "rad/s"},
            "input": {"torque": "N m", "delta": "rad"},
        },
        "history": 2, "lifted_size": 7, "residual": True, "affine": True, "relift": True,
        "uses_imu": True, "online": online, "training": {},
        "sha256": {
            "encoder.pt": hashlib.sha256(program()).hexdigest(),
            "arrays.npz": hashlib.sha256(buffer.getvalue()).hexdigest(),
        },
    }  # fmt: skip
    (folder / "encoder.pt").write_bytes(program())
    (folder / "arrays.npz").write_bytes(buffer.getvalue())
    (folder / "manifest.json").write_text(json.dumps(manifest))
    buffers = set(random_lift(2, 8, 4).state_dict())
    assert buffers == {"w1", "b1", "w2", "b2", "w3", "b3", "skip", "reach", "directions"}
    model = artefact.load(folder).model
    assert model.lifting.compiled is not None
    fields = {
        "x_mean": model.scaling.x_mean, "x_scale": model.scaling.x_scale,
        "u_mean": model.scaling.u_mean, "u_scale": model.scaling.u_scale,
        "step_scale": model.scaling.step_scale, "theta0": model.theta0,
        "horizon_covariance": model.horizon_covariance,
        "held_covariance": model.held_input_covariance, "usual_change": model.mean_square_change,
        "observer_gain": model.observer_gains.observer_gain,
        "slow_gain": model.observer_gains.slow_gain, "slow_decay": model.observer_gains.slow_decay,
        "fast_gain": model.observer_gains.fast_gain, "fast_decay": model.observer_gains.fast_decay,
    }  # fmt: skip
    assert fields.keys() == stored.keys()
    for name, array in stored.items():
        np.testing.assert_array_equal(fields[name], array, err_msg=name)
    assert asdict(model.online) == online
    assert model.motion_limits.shape == (0,), "a model of that release has no limits"
    assert not model.fallback.is_active, "nor does a naive predictor take over in it"
    assert len(predictions(model)) > 100


def test_no_python_pickle_is_loaded(written: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: Any, **__: Any) -> NoReturn:
        raise AssertionError("a pickle was loaded")

    class Refusing:
        def __init__(self, *_: Any, **__: Any) -> None:
            refuse()

    for owner, name in (
        (pickle, "load"), (pickle, "loads"), (pickle, "_load"), (pickle, "_loads"),
        (pickle, "_Unpickler"), (pickle, "Unpickler"), (torch, "load"),
    ):  # fmt: skip
        monkeypatch.setattr(owner, name, Refusing if name.endswith("Unpickler") else refuse)
    artefact.load(written)


def edit(**fields: Any) -> Change:
    """Change fields of the manifest; None removes one."""

    def change(folder: Path) -> None:
        manifest = json.loads((folder / MANIFEST).read_text()) | fields
        kept = {key: value for key, value in manifest.items() if value is not None}
        (folder / MANIFEST).write_text(json.dumps(kept))

    return change


def online(**fields: Any) -> Change:
    def change(folder: Path) -> None:
        manifest = json.loads((folder / MANIFEST).read_text())
        edit(online=manifest["online"] | fields)(folder)

    return change


def replaced(name: str, content: bytes) -> Change:
    """Replace a file and its hash in the manifest."""

    def change(folder: Path) -> None:
        (folder / name).write_bytes(content)
        hashes = json.loads((folder / MANIFEST).read_text())["sha256"]
        edit(sha256=hashes | {name: hashlib.sha256(content).hexdigest()})(folder)

    return change


def with_arrays(**arrays: Any) -> Change:
    def change(folder: Path) -> None:
        with np.load(folder / ARRAYS) as stored:
            kept = dict(stored) | arrays
        buffer = io.BytesIO()
        given = {key: value for key, value in kept.items() if value is not None}
        np.savez(buffer, **given)
        replaced(ARRAYS, buffer.getvalue())(folder)

    return change


def entries(content: bytes) -> bytes:
    """A zip of the right names with the same content each."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name in stored_model._ARRAYS:
            archive.writestr(name + ".npy", content)
    return buffer.getvalue()


def zipped(content: bytes) -> bytes:
    """A small zip that unpacks to a large one."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("theta0.npy", content)
    return buffer.getvalue()


def npy(array: Any) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, array, allow_pickle=True)
    return buffer.getvalue()


def header(text: str) -> bytes:
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text.encode()


def cut(name: str, keep: float) -> Change:
    def change(folder: Path) -> None:
        content = (folder / name).read_bytes()
        (folder / name).write_bytes(content[: int(keep * len(content))])

    return change


def flipped(name: str) -> Change:
    def change(folder: Path) -> None:
        content = bytearray((folder / name).read_bytes())
        content[len(content) // 2] ^= 1
        (folder / name).write_bytes(bytes(content))

    return change


def linked_to(name: str, target: str) -> Change:
    def change(folder: Path) -> None:
        (folder / name).unlink()
        (folder / name).symlink_to(target)

    return change


def pipe(name: str) -> Change:
    def change(folder: Path) -> None:
        (folder / name).unlink()
        os.mkfifo(folder / name)

    return change


def manifest_is(content: bytes) -> Change:
    return lambda folder: (folder / MANIFEST).write_bytes(content)


HASH = "does not match its hash in manifest.json: it is truncated, altered"
JSON, ONLINE, RANGE = "is not readable as JSON", "of 'online' is not of type", "is out of range"
WEIGHTS = "fallback_weights is not 2 x 3 x 80 x 3 weights from 0 to 1: train again"
READABLE, FINITE = "arrays.npz is not readable", "contains values that are not finite"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda f: (f / MANIFEST).unlink(), "contains no manifest.json: it is not a model folder"),
        (manifest_is(b""), JSON),
        (manifest_is(b'{"format": "adk_ros.model", '), JSON),
        (manifest_is(b"\xff\xfe\x00\x80"), JSON),
        (manifest_is(b"[" * 100_000), JSON),
        (manifest_is(b"null"), "does not describe an adk_ros.model"),
        (manifest_is(b"[]"), "does not describe an adk_ros.model"),
        (manifest_is(b"{}"), "does not describe an adk_ros.model"),
        (edit(format="webapp"), "does not describe an adk_ros.model"),
        (edit(version=2), "version is 2, this version requires 3: train the model again"),
        (edit(version=None), "version is null"),
        (edit(dt_s=0.02), r"dt_s is 0.02, this version requires 0.025"),
        (edit(dt_s=math.nan), "dt_s is NaN"),
        (edit(reference_point="rear_axle"), 'reference_point is "rear_axle", this version'),
        (edit(channels={"state": {}}), "channels is "),
        (edit(history="2"), "'history' is missing or not of type int"),
        (edit(history=2.0), "'history' is missing or not of type int"),
        (edit(history=True), "'history' is missing or not of type int"),
        (edit(history=-1), RANGE),
        (edit(history=41), RANGE),
        (edit(lifted_size=3), RANGE),
        (edit(lifted_size=10**9), RANGE),
        (edit(residual=1), "'residual' is missing or not of type bool"),
        (edit(affine=None), "'affine' is missing or not of type bool"),
        (edit(relift=False), "a model without 'relift' must not be residual or affine"),
        (edit(uses_imu="yes"), "'uses_imu' is missing"),
        (edit(training=None), "'training' is missing"),
        (edit(online=None), "'online' is missing"),
        (edit(online={"method": "windowed"}), "'online' must contain exactly forgetting"),
        (online(extra=1), "'online' must contain exactly forgetting, initial_covariance, m"),
        (online(method=["windowed"]), ONLINE),
        (online(window="400"), ONLINE),
        (online(window=400.5), ONLINE),
        (online(window=True), ONLINE),
        (online(ridge=None), ONLINE),
        (online(ridge="1"), ONLINE),
        (online(method="magic"), "online method 'magic' is unknown"),
        (online(window=10**30), "choose 2 to 100000"),
        (online(ridge=math.nan), "ridge is nan"),
        (edit(sha256={}), HASH),
        (edit(sha256=["a"]), "'sha256' is missing or not of type dict"),
        (lambda f: (f / ENCODER).unlink(), "encoder.pt cannot be read"),
        (lambda f: (f / ARRAYS).unlink(), "arrays.npz cannot be read"),
        (linked_to(ARRAYS, "/dev/zero"), "arrays.npz is not a regular file"),
        (linked_to(MANIFEST, "/dev/zero"), "manifest.json is not a regular file"),
        (pipe(ENCODER), "encoder.pt is not a regular file"),
        (pipe(MANIFEST), "manifest.json is not a regular file"),
        (manifest_is(b" " * (17 << 20)), "manifest.json has 17.0 MiB: at most 16 MiB"),
        (replaced(ARRAYS, bytes(65 << 20)), "arrays.npz has 65.0 MiB: at most 64 MiB"),
        (replaced(ARRAYS, zipped(bytes(100 << 20))), "it unpacks to 100 MiB"),
        (cut(ENCODER, 0.5), HASH),
        (cut(ENCODER, 0.0), HASH),
        (cut(ARRAYS, 0.99), HASH),
        (flipped(ENCODER), HASH),
        (flipped(ARRAYS), HASH),
        (edit(history=3), "the encoder does not accept 20 inputs"),
        (edit(lifted_size=8), "theta0 has shape"),
        (edit(affine=False), r"theta0 has shape \(7, 10\), the manifest requires \(7, 9\)"),
        (replaced(ENCODER, b"nothing"), "not a readable TorchScript program"),
        (replaced(ENCODER, program(features=5)), "the manifest says"),
        (replaced(ENCODER, program(history=3)), "the encoder does not accept 15 inputs"),
        (replaced(ARRAYS, b""), READABLE),
        (replaced(ARRAYS, b"PK\x03\x04" + bytes(50)), READABLE),
        (replaced(ARRAYS, npy(np.zeros(3))), READABLE),
        (replaced(ARRAYS, npy(np.array([{}], dtype=object))), READABLE),
        (replaced(ARRAYS, pickle.dumps({"theta0": 1})), READABLE),
        (replaced(ARRAYS, entries(b"")), READABLE),
        (replaced(ARRAYS, entries(header("{'descr': ((((("))), READABLE),
        (replaced(ARRAYS, entries(header(
            "{'descr': '<f8', 'fortran_order': False, 'shape': (10000000000000,)}"
        ))), READABLE),
        (with_arrays(theta0=np.array([[None]], dtype=object)), READABLE),
        (with_arrays(x_mean=np.array(["a", "b", "c"])), READABLE),
        (with_arrays(theta0=None), READABLE),
        (with_arrays(theta0=np.zeros((7, 9))), "theta0 has shape"),
        (with_arrays(theta0=np.zeros(70)), "theta0 has shape"),
        (with_arrays(held_covariance=np.zeros((1, 0, 3, 3))), "held_covariance has shape"),
        (with_arrays(x_mean=np.zeros(3, complex)), "x_mean holds complex128 instead of numbers"),
        (with_arrays(x_mean=np.full(3, 1e300)), r"x_mean contains 1e\+300"),
        (with_arrays(x_scale=np.full(3, 1e-300)), "x_scale contains 1e-300"),
        (with_arrays(x_mean=np.zeros(2)), "x_mean has shape"),
        (with_arrays(u_scale=np.ones((2, 1))), "u_scale has shape"),
        (with_arrays(slow_gain=np.zeros(())), "slow_gain has shape"),
        (with_arrays(horizon_covariance=np.zeros((80, 3))), "horizon_covariance has shape"),
        (with_arrays(held_covariance=np.zeros((3, 3))), "held_covariance has shape"),
        (with_arrays(held_covariance=np.zeros((79, 3, 3))), "held_covariance has shape"),
        (with_arrays(held_covariance=None), READABLE),
        (with_arrays(motion_limits=np.ones(3)), "motion_limits is not 4 positive numbers"),
        (with_arrays(motion_limits=np.zeros(4)), "motion_limits is not 4 positive numbers"),
        (with_arrays(motion_limits=np.full(4, np.nan)), "motion_limits is not 4 positive numbers"),
        (with_arrays(fallback_weights=np.zeros((2, 3, 79, 3))), WEIGHTS),
        (with_arrays(fallback_weights=np.zeros((2, 2, 80, 3))), WEIGHTS),
        (with_arrays(fallback_weights=np.zeros(())), WEIGHTS),
        (with_arrays(fallback_weights=np.full((2, 3, 80, 3), np.nan)), WEIGHTS),
        (with_arrays(fallback_weights=np.full((2, 3, 80, 3), -0.1)), WEIGHTS),
        (with_arrays(fallback_weights=np.full((2, 3, 80, 3), 0.34)), WEIGHTS),
        (with_arrays(fallback_weights=np.full((2, 3, 80, 3), "1")), READABLE),
        (with_arrays(theta0=np.full((7, 10), np.nan)), f"theta0 {FINITE}"),
        (with_arrays(x_scale=np.array([1.0, np.inf, 1.0])), f"x_scale {FINITE}"),
        (with_arrays(x_scale=np.array([1.0, 0.0, 1.0])), "a scale that is not positive"),
        (with_arrays(step_scale=np.array([1.0, -1.0, 1.0])), "a scale that is not positive"),
        (with_arrays(horizon_covariance=np.full((2, 3, 3), np.inf)), f"covariance {FINITE}"),
        (with_arrays(held_covariance=np.full((80, 3, 3), np.inf)), f"covariance {FINITE}"),
    ],
)  # fmt: skip
def test_invalid_folders_are_refused(folder: Path, change: Change, words: str) -> None:
    artefact.load(folder)
    change(folder)
    with pytest.raises(UsageError, match=words) as refused:
        artefact.load(folder)
    assert len(str(refused.value).splitlines()) == 1
    assert refused.value.exit_code == 2


@pytest.mark.parametrize("name", [ENCODER, ARRAYS, MANIFEST])
def test_a_folder_in_place_of_a_file_is_refused(folder: Path, name: str) -> None:
    (folder / name).unlink()
    (folder / name).mkdir()
    with pytest.raises(UsageError, match=name):
        artefact.load(folder)


@pytest.mark.parametrize("where", ["nowhere", "file", "file/below"])
def test_a_missing_folder_is_refused(tmp_path: Path, where: str) -> None:
    (tmp_path / "file").write_text("x")
    with pytest.raises(UsageError, match="is not a folder: give the folder that 'adk train'"):
        artefact.load(tmp_path / where)


def test_integers_are_accepted_for_floats(folder: Path) -> None:
    online(ridge=5, initial_covariance=1)(folder)
    assert artefact.load(folder).model.online.ridge == 5.0


def test_a_model_may_be_replaced(folder: Path) -> None:
    (folder / "report.html").write_text("of the training before")
    other = make_model(observer_gains=slow(0.3))
    artefact.save(folder, program(), other, {"seed": 4})
    loaded = artefact.load(folder)
    assert loaded.manifest["training"] == {"seed": 4}
    assert loaded.model.observer_gains.slow_gain.tolist() == [0.3] * 3
    assert (folder / "report.html").exists()
    assert [p.name for p in folder.parent.iterdir()] == ["model"]


@pytest.mark.parametrize("inside", [None, "notes.txt", "a web app's", "unreadable"])
def test_other_folders_are_not_replaced(tmp_path: Path, inside: str | None) -> None:
    target = tmp_path / "precious"
    target.mkdir()
    if inside == "a web app's":
        (target / MANIFEST).write_text('{"name": "app", "version": 3}')
    elif inside == "unreadable":
        (target / MANIFEST).write_text("{")
    elif inside:
        (target / inside).write_text("precious")
    before = {p.name: p.read_text() for p in target.iterdir()}
    for attempt in (lambda: artefact.check_target(target),
                    lambda: artefact.save(target, program(), make_model(), {})):  # fmt: skip
        with pytest.raises(UsageError, match="exists and is not a model: choose another --out"):
            attempt()
    assert {p.name: p.read_text() for p in target.iterdir()} == before
    assert [p.name for p in tmp_path.iterdir()] == ["precious"]


def test_places_where_no_folder_can_be_created(tmp_path: Path) -> None:
    """Found out before a training of minutes, not after it."""
    (tmp_path / "file").write_text("x")
    for place in ("file/model", "file/a/b", "n" * 300):
        with pytest.raises(UsageError, match="cannot be written"):
            artefact.check_target(tmp_path / place)
    with pytest.raises(UsageError, match="exists and is not a model"):
        artefact.check_target(tmp_path / "file")
    artefact.check_target(tmp_path / "new" / "deep" / "model")
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_parent_folders_are_created(tmp_path: Path) -> None:
    artefact.save(tmp_path / "a" / "b" / "model", program(), make_model(), {})
    artefact.load(tmp_path / "a" / "b" / "model")


def fail_after(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the machine die at the `count`-th step of writing."""
    done = [0]

    def counted(function: Any) -> Any:
        def step(*args: Any, **kwargs: Any) -> Any:
            done[0] += 1
            if done[0] > count:
                raise KeyboardInterrupt
            return function(*args, **kwargs)

        return step

    for owner, name in (
        (Path, "write_bytes"), (Path, "chmod"), (os, "replace"), (os, "rename")
    ):  # fmt: skip
        monkeypatch.setattr(owner, name, counted(getattr(owner, name)))


@pytest.mark.parametrize("count", range(6))
def test_interrupted_while_writing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, count: int
) -> None:
    """The folder is there as a whole, or not at all, and nothing else is left behind."""
    with monkeypatch.context() as patch:
        fail_after(count, patch)
        try:
            artefact.save(tmp_path / "model", program(), make_model(), {})
        except KeyboardInterrupt:
            assert list(tmp_path.iterdir()) == []
        else:
            assert count == 5
            artefact.load(tmp_path / "model")


@pytest.mark.parametrize("count", range(9))
def test_interrupted_while_replacing(
    folder: Path, monkeypatch: pytest.MonkeyPatch, count: int
) -> None:
    """Then it is the old one, or the new one, or refused for a hash: never a mixture."""
    other = make_model(history=0, observer_gains=slow(0.3))
    with monkeypatch.context() as patch:
        fail_after(count, patch)
        try:
            artefact.save(folder, program(history=0), other, {"seed": 4})
        except KeyboardInterrupt:
            assert count < 7
    assert [p.name for p in folder.parent.iterdir()] == ["model"]
    if count in (5, 6):
        with pytest.raises(UsageError, match=HASH):
            artefact.load(folder)
        # The way out: the training is written again.
        artefact.save(folder, program(history=0), other, {"seed": 4})
    history = artefact.load(folder).model.history
    assert history == (0 if count > 4 else 2)


def test_full_disk_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: Any) -> NoReturn:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", full)
        with pytest.raises(UsageError, match="cannot be written: No space left on device"):
            artefact.save(tmp_path / "model", program(), make_model(), {})
    assert list(tmp_path.iterdir()) == []
