# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The page of a fleet, its corrected models, and the comparison of two results."""

from __future__ import annotations

import re
from copy import deepcopy
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from adk_ros.errors import UsageError
from adk_ros.fleet.inference.corrected_models import corrected_models, simulation_model
from adk_ros.fleet.inference.fleet_estimate import FleetEstimate
from adk_ros.fleet.inference.fleet_result import FleetResult, NotClaimed
from adk_ros.fleet.inference.fleet_selection import Selection
from adk_ros.fleet.inference.levels import CAR, RAMP, SHARED, Level
from adk_ros.fleet.inference.numerical_fleet import FleetPlan, Injection, draw_fleet
from adk_ros.fleet.inference.place_data import Place
from adk_ros.fleet.inference.place_evidence import Cell
from adk_ros.fleet.inference.result_of_estimate import fleet_result
from adk_ros.fleet.report.claim_text import claim_text
from adk_ros.fleet.report.fleet_comparison import compared_claims, write_comparison
from adk_ros.fleet.report.fleet_page import write_fleet_page
from adk_ros.fleet.report.fleet_rows import place_rows, summary_sentence, unplaced_text
from adk_ros.fleet.report.result_file import PageContext, read_result
from adk_ros.mismatch.deployment.surrogate_file import SurrogateFile
from adk_ros.mismatch.library.surrogate_parameters import default_parameters
from adk_ros.mismatch.report.vocabulary import title
from adk_ros.mismatch.surrogate.identification import SurrogateModel

pytestmark = pytest.mark.slow(seconds=30)


@cache
def result(drag: float = 5.0) -> FleetResult:
    plan = FleetPlan(
        cars=4,
        effects=6,
        recordings=32,
        injections=(
            Injection("aero_drag.cda", Level(SHARED), drag),
            Injection("rolling_resistance.crr", Level(RAMP, car="car03", onset=20.0), 12.0),
            Injection("low_friction.mu_scale", Level(CAR, car="car02"), -7.0),
        ),
    )
    fleet = draw_fleet(2, plan)
    selection = Selection(fleet)
    model = selection.select()
    cells = (Cell(3, 4, 0), Cell(4, 4, 0))
    place = Place("road_grade.grade", cells, 6.0, 0.5, 9.0, 1e-9, fleet.names[:10])
    estimate = FleetEstimate(
        fleet,
        selection,
        model,
        tuple(selection.assessed(model)),
        (place,),
        dict.fromkeys(fleet.names, 1.5),
        {Cell(x, 4, 0): 10 for x in range(9)},
    )
    return fleet_result(estimate, {"drive003": 9.0})


def surrogate() -> SurrogateModel:
    return SurrogateModel(
        default_parameters(),
        np.zeros(6),
        np.zeros((6, 100)),
        np.zeros((0, default_parameters().size)),
    )


def test_the_page_shows_claims_vehicles_trends_places_and_links(tmp_path: Path) -> None:
    models = corrected_models(result(), surrogate())
    context = PageContext(
        {"drive003": "drive003/report.html"}, failed=(("drive_009", "bag is truncated"),)
    )
    page = write_fleet_page(result(), tmp_path, context, models)
    text = page.read_text()
    assert "more drag area (C_dA) (all cars)" in text
    assert 'href="drive003/report.html"' in text
    assert 'href="corrected_all.yaml"' in text
    assert "bag is truncated" in text
    ramp = next(c for c in result().claims if c.kind == RAMP)
    onset = f"onset between day {ramp.onset_low_day:.0f} and {ramp.onset_high_day:.0f}"
    assert f"{ramp.level}, {onset}" in text
    assert onset in summary_sentence(result())
    place = result().places[0]
    assert (place.recordings, place.days, place.cars) == (10, 10, 4)
    assert "10 recordings, by 4 cars, on 10 days" in text
    assert (
        place_rows([replace(place, days=1, cars=1)])[0][3]
        == "10 recordings, by 1 car, on 1 day only"
    )
    for figure in ("vehicles.png", "map.png", "trend_0.png"):
        assert (tmp_path / figure).stat().st_size > 1000
    assert read_result(tmp_path / "fleet.json") == (result(), context)


def test_the_page_says_whether_the_error_on_other_roads_is_known(tmp_path: Path) -> None:
    known = replace(result(), further_drives=3)
    for found, said in (
        (known, "in 3 further drives of the simulation"),
        (result(), "hides small"),
    ):
        text = write_fleet_page(found, tmp_path).read_text()
        assert said in text
        assert ("--further-simulation" in text) == (found.further_drives == 0)


def test_the_page_says_what_the_last_pass_left(tmp_path: Path) -> None:
    for unsettled in (0, 2):
        text = write_fleet_page(replace(result(), unsettled=unsettled), tmp_path).read_text()
        assert ("of 2 recordings once more: sizes are preliminary" in text) == (unsettled == 2)


def test_models_of_claims_that_are_no_longer_made_are_removed(tmp_path: Path) -> None:
    (tmp_path / "simulation.yaml").touch()
    models = corrected_models(result(), surrogate())
    write_fleet_page(result(), tmp_path, models=models)
    del models["corrected_car02.yaml"]
    page = write_fleet_page(result(), tmp_path, models=models)
    assert {path.name for path in tmp_path.glob("*.yaml")} == {*models, "simulation.yaml"}
    assert "corrected_car02" not in page.read_text()


def test_the_page_says_what_all_cars_share_and_nothing_explains(tmp_path: Path) -> None:
    candidate = NotClaimed(
        "brake_torque_gain",
        "scale",
        "-",
        Level(SHARED).text,
        -0.034,
        -0.036,
        -0.032,
        "significant, but it explains too little of what differs",
        is_claimable=True,
    )
    for name in ("explained", "not"):
        (tmp_path / name).mkdir()
    sentence = "Something that all cars share is unexplained"
    assert sentence not in write_fleet_page(result(), tmp_path / "explained").read_text()
    doubtful = replace(result(), not_claimed=(candidate,))
    text = write_fleet_page(doubtful, tmp_path / "not").read_text()
    assert sentence in text
    assert "explains too little of what differs" in text


def test_corrected_models_hold_the_effects_of_their_level() -> None:
    texts = corrected_models(result(), surrogate())
    assert {"corrected_all.yaml", "corrected_car02.yaml", "corrected_car03.yaml"} <= set(texts)
    every = SurrogateFile.model_validate(yaml.safe_load(texts["corrected_all.yaml"]))
    assert [term.effect for term in every.terms] == ["aero_drag"]
    assert every.terms[0].parameters["cda"] == pytest.approx(0.15, rel=0.3)
    own = SurrogateFile.model_validate(yaml.safe_load(texts["corrected_car02.yaml"]))
    assert {term.effect for term in own.terms} == {"aero_drag", "low_friction"}


def test_the_model_of_the_simulation_has_no_effect() -> None:
    plain = SurrogateFile.model_validate(yaml.safe_load(simulation_model(surrogate())))
    assert plain.terms == []


def test_claims_are_phrases_with_sizes() -> None:
    texts = {c.effect: claim_text(c) for c in result().claims}
    drag = next(c for c in result().claims if c.effect == "aero_drag")
    assert re.fullmatch(r"0\.1\d+ m² more drag area \(C_dA\)", texts["aero_drag"].phrase)
    low, high = map(float, re.findall(r"0\.\d+", texts["aero_drag"].interval))
    assert (low, high) == pytest.approx((drag.low, drag.high), abs=0.01)
    assert re.fullmatch(r"\d+ % lower road friction", texts["low_friction"].phrase)
    assert texts["low_friction"].interval.endswith(" %")


def test_the_sentence_of_a_fleet_without_a_claim() -> None:
    plain = replace(result(), claims=(), places=())
    assert "no effect of the catalogue is significant" in summary_sentence(plain)
    assert "times those of a perfect model" in summary_sentence(plain)
    assert "So few cars" not in summary_sentence(plain)
    assert "So few cars" in summary_sentence(replace(plain, cars=("a", "b", "c")))
    assert summary_sentence(result()).count("(at 1 place)") == 1


def test_the_worst_recordings_come_first() -> None:
    every = result()
    ratios = [r.loss_ratio for r in every.worst(len(every.recordings))]
    assert ratios == sorted(ratios, reverse=True)
    assert len(every.worst(3)) == 3
    assert every.worst(0) == []


def test_values_by_car_are_those_of_its_claims() -> None:
    drag = {v.car: v for v in result().vehicles if v.effect == "aero_drag"}
    assert all(abs(v.size - 0.15) < 0.05 for v in drag.values())
    friction = {v.car: v.is_claimed for v in result().vehicles if v.effect == "low_friction"}
    assert friction == {"car01": False, "car02": True, "car03": False, "car04": False}


def test_a_comparison_says_what_an_update_mended(tmp_path: Path) -> None:
    before, after = result().as_dict(), result(0.0).as_dict()
    rows = {(row[0], row[1]): row[4] for row in compared_claims(before, after)}
    drag = f"{title('aero_drag')}, cda"
    assert rows[drag, "all cars"] == "no longer claimed"
    assert "unchanged" in rows.values()
    grade = f"{title('road_grade')}, grade"
    assert rows[grade, "at a place, (210, 270) m"] == "unchanged"
    page = write_comparison(before, after, tmp_path, names=("1.0", "1.1"))
    assert "Fleet: 1.0 vs 1.1" in page.read_text()
    with pytest.raises(UsageError, match=r"no fleet\.json of this version"):
        write_comparison({"schema": 0}, after, tmp_path)
    # Of an earlier version, before the interval of onsets.
    earlier: dict[str, Any] = deepcopy(before) | {"schema": 1}
    for claim in earlier["claims"]:
        del claim["onset_low_day"], claim["onset_high_day"]
    assert write_comparison(earlier, after, tmp_path) == page


def test_a_comparison_knows_ties_and_places_that_touch() -> None:
    before = result().as_dict()
    after: dict[str, Any] = deepcopy(before)
    drag = next(c for c in after["claims"] if c["effect"] == "aero_drag")
    drag.update(effect="headwind", parameter="wind_x", ties=["aero_drag (all cars)"])
    (place,) = after["places"]
    place["centres"] = [[x + 60.0, y] for x, y in place["centres"]]
    rows = {row[0]: row[4] for row in compared_claims(before, after)}
    assert rows.pop(f"{title('aero_drag')}, now {title('headwind')}") == (
        "tied: the other one is named"
    )
    assert set(rows.values()) == {"unchanged"}
    drag["ties"] = ["rolling_resistance (all cars) and aero_drag (all cars)"]
    assert {row[4] for row in compared_claims(before, after)} == {
        "tied: the other one is named",
        "unchanged",
    }
    place["centres"] = [[x + 600.0, y] for x, y in place["centres"]]
    drag["ties"] = []
    status = sorted(row[4] for row in compared_claims(before, after))
    assert (status.count("new"), status.count("no longer claimed")) == (2, 2)
    # Such as a place that was passed on one day only.
    listed = {
        "effect": "road_grade", "parameter": "grade", "level": "at a place, (210, 270) m",
        "is_claimable": True,
    }  # fmt: skip
    (ramp,) = [c for c in after["claims"] if c["kind"] == "ramp"]
    # With another change point.
    trend = {**ramp, "level": "growing from day 3 on in car03", "is_claimable": True}
    after["claims"] = [c for c in after["claims"] if c is not ramp]
    after["places"], after["not_claimed"] = [], [listed, trend]
    rows = {row[0]: row[4] for row in compared_claims(before, after)}
    grade = f"{title('road_grade')}, grade"
    assert rows[grade] == "no longer claimed, but still a candidate"
    assert rows[f"{title(ramp['effect'])}, {ramp['parameter']}"] == rows[grade]


def test_changes_of_one_effect_are_compared_with_the_nearest() -> None:
    """Two trends of one car in another order; one of them is a step now, the other is mended."""
    before: dict[str, Any] = result().as_dict()
    ramp = next(c for c in before["claims"] if c["kind"] == "ramp")
    later = {
        **ramp, "onset_day": 40.0, "size": 9.0, "low": 8.0, "high": 10.0,
        "level": "growing from day 40 on in car03",
    }  # fmt: skip
    before["claims"] = [ramp, later]
    after = {**before, "claims": [later, ramp]}
    assert {row[4] for row in compared_claims(before, after)} >= {"unchanged"}
    assert "changed" not in {row[4] for row in compared_claims(before, after)}
    after["claims"] = [{**later, "kind": "step", "level": "from day 41 on in car03"}]
    rows = [row[2:] for row in compared_claims(before, after)]
    assert [row[2] for row in rows[:2]] == ["no longer claimed", "unchanged"]
    # A tie at another level is another claim.
    claims: Any = result().as_dict()["claims"]
    shared = next(c for c in claims if c["effect"] == "aero_drag")
    other = {**shared, "effect": "headwind", "parameter": "wind_x"}
    tied = [{**shared, "ties": ["headwind (car03)"]}]
    rows = compared_claims({**before, "claims": tied}, {**before, "claims": [other]})
    assert [row[4] for row in rows[:1]] == ["no longer claimed"]


def test_recordings_that_did_not_improve_are_not_listed_so(tmp_path: Path) -> None:
    before = result().as_dict()
    after: dict[str, Any] = deepcopy(before)
    text = write_comparison(before, before, tmp_path).read_text()
    assert "None differs" in text
    assert "Most improved" not in text
    for recording in after["recordings"]:
        recording["loss_before"] += 1.0
    text = write_comparison(before, after, tmp_path).read_text()
    assert "Most improved" not in text
    assert "Worse" in text


def test_no_model_replaces_that_of_another_car() -> None:
    found = result()
    claim = next(c for c in found.claims if c.car)
    cars = ("all", "car 1", "car_1")
    claims = tuple(replace(claim, car=car) for car in cars)
    models = corrected_models(replace(found, cars=cars, claims=claims), surrogate())
    assert list(models) == [
        "corrected_all.yaml", "corrected_all_2.yaml", "corrected_car_1.yaml",
        "corrected_car_1_2.yaml",
    ]  # fmt: skip


def test_recordings_without_a_map_are_said(tmp_path: Path) -> None:
    assert unplaced_text(0) == ""
    assert unplaced_text(1).startswith("1 recording begins at x = y = 0 and counts for no place")
    text = unplaced_text(3)
    assert text.startswith("3 recordings begin at x = y = 0 and count for no place")
    assert text in write_fleet_page(result(), tmp_path, PageContext(unplaced=3)).read_text()
