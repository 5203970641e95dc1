# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Signed model folders: what OpenSSH signs is accepted, and nothing else."""

import base64
import hashlib
import shutil
import struct
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat
from helpers.node import write_model

from adk_ros.cli.main import main
from adk_ros.errors import UsageError
from adk_ros.model import artefact
from adk_ros.model.manifest import MANIFEST
from adk_ros.model.signature import check_signature, read_public_keys, string
from adk_ros.ros.node import main as node_main

# By ssh-keygen of OpenSSH 9.2, with a key made for this test.
CONTENT = b'{"a": 1}\n'
PUBLIC_KEY = (
    b"ssh-ed25519 AAAAC3NzaC1lZDI1NTE5AAAAIPKnL5J6AXy2GDvB57iibVVv00Zt2+T8cMD/0AExqd/5 bench\n"
)
SIGNATURE = b"""-----BEGIN SSH SIGNATURE-----
U1NIU0lHAAAAAQAAADMAAAALc3NoLWVkMjU1MTkAAAAg8qcvknoBfLYYO8HnuKJtVW/TRm
3b5PxwwP/QATGp3/kAAAAHYWRrX3JvcwAAAAAAAAAGc2hhNTEyAAAAUwAAAAtzc2gtZWQy
NTUxOQAAAED2xXAyub1xF6CtOdeQEvz5qPhNJim5psb85M/5DqxtVwqZUNWEqpcjsYGUUF
zXUmGq666I6HXOu5P1YVaTIxQE
-----END SSH SIGNATURE-----
"""


class Key:
    """A key that signs as `ssh-keygen -Y sign` does."""

    def __init__(self, seed: bytes = b"1") -> None:
        self._private = Ed25519PrivateKey.from_private_bytes(hashlib.sha256(seed).digest())
        raw = self._private.public_key().public_bytes(Encoding.Raw, PublicFormat.Raw)
        self.blob = string(b"ssh-ed25519") + string(raw)
        self.line = b"ssh-ed25519 " + base64.b64encode(self.blob) + b" test\n"

    def sign(
        self, content: bytes, namespace: bytes = b"adk_ros", version: int = 1, name: str = "sha512"
    ) -> bytes:
        about = string(namespace) + string(b"") + string(name.encode())
        digest = hashlib.new(name, content).digest()
        signature = self._private.sign(b"SSHSIG" + about + string(digest))
        signed = string(string(b"ssh-ed25519") + string(signature))
        blob = b"SSHSIG" + struct.pack(">I", version) + string(self.blob) + about + signed
        return (
            b"-----BEGIN SSH SIGNATURE-----\n" + base64.encodebytes(blob)
            + b"-----END SSH SIGNATURE-----\n"
        )  # fmt: skip


@pytest.fixture
def keys(tmp_path: Path) -> Path:
    path = tmp_path / "keys.txt"
    path.write_bytes(b"# people\n\n" + PUBLIC_KEY + Key().line)
    return path


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_model(tmp_path_factory.mktemp("signed") / "model")


@pytest.fixture
def model(written: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(written, tmp_path / "model"))


def sign(model: Path, key: Key) -> None:
    content = (model / MANIFEST).read_bytes()
    (model / f"{MANIFEST}.sig").write_bytes(key.sign(content))


def test_a_signature_of_openssh_is_accepted(tmp_path: Path, keys: Path) -> None:
    path = tmp_path / "manifest.json"
    path.with_name("manifest.json.sig").write_bytes(SIGNATURE)
    check_signature(path, CONTENT, keys)
    with pytest.raises(UsageError, match="is not what was signed"):
        check_signature(path, CONTENT + b" ", keys)
    keys.write_bytes(Key().line)
    with pytest.raises(UsageError, match="is of a key that is not in"):
        check_signature(path, CONTENT, keys)


def test_the_keys_of_a_file(keys: Path) -> None:
    assert len(read_public_keys(keys)) == 2


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        (b"", "holds no line"),
        (b"ssh-rsa AAAA me\n", "holds no line"),
        (b"ssh-ed25519 AAAAC3 me\n", "a key is damaged"),
        (
            b"ssh-ed25519 " + base64.b64encode(string(b"ssh-rsa") + string(b"x")),
            "a key is damaged",
        ),
    ],
)
def test_files_without_usable_key(keys: Path, lines: bytes, words: str) -> None:
    keys.write_bytes(lines)
    with pytest.raises(UsageError, match=words):
        read_public_keys(keys)


def test_only_signed_models_are_loaded(model: Path, keys: Path) -> None:
    artefact.load(model)
    with pytest.raises(UsageError, match=r"is not signed, and .* asks for it: sign it with"):
        artefact.load(model, keys)
    sign(model, Key(b"stranger"))
    with pytest.raises(UsageError, match="is of a key that is not in"):
        artefact.load(model, keys)
    sign(model, Key())
    assert artefact.load(model, keys).model.n_z == 9
    with (model / MANIFEST).open("ab") as file:
        file.write(b"\n")
    with pytest.raises(UsageError, match="is not what was signed"):
        artefact.load(model, keys)
    artefact.load(model)


@pytest.mark.parametrize(
    ("signed", "words"),
    [
        (lambda x: Key().sign(x, namespace=b"git"), "made for 'git'"),
        (lambda x: Key().sign(x, version=2), "another version"),
        (lambda x: Key().sign(x, name="md5"), "another hash"),
        (lambda _: b"", "not armoured"),
        (lambda x: Key().sign(x)[:200], "not armoured"),
        (lambda _: SIGNATURE.replace(b"NTUx", b"NT"), "is no SSH signature"),
        (lambda _: SIGNATURE.replace(b"U1NIU0lH", b"U1NIU0lI"), "another version"),
    ],
)
def test_other_signatures_are_refused(
    model: Path, keys: Path, signed: Callable[[bytes], bytes], words: str
) -> None:
    (model / f"{MANIFEST}.sig").write_bytes(signed((model / MANIFEST).read_bytes()))
    with pytest.raises(UsageError, match=words) as refused:
        artefact.load(model, keys)
    assert str(refused.value).isprintable()


def test_sha256_is_accepted(model: Path, keys: Path) -> None:
    content = (model / MANIFEST).read_bytes()
    (model / f"{MANIFEST}.sig").write_bytes(Key().sign(content, name="sha256"))
    artefact.load(model, keys)


def test_a_new_model_in_the_folder_is_not_signed(model: Path) -> None:
    sign(model, Key())
    write_model(model)
    assert not (model / f"{MANIFEST}.sig").exists()


def test_without_the_library_nothing_is_accepted(
    model: Path, keys: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sign(model, Key())
    monkeypatch.setitem(sys.modules, "cryptography.exceptions", None)
    with pytest.raises(UsageError, match="install the Python package cryptography"):
        artefact.load(model, keys)


def test_info_and_node_check_the_signature(
    model: Path, keys: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["info", str(model), "--public-keys", str(keys)]
    assert main(arguments) == 2
    assert "is not signed" in capsys.readouterr().err
    parameters = ["predictor", "--ros-args", "-p", f"model:={model}", "-p", f"public_keys:={keys}"]
    assert node_main(parameters) == 2
    assert "is not signed" in capsys.readouterr().err
    sign(model, Key())
    assert main(arguments) == 0
    assert "signed by a known key" in capsys.readouterr().out.replace("\n", " ")
    assert main(["info", str(keys.parent / "none"), "--public-keys", str(keys)]) == 2
