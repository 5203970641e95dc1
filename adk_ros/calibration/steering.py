# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Steering angle: sign, unit, ratio, offset and delay, by the models of `steering_fit`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from adk_ros.calibration.criteria import (
    MATERIAL,
    MAX_LATERAL,
    MAX_UNIT_ERROR,
    MIN_CORRELATION,
    SIGNIFICANCE,
)
from adk_ros.calibration.finding import (
    NO_PARAMETER,
    Finding,
    Verdict,
    found,
    judged,
    not_decidable,
    ok,
    undecided,
)
from adk_ros.calibration.grid import Signals, shifted, smooth
from adk_ros.calibration.regression import Estimate
from adk_ros.calibration.signs_and_units import gain
from adk_ros.calibration.steering_fit import (
    SteeringFit,
    fit_front_axle,
    fit_single_track,
    sideways_is_measured,
)
from adk_ros.calibration.streams import Streams
from adk_ros.plant.vehicle.vehicle_parameters import Dimensions
from adk_ros.signals.decode import SensorConfig

_FRONT_BIAS = 0.1
"""Difference of the two ratios that the load dependence of the tyres explains: up to 0.12 on 13
simulated cars without a fault of the steering."""
_PLAUSIBLE = 0.75
"""Ratio by the front axle, or its inverse, below which its model does not fit; by choice."""
_HAND_WHEEL_RATIO = (5.0, 35.0)
"""Hand-wheel angle over road-wheel angle: of race cars to heavy trucks (M. Abe, Vehicle Handling
Dynamics, 2015, section 5: 15 to 20 for passenger cars)."""
_DEGREES = 180.0 / np.pi
_LONGEST_WHEELBASE_M = 25.0
"""No car has one."""
_COARSE_TOLERANCE = 0.35
"""|ln| within which a ratio is that of a unit before anything else is known."""


_WITH_RATIO = "joint_state"
"""Type of the command whose steering angle is divided by `steering_ratio`."""
_REMEDY_RATIO = (
    "no parameter for this: the angle of an Ackermann or Autoware command is that of the road "
    "wheels, correct what publishes it"
)
_REMEDY_DELAY = (
    "no parameter for this: a slow steering is no error of a sensor; `adk train` learns it, and "
    "`adk mismatch` names it as steering_delay"
)


def check_sign(
    streams: Streams, s: Signals, sensors: SensorConfig, wheelbase: float | None, command_type: str
) -> tuple[list[Finding], Streams, SensorConfig]:
    """
    Return findings on sign and unit of the steering, and streams and sensors with them.

    :param command_type: of the recording, which need not be the configured one.
    """
    if streams.command is None:
        return [], streams, sensors
    if s.steering is None:
        reason = "the command has no steering angle, or a constant one"
        return [not_decidable("steering", reason)], streams, sensors
    if s.v_x is None or s.turning is None:
        reason = "it needs a speed and a yaw rate"
        return [not_decidable("steering", reason)], streams, sensors
    # At standstill and low speed v_x r says little: the curvature is compared.
    curvature = s.turning / np.where(np.abs(s.v_x) > 1.0, s.v_x, 1.0)
    g = max(
        (gain(shifted(smooth(s.steering), lag), curvature, s.moving) for lag in (0.0, 0.2, 0.4)),
        key=lambda each: 0.0 if each is None else abs(each.correlation),
    )
    evidence = "steering angle against the curvature r / v_x"
    if g is None or abs(g.correlation) < MIN_CORRELATION - 0.2:
        correlation = 0.0 if g is None else g.correlation
        reason = f"its correlation with the curvature is {correlation:.2f}: too few bends"
        return [not_decidable("steering", reason, evidence)], streams, sensors
    evidence += f": {g.value:.3g} m, correlation {g.correlation:.2f}, {s.moving_s:.0f} s"
    factor, texts = 1.0, []
    if g.value < 0.0:
        factor = -1.0
        texts.append("the steering angle has its sign flipped: it must be positive to the left")
    length = abs(g.value)
    if wheelbase is not None:
        unit, size = _unit(length / wheelbase)
        if unit:
            factor *= size
            texts.append(f"the steering angle looks like {unit}")
    elif length > _LONGEST_WHEELBASE_M:
        # What it is cannot be said without the wheelbase.
        reason = f"the steering angle is {length:.0f} m times the curvature: give --vehicle"
        texts.append(f"{reason}, it is no road-wheel angle in rad")
    if not texts:
        return [ok("steering", "sign and unit", evidence)], streams, sensors
    ratio = sensors.steering_ratio * factor
    # Other commands state the angle of the road wheels: no parameter of theirs corrects it.
    has_ratio = command_type == _WITH_RATIO
    proposal = {}
    if factor != 1.0 and has_ratio:
        proposal = {"steering_ratio": round(ratio, 4)}
        if sensors.steering_offset:
            # It is the offset of what is divided by the ratio.
            proposal["steering_offset"] = round(sensors.steering_offset / factor, 6)
    command = streams.command.having(steering=streams.command["steering"] / factor)
    remedy = NO_PARAMETER if has_ratio else _REMEDY_RATIO
    return (
        [found("steering", "; ".join(texts), evidence, proposal, remedy)],
        replace(streams, command=command),
        (
            replace(
                sensors, steering_ratio=ratio, steering_offset=sensors.steering_offset / factor
            )
            if has_ratio
            else sensors
        ),
    )


def _unit(ratio: float) -> tuple[str, float]:
    """Return the name of what is `ratio` times a road-wheel angle, and the factor to remove."""
    if abs(np.log(ratio)) < np.log(_HAND_WHEEL_RATIO[0]) - MAX_UNIT_ERROR:
        return "", 1.0
    if abs(np.log(ratio / _DEGREES)) < _COARSE_TOLERANCE:
        return "deg at the road wheel", _DEGREES
    if _HAND_WHEEL_RATIO[0] < ratio < _HAND_WHEEL_RATIO[1]:
        return f"a hand-wheel angle (about {ratio:.1f} times the road wheel's)", ratio
    if _HAND_WHEEL_RATIO[0] < ratio / _DEGREES < _HAND_WHEEL_RATIO[1]:
        return f"a hand-wheel angle in deg ({ratio / _DEGREES:.1f} times the road wheel's)", ratio
    return f"a unit of its own: {ratio:.3g} times the road-wheel angle", ratio


def check_steering(
    s: Signals,
    sensors: SensorConfig,
    vehicle: Dimensions | None,
    wheelbase: float | None,
    command_type: str,
) -> Iterator[Finding]:
    """
    Yield ratio, offset and delay of the steering.

    :param vehicle: gives the place of the front axle; None where it is not known, or where v_y is
        not that of the configured reference point.
    :param command_type: as for `check_sign`.
    """
    if s.steering is None or s.v_x is None or s.turning is None:
        return
    evidence = (
        "regression of v_x delta on r, v_x² r, v_x and v_x dr/dt (single-track model) at less "
        f"than {MAX_LATERAL:g} m/s²"
    )
    front = None
    if vehicle is not None and sideways_is_measured(s):
        ahead = vehicle.cg_to_front_axle + sensors.reference_point[0]
        front = fit_front_axle(s, ahead)
    fit = fit_single_track(s, None if front is None else front.delay.value)
    if fit is None:
        reason = "no delay fits best, or there is too little driving in the linear range"
        yield not_decidable("steering_ratio", reason, evidence)
        return
    length = fit.regression.estimate(0)
    gain_left = 1.0
    if wheelbase is None:
        yield Finding(
            "steering_ratio",
            Verdict.NOT_DECIDABLE,
            "not decidable, because the wheelbase is unknown: give --vehicle; steering angle per "
            f"curvature {length.value:.3g} m ({length.low:.3g} to {length.high:.3g})",
            length.value,
            length.low,
            length.high,
            "m",
            evidence=evidence,
            seconds=length.seconds,
        )
    else:
        ratio = _ratio(length.divided(wheelbase), front, sensors, evidence, command_type)
        ratio = _unless_weighted(ratio, s, fit.delay.value, wheelbase)
        yield ratio
        if "steering_ratio" in ratio.parameters:
            gain_left = length.value / wheelbase
    text = (
        "the car drives straight ahead at a steering angle (a cross slope of the straights and an "
        "asymmetric set-up look the same)"
    )
    offset = fit.regression.estimate(2)
    # A reading of c delta + o is corrected by the ratio c and the offset o / c at the road wheels.
    proposal = {"steering_offset": offset.value / gain_left}
    if wheelbase is None and length.value > _LONGEST_WHEELBASE_M:
        proposal = {}
    yield judged("steering_offset", offset, 0.0, text, evidence, parameters=proposal)
    yield _delay(fit, front, evidence)


def _ratio(
    ratio: Estimate,
    front: SteeringFit | None,
    sensors: SensorConfig,
    evidence: str,
    command_type: str,
) -> Finding:
    proposal = {"steering_ratio": round(sensors.steering_ratio * ratio.value, 4)}
    if sensors.steering_offset:
        # Relative to the known one (`known_errors`): what is known is divided by the ratio too.
        proposal["steering_offset"] = sensors.steering_offset * (1.0 / ratio.value - 1.0)
    if command_type != _WITH_RATIO:
        proposal = {}
    text = "steer joint angle over road-wheel angle"
    out = judged(
        "steering_ratio", ratio, 1.0, text, evidence, parameters=proposal, remedy=_REMEDY_RATIO
    )
    if out.verdict is not Verdict.FINDING or front is None:
        return out
    other = front.regression.estimate(0)
    scatter = float(np.hypot(ratio.standard_error, other.standard_error))
    if abs(ratio.value - other.value) > max(_FRONT_BIAS, SIGNIFICANCE * scatter):
        reason = (
            f"the yaw rate gives {ratio.value:.2f} and the slip of the front axle "
            f"{other.value:.2f}: not the steering alone differs from the vehicle file"
        )
        return undecided(out, reason)
    return out


def _unless_weighted(finding: Finding, s: Signals, delay_s: float, wheelbase: float) -> Finding:
    """
    Return the finding on the ratio, undecided where it depends on the weights of the samples.

    Where the model holds, fast and slow driving give the same ratio.
    """
    value = finding.value
    if finding.verdict is not Verdict.FINDING or value is None:
        return finding
    fit = fit_single_track(s, delay_s, is_by_speed=False)
    other = 1.0 if fit is None else float(fit.regression.values[0]) / wheelbase
    if (value - 1.0) * (other - 1.0) > 0.0 and abs(other - 1.0) >= MATERIAL["steering_ratio"].size:
        return finding
    reason = (
        f"the ratio is {value:.3f} with samples weighted by speed and {other:.3f} with equal "
        "weights: the single-track model does not hold"
    )
    return undecided(finding, reason)


def _delay(fit: SteeringFit, front: SteeringFit | None, evidence: str) -> Finding:
    name = "steering_delay"
    if front is None:
        text = "the car responds to the steering later than a single-track model, in s"
        return judged(
            name, fit.delay, 0.0, text, evidence, kind="steering_response", remedy=_REMEDY_DELAY
        )
    evidence = "regression of v_x delta on v_y + l_f r, v_x a_y, v_x and v_x dr/dt (front axle)"
    text = "the front axle responds later than the steering angle, in s"
    out = judged(name, front.delay, 0.0, text, evidence, remedy=_REMEDY_DELAY)
    ratio = front.regression.estimate(0).value
    if out.verdict is Verdict.FINDING and not _PLAUSIBLE < ratio < 1.0 / _PLAUSIBLE:
        reason = f"the model of the front axle does not fit (ratio {ratio:.2f}); bank or low grip"
        return undecided(out, reason)
    return out
