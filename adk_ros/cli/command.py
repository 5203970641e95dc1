# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Command classes of the parser: options given once, plain types and groups in the help."""

from __future__ import annotations

import re
from collections import Counter
from typing import Any

from typer.core import TyperCommand, TyperGroup

DATA, PREDICT, COMPARE, MEASURE, INSTALL = "Data", "Predict", "Compare", "Measure", "Install"
"""Groups of verbs in `adk --help`, in this order."""

_GROUPS = (DATA, PREDICT, COMPARE, MEASURE, INSTALL)


_LIST_TYPE = re.compile(r"(?:\.\.\.)? <list\[(\w+)\]>")


def readable_usage(usage: str) -> str:
    """Return a parameter in the help with its list type in plain form: `bags <path>...`."""
    return _LIST_TYPE.sub(lambda found: f" <{found[1].lower()}>...", usage)


class VerbCommand(TyperCommand):
    """A verb that refuses an option with a single value if it is given more than once."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the command line; fails in one line if a single-value option is repeated."""
        if not ctx.resilient_parsing:
            _, _, given = self.make_parser(ctx).parse_args(args=list(args))
            for param, count in Counter(given).items():
                if count > 1 and param.param_type_name == "option" and not _may_repeat(param):
                    ctx.fail(
                        f"Option '{param.opts[-1]}' is given {count} times: it takes one value."
                    )
        return super().parse_args(ctx, args)

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write arguments and options, lists as `<path>...`."""
        write = formatter.write_dl

        def write_readable(rows: Any, *arguments: Any, **options: Any) -> None:
            write([(readable_usage(usage), text) for usage, text in rows], *arguments, **options)

        formatter.write_dl = write_readable
        super().format_options(ctx, formatter)
        formatter.write_dl = write


def _may_repeat(option: Any) -> bool:
    """Whether an option collects values, or is a flag that cannot contradict itself."""
    return bool(option.multiple or option.count or (option.is_flag and not option.secondary_opts))


class VerbGroup(TyperGroup):
    """The command `adk`: its help lists the verbs by group."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write a section of verbs for each group."""
        commands = [(name, self.get_command(ctx, name)) for name in self.list_commands(ctx)]
        shown = [(name, command) for name, command in commands if command and not command.hidden]
        width = formatter.width - 6 - max((len(name) for name, _ in shown), default=0)
        for group in _GROUPS:
            rows = [
                (name, command.get_short_help_str(width))
                for name, command in shown
                if getattr(command, "rich_help_panel", None) == group
            ]
            if rows:
                with formatter.section(group):
                    formatter.write_dl(rows)
