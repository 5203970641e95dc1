# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A calibration is no missing physics: sentence, page and JSON report it apart."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from helpers.mismatch_report import drag, identified, odd, result_of
from helpers.pages import Page

from adk_ros.mismatch.inference.result import IdentifiedEffect
from adk_ros.mismatch.report.calibration_text import calibration_title
from adk_ros.mismatch.report.result_files import as_dict, write_report
from adk_ros.mismatch.report.summary import sentence, verdict_text
from adk_ros.signals.decode import SensorConfig

pytestmark = pytest.mark.usefixtures("unrendered")


def gyro(**changes: object) -> IdentifiedEffect:
    return identified("gyro_scale", 1.02, 1.018, 1.022, **changes)


def ratio() -> IdentifiedEffect:
    return identified("steering_ratio", 0.93, 0.92, 0.94)


def test_a_calibration_alone_is_no_missing_physics() -> None:
    result = result_of("", (gyro(),))
    assert sentence(result).startswith(
        "The recording shows no missing physics, only a calibration: an IMU yaw rate that reads "
        "2.0 % too high (90 % confidence interval 1.8 to 2.2 %). Set gyro_scale: 1.02 in the "
        "parameters of train, replay and the node. "
    )
    assert verdict_text(result) == "No missing physics; 1 calibration: gyro scale"
    assert result.verdict == as_dict(result)["verdict"] == "explained"


def test_physics_comes_first() -> None:
    result = result_of("", (gyro(), identified()))
    assert sentence(result).startswith(
        "The recording shows 0.92 m² more drag area (C_dA) than the simulation (90 % confidence "
        "interval 0.88 to 0.97 m²). Calibration: an IMU yaw rate that reads 2.0 % too high (90 % "
        "confidence interval 1.8 to 2.2 %). Set gyro_scale: 1.02 in the parameters"
    )
    assert verdict_text(result) == "1 effect identified: air drag; 1 calibration: gyro scale"
    # Programs read the effects in the order of the analysis.
    assert [each["name"] for each in as_dict(result)["effects"]] == ["gyro_scale", "aero_drag"]


def test_several_calibrations_are_numbered_and_set_together() -> None:
    late = identified("imu_delay", 0.05, 0.048, 0.052)
    said = sentence(result_of("", (gyro(), late)))
    assert "no missing physics, only calibrations: (1) an IMU yaw rate" in said
    assert "; (2) IMU readings that are 0.050 s late" in said
    assert "Set gyro_scale: 1.02 and imu_delay: 0.05 in the parameters" in said


def test_what_may_be_either_says_so() -> None:
    result = result_of("", (ratio(),))
    said = sentence(result)
    assert said.startswith(
        "The recording shows a calibration or a difference of the car: 7.0 % less"
    )
    assert (
        "Set steering_ratio: 1.075 in the parameters of train, replay and the node if the "
        "steering command is scaled wrongly; if the steering of the car has another ratio than "
        "the simulated one, it is missing physics: set nothing."
    ) in said
    assert "no missing physics" not in said
    assert verdict_text(result) == ("1 calibration, or a difference of the car: steering ratio")
    assert calibration_title(result) == "Calibration, or a difference of the car"
    assert calibration_title(result_of("", (gyro(),))) == "Calibration"


def test_an_alternative_of_the_other_category_says_so() -> None:
    delay = identified("steering_delay", 0.1, 0.09, 0.11, alternatives=["clock_offset"])
    result = result_of("", (delay,))
    assert "or command clock offset (a calibration): not distinguishable" in sentence(result)
    assert as_dict(result)["effects"][0]["category_ambiguous"] is True
    tilt = identified("imu_tilt", 0.02, 0.018, 0.022, alternatives=["road_bank"])
    said = sentence(result_of("", (tilt,)))
    assert "road bank (cross slope) (physics): not distinguishable" in said
    assert "if the cause is road bank (cross slope), it is missing physics: set nothing." in said
    assert "headwind" not in sentence(drag()) or "(physics)" not in sentence(drag())


def test_a_filter_has_no_parameter() -> None:
    said = sentence(result_of("", (identified("odometry_filter", 0.25, 0.24, 0.26),)))
    assert "No parameter corrects the filter: publish the unfiltered yaw rate. " in said
    assert "Set " not in said


def test_a_calibration_from_an_onset_on_is_for_later_recordings() -> None:
    from_then = gyro(kind="time", onset_s=60.0)
    assert (
        "Set gyro_scale: 1.02 in the parameters of train, replay and the node for later "
        "recordings (in this one it holds only from 60.0 s on)."
    ) in sentence(result_of("", (from_then,)))


def test_with_an_unknown_cause_nothing_is_said_to_be_all() -> None:
    result = odd(gyro())
    assert "It also shows a calibration: an IMU yaw rate" in sentence(result)
    assert "o missing physics" not in sentence(result) + verdict_text(result)
    assert verdict_text(result) == "Difference of unknown cause; 1 calibration: gyro scale"


def test_the_parameters_contain_those_of_reading() -> None:
    known = replace(result_of("", (gyro(),)), sensors=SensorConfig(gyro_scale=57.3))
    assert "Set gyro_scale: 58.446 in" in sentence(known)


def test_json_has_category_and_parameters() -> None:
    bias = identified("imu_bias", 0.2, 0.19, 0.21)
    answer = json.loads(json.dumps(as_dict(result_of("", (identified(), bias, gyro())))))
    physics, of_bias, of_gyro = answer["effects"]
    assert (physics["category"], physics["category_ambiguous"]) == ("physics", False)
    assert "calibration" not in physics
    assert of_bias["category"] == of_gyro["category"] == "calibration"
    assert of_bias["calibration"]["parameters"] == {
        "accelerometer_bias": [0.2, 0.2],
        "gyro_bias": 0.2,
    }
    assert of_gyro["calibration"]["text"].startswith("Set gyro_scale: 1.02 in")
    assert answer["calibration"]["parameters"] == {
        "accelerometer_bias": [0.2, 0.2],
        "gyro_bias": 0.2,
        "gyro_scale": 1.02,
    }
    assert "calibration" not in as_dict(drag())
    # What may be physics is not to be set without a decision.
    either = as_dict(result_of("", (ratio(), gyro())))
    assert either["effects"][0]["calibration"]["parameters"] == {"steering_ratio": 1.075}
    assert either["calibration"]["parameters"] == {"gyro_scale": 1.02}
    assert "steering_ratio: 1.075" in either["calibration"]["text"]


@pytest.mark.parametrize(
    ("effects", "physics", "calibration"),
    [
        ((identified(),), True, False),
        ((ratio(),), False, True),
        ((gyro(), identified()), True, True),
        ((), False, False),
    ],
)
def test_the_page_has_a_table_for_each_category(
    effects: tuple[IdentifiedEffect, ...], physics: bool, calibration: bool, tmp_path: Path
) -> None:
    write_report(result_of("", effects), tmp_path / "report")
    page = Page((tmp_path / "report" / "report.html").read_text(encoding="utf-8"))
    headings = page.text
    assert ("Missing physics effect" in headings) == physics
    assert ("A calibration is an error of a sensor" in headings) == calibration
    assert ("what to do" in headings) == calibration


def test_the_sentence_shows_the_parameters_as_a_parameter_file_has_them() -> None:
    arm = identified("imu_lever_arm", 0.8, 0.79, 0.81)
    said = sentence(result_of("", (arm,)))
    shown = said.split("Set ")[1].split(" in the parameters")[0]
    assert yaml.safe_load(shown) == {"imu_position": [0.8, 0.8]}
