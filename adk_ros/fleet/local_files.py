# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Files below a folder on the disk, those behind links included, or a line why it is not read."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any

from adk_ros.errors import UsageError

_NOT_ENTERED = "lost+found"
"""Folder of the file system at its root, which no user can read."""


def local_files(root: str, is_wanted: Callable[[str], bool]) -> list[dict[str, Any]]:
    """
    Return `name` (path), `size` (bytes) and `mtime` (s) of the files below a folder, or of a file.

    Links are followed: size and time are those of what they lead to. A folder is entered once, by
    its path without links if it has one below the root, so a loop of links ends. Hidden folders
    are not entered.

    :param root: absolute path. :param is_wanted: whether a file of this name is returned.
    :raises UsageError: a folder or file cannot be read, or a link leads nowhere: recordings would
        be missing.
    """
    if not os.path.isdir(root):
        return [described(root)]
    found: list[dict[str, Any]] = []
    entered: set[tuple[int, int]] = set()
    folders, links = [root], list[str]()
    while folders or links:
        folder = folders.pop() if folders else links.pop(0)
        try:
            status = os.stat(folder)
            if (status.st_dev, status.st_ino) in entered:
                continue
            entered.add((status.st_dev, status.st_ino))
            with os.scandir(folder) as entries:
                content = sorted(entries, key=lambda entry: entry.name)
            for entry in content:
                if entry.name.startswith(".") or entry.name == _NOT_ENTERED:
                    continue
                if os.path.isdir(entry.path):
                    (links if entry.is_symlink() else folders).append(entry.path)
                elif is_wanted(entry.name):
                    found.append(described(entry.path))
                elif entry.is_symlink() and not os.path.exists(entry.path):
                    raise UsageError(
                        f"{entry.path} is a link to {os.readlink(entry.path)}, which is not "
                        "there: mount what it leads to, or remove it"
                    )
        except OSError as error:
            raise UsageError(
                f"{error.filename or folder} cannot be read: {error.strerror or error}: correct "
                "its permissions, or name the folders beside it"
            ) from None
    return found


def described(path: str) -> dict[str, Any]:
    """Return name, size and time of a file; of a link that leads nowhere, its own and no bytes."""
    try:
        status = os.stat(path)
        size = status.st_size
    except FileNotFoundError:
        status, size = os.lstat(path), 0
    return {"name": path, "size": size, "mtime": status.st_mtime}
