# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The two ways in which a run is refused, each with the exit code it ends with."""


class AdkError(Exception):
    """A refusal that a person can act on: says what, where and what to do, in one line."""

    exit_code = 2


class UsageError(AdkError):
    """The request itself is wrong: an argument, a parameter, a path, a model that does not fit."""

    exit_code = 2


class DataError(AdkError):
    """The request is sound, but the data cannot serve it: a topic lacks, a bag is too short."""

    exit_code = 3
