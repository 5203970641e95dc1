# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages quote files, and still are one readable line."""

import pytest

from adk_ros.errors import DataError, UsageError, first_line, one_line


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("bag a\nis\tbad ", "bag a is bad"),
        ("topic \x1b[2J\x00", "topic \\x1b[2J\\x00"),
        ("\u202egnp.exe \ud800", "\\u202egnp.exe \\ud800"),
        ("Fahrzeug für 12 m²", "Fahrzeug für 12 m²"),
    ],
)
def test_control_characters_are_shown(text: str, shown: str) -> None:
    assert one_line(text) == shown
    assert str(UsageError(text)) == str(DataError(text)) == shown


def test_long_quotations_are_shortened_in_the_middle() -> None:
    text = one_line(f"model.npz: {'x' * 30_000} differs: train again")
    assert text.startswith("model.npz: xxx")
    assert text.endswith("xxx differs: train again")
    assert " ... " in text
    assert len(text) == 1000


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (ValueError("first\nsecond"), "first"),
        (ValueError("\n  first\n"), "first"),
        (ValueError(""), "ValueError"),
        (OSError(), "OSError"),
    ],
)
def test_the_first_line_of_an_error_is_never_empty(error: Exception, line: str) -> None:
    assert first_line(error) == line
