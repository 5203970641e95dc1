# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The two exception types of a refused request, with their exit codes."""

_MAX_CHARACTERS, _MAX_END = 1000, 300
"""Characters of a message, and of its end if the middle has to go: the end says what to do."""


def one_line(text: str) -> str:
    """
    Return a text as one line without control characters, at most 1000 characters.

    For texts that quote a file: a topic name may hold escape sequences for the terminal.
    """
    text = " ".join(text.split())
    if len(text) > _MAX_CHARACTERS:
        text = f"{text[: _MAX_CHARACTERS - _MAX_END - 5]} ... {text[-_MAX_END:]}"
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def first_line(error: Exception) -> str:
    """Return the first line of an error of a library, or its type if it has no text."""
    return (str(error).strip() or type(error).__name__).splitlines()[0]


class AdkError(Exception):
    """A refused request; the one-line message says what, where and what to do."""

    exit_code = 2

    def __init__(self, message: str) -> None:
        super().__init__(one_line(message))


class UsageError(AdkError):
    """The request is wrong: an argument, a parameter, a path, an unsuitable model."""

    exit_code = 2


class DataError(AdkError):
    """The request is valid, but the data is unusable: a topic is missing, a bag is too short."""

    exit_code = 3
