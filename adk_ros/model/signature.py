# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The signature of a model folder: of the manifest, with its hashes of the other files.

`ssh-keygen -Y sign -n adk_ros -f KEY MODEL/manifest.json` writes it next to the manifest. The
format is that of OpenSSH (PROTOCOL.sshsig); keys are Ed25519.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import re
import struct
from pathlib import Path

from adk_ros.errors import UsageError
from adk_ros.files.regular_file import read_regular_file

NAMESPACE = b"adk_ros"
"""What the signature is for: one made for e-mail or a commit is not accepted."""
SIGNATURE_ENDING = ".sig"
_MAGIC = b"SSHSIG"
_VERSION = 1
_KEY_TYPE = b"ssh-ed25519"
_HASHES = {b"sha256": hashlib.sha256, b"sha512": hashlib.sha512}
_MAX_BYTES = 64 << 10
_ARMOUR = re.compile(
    rb"\s*-----BEGIN SSH SIGNATURE-----\s(.*)-----END SSH SIGNATURE-----\s*", re.DOTALL
)


def check_signature(path: Path, content: bytes, public_keys: Path) -> None:
    """
    Require that one of the keys in `public_keys` has signed a file.

    :param path: the file, for messages and to find the signature. :param content: what was read.
    :param public_keys: file with a line `ssh-ed25519 KEY comment` for each key.
    :raises UsageError: it has not, or something that is needed is missing; the message says what.
    """
    try:
        from cryptography.exceptions import InvalidSignature
        from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
    except ImportError:
        raise UsageError(
            "a signature cannot be checked: install the Python package cryptography"
        ) from None
    known = read_public_keys(public_keys)
    place = path.with_name(path.name + SIGNATURE_ENDING)
    how = f"sign it with `ssh-keygen -Y sign -n {NAMESPACE.decode()} -f KEY {path}`"
    try:
        armoured = read_regular_file(place, _MAX_BYTES)
    except FileNotFoundError:
        raise UsageError(f"{path} is not signed, and {public_keys} asks for it: {how}") from None
    except OSError as error:
        raise UsageError(f"{place} cannot be read: {error.strerror}") from None
    try:
        key, signed, signature = _parsed(armoured, content)
    except (ValueError, struct.error, binascii.Error) as error:
        raise UsageError(f"{place} is no SSH signature ({error}): {how}") from None
    if key not in known:
        raise UsageError(f"{place} is of a key that is not in {public_keys}")
    try:
        Ed25519PublicKey.from_public_bytes(key).verify(signature, signed)
    except (InvalidSignature, ValueError):
        raise UsageError(
            f"{path} is not what was signed: it is altered or of another training; {how}"
        ) from None


def read_public_keys(path: Path) -> set[bytes]:
    """
    Return the Ed25519 keys (32 bytes each) in a file of lines `ssh-ed25519 KEY comment`.

    :raises UsageError: it cannot be read or has none.
    """
    try:
        lines = read_regular_file(path, _MAX_BYTES).splitlines()
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror}") from None
    keys = set()
    for line in lines:
        words = line.split()
        if len(words) < 2 or words[0] != _KEY_TYPE:
            continue
        try:
            keys.add(_key(base64.b64decode(words[1], validate=True)))
        except (ValueError, struct.error, binascii.Error):
            raise UsageError(f"{path}: a key is damaged: copy the line again") from None
    if not keys:
        raise UsageError(f"{path} holds no line 'ssh-ed25519 KEY': give a public key of that type")
    return keys


def _parsed(armoured: bytes, content: bytes) -> tuple[bytes, bytes, bytes]:
    """Return public key, signed bytes and signature (RFC 4251 strings in the order of sshsig)."""
    found = _ARMOUR.fullmatch(armoured)
    if found is None:
        raise ValueError("it is not armoured as one")
    blob = base64.b64decode(b"".join(found[1].split()), validate=True)
    if not blob.startswith(_MAGIC) or struct.unpack_from(">I", blob, len(_MAGIC))[0] != _VERSION:
        raise ValueError("another version")
    key, namespace, reserved, hash_name, signature = _strings(blob[len(_MAGIC) + 4 :], 5)
    if namespace != NAMESPACE:
        raise ValueError(f"made for '{namespace.decode(errors='replace')}'")
    if hash_name not in _HASHES:
        raise ValueError("another hash")
    digest = _HASHES[hash_name](content).digest()
    signed = _MAGIC + b"".join(map(string, (namespace, reserved, hash_name, digest)))
    return _key(key), signed, _typed(signature)


def _key(blob: bytes) -> bytes:
    key = _typed(blob)
    if len(key) != 32:
        raise ValueError("a key of another length")
    return key


def _typed(blob: bytes) -> bytes:
    kind, value = _strings(blob, 2)
    if kind != _KEY_TYPE:
        raise ValueError("a key of another type")
    return value


def _strings(blob: bytes, count: int) -> list[bytes]:
    """Return `count` strings, each behind its length (RFC 4251)."""
    found, at = [], 0
    for _ in range(count):
        (length,) = struct.unpack_from(">I", blob, at)
        found.append(blob[at + 4 : at + 4 + length])
        at += 4 + length
    if at != len(blob):
        raise ValueError("its length is wrong")
    return found


def string(value: bytes) -> bytes:
    """Return bytes behind their length (RFC 4251)."""
    return struct.pack(">I", len(value)) + value
