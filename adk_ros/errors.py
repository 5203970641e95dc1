# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The two exception types of a refused request, with their exit codes."""


class AdkError(Exception):
    """A refused request; the one-line message says what, where and what to do."""

    exit_code = 2


class UsageError(AdkError):
    """The request is wrong: an argument, a parameter, a path, an unsuitable model."""

    exit_code = 2


class DataError(AdkError):
    """The request is valid, but the data is unusable: a topic is missing, a bag is too short."""

    exit_code = 3
