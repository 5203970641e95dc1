# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Folders on disk and in object stores, by fsspec: access that survives a short outage."""

from __future__ import annotations

import errno
import time
from collections.abc import Callable
from typing import Any, TypeVar

from adk_ros.errors import AdkError, UsageError, first_line
from adk_ros.fleet.libraries import fleet_library

T = TypeVar("T")

OUTAGE_S = 60.0
"""s for which an unreachable store is tried again before the run stops."""
_CREDENTIAL_FAULTS = frozenset(
    {
        "ExpiredToken", "ExpiredTokenException", "InvalidAccessKeyId", "InvalidToken",
        "RequestExpired", "SignatureDoesNotMatch", "TokenRefreshRequired",
    }
)  # fmt: skip
"""Error codes of S3 that concern all objects of a store."""
_FIRST_PAUSE_S, _LONGEST_PAUSE_S = 0.5, 5.0


class StoreUnreachable(AdkError):
    """A store did not answer for `OUTAGE_S`; the recording itself may be in order."""


def file_system(uri: str) -> tuple[Any, str]:
    """
    Return the fsspec file system of a path or URL, and the path in it.

    :raises UsageError: the protocol is unknown, or its library is not installed.
    """
    fsspec = fleet_library("fsspec")
    protocol = uri.partition("://")[0] if "://" in uri else "file"
    if protocol == "s3":
        fleet_library("s3fs")
    try:
        system, path = fsspec.core.url_to_fs(uri)
    except (ValueError, ImportError) as error:
        raise UsageError(f"{uri}: {first_line(error)}") from None
    return system, str(path)


def is_local(system: Any) -> bool:
    """Whether the files of a file system lie on the disk."""
    protocols = system.protocol
    return "file" in ((protocols,) if isinstance(protocols, str) else protocols)


def with_retries(uri: str, access: Callable[[], T], outage_s: float = OUTAGE_S) -> T:
    """
    Return `access()`, tried again while the store does not answer.

    What the store answers clearly (a missing file, no permission) and errors of the local disk are
    raised at once.

    :raises StoreUnreachable: the store does not answer for `outage_s`, or refuses the credentials.
    """
    deadline, pause = time.monotonic() + outage_s, _FIRST_PAUSE_S
    while True:
        try:
            return access()
        except (FileNotFoundError, NotADirectoryError, IsADirectoryError):
            raise
        except Exception as error:  # each store raises other exceptions
            if reason := _refused_credentials(error):
                raise StoreUnreachable(
                    f"{uri}: the store refuses the credentials ({reason}): renew them and run the "
                    "same command again, results so far are kept"
                ) from None
            if isinstance(error, PermissionError):
                raise
            if isinstance(error, AdkError) or "://" not in uri or _is_local_fault(error):
                raise
            if time.monotonic() + pause > deadline:
                raise StoreUnreachable(
                    f"{uri}: the store does not answer for {outage_s:.0f} s "
                    f"({type(error).__name__}: {first_line(error)}): run the same command later, "
                    "results so far are kept"
                ) from None
        time.sleep(pause)
        pause = min(2.0 * pause, _LONGEST_PAUSE_S)


def _refused_credentials(error: Exception) -> str:
    """Return the code of a store that refuses all access, "" of another error."""
    response = getattr(error.__cause__ or error, "response", None)
    if not isinstance(response, dict):
        return ""
    code = str(response.get("Error", {}).get("Code", ""))
    return code if code in _CREDENTIAL_FAULTS else ""


def _is_local_fault(error: Exception) -> bool:
    return isinstance(error, OSError) and error.errno in {errno.ENOSPC, errno.EDQUOT, errno.EROFS}
