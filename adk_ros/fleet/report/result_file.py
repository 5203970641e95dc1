# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`fleet.json`: the result of a fleet and what its page says besides, from which it is written."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from adk_ros.errors import DataError
from adk_ros.files.pages.provenance import Provenance
from adk_ros.files.whole_file import whole_file
from adk_ros.fleet.inference.evidence import column_of
from adk_ros.fleet.inference.fleet_result import (
    SCHEMA,
    Claim,
    FleetResult,
    NotClaimed,
    PlaceClaim,
    TrendPoint,
    VehicleEffect,
)

_PAGE = "page"
_AGAIN = "run 'adk fleet mismatch' again"


@dataclass(frozen=True)
class PageContext:
    """
    What the page of a fleet says besides its result.

    `reports`: recording -> address of its report, relative to the page; `failed_reports`:
    recording -> why its report could not be made. `failed`: recordings without evidence, with the
    reason; `unplaced`: number of recordings that take no part in the search for places.
    """

    reports: Mapping[str, str] = field(default_factory=dict)
    failed_reports: Mapping[str, str] = field(default_factory=dict)
    failed: tuple[tuple[str, str], ...] = ()
    unplaced: int = 0
    provenance: Provenance | None = None


def write_result(result: FleetResult, context: PageContext, path: Path) -> None:
    """Write `fleet.json`, whole or not at all. :raises OSError: it cannot be written."""
    content = {**result.as_dict(), _PAGE: asdict(context)}
    with whole_file(path) as file:
        file.write(json.dumps(content, indent=1).encode())


def read_result(path: Path) -> tuple[FleetResult, PageContext]:
    """
    Return what `write_result` has written.

    :raises DataError: the file cannot be read, is damaged, or of another version of adk_ros.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise DataError(f"{path} cannot be read: {error.strerror or error}") from None
    except (ValueError, RecursionError) as error:
        raise DataError(f"{path} is damaged ({error}): {_AGAIN}") from None
    if not isinstance(content, dict):
        raise DataError(f"{path} is damaged (no object): {_AGAIN}")
    if (schema := content.get("schema")) != SCHEMA:
        raise DataError(
            f"{path} is of another version of adk_ros (schema {schema}, not {SCHEMA}): {_AGAIN}"
        )
    try:
        result = TypeAdapter(FleetResult).validate_python(content)
        context = TypeAdapter(PageContext).validate_python(content.get(_PAGE))
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = ".".join(map(str, first["loc"])) or _PAGE
        raise DataError(f"{path} is damaged ({place}: {first['msg']}): {_AGAIN}") from None
    if problem := _problem(result):
        raise DataError(f"{path} is damaged ({problem}): {_AGAIN}")
    return result, context


def _problem(result: FleetResult) -> str:
    """Return why the parts of a result do not belong together, "" if they do."""
    parts: tuple[Claim | PlaceClaim | NotClaimed | VehicleEffect | TrendPoint, ...] = (
        *result.claims, *result.places, *result.not_claimed, *result.vehicles, *result.trends,
    )  # fmt: skip
    try:
        for key in sorted({f"{part.effect}.{part.parameter}" for part in parts}):
            column_of(key)
    except DataError as error:
        return str(error)
    entries = {(v.car, v.effect, v.parameter) for v in result.vehicles}
    parameters = {(effect, parameter) for _, effect, parameter in entries}
    if any((car, *one) not in entries for car in result.cars for one in parameters):
        return "a vehicle lacks a parameter"
    if not {(p.effect, p.parameter) for p in result.trends} <= {
        (c.effect, c.parameter) for c in result.claims
    }:
        return "a trend is without a claim"
    if not (result.recordings and all(place.centres for place in result.places)):
        return "no recording, or a place without a cell"
    return ""
