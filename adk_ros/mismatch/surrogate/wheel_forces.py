# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Forces of the surrogate's four wheels, computed as one vector.

The lateral force is limited by the friction circle:

    F_y = D sin(C atan(B a - E (B a - atan B a))) sqrt(1 - c (F_x / D)^2)

with slip angle a, D = mu F_z, B = K / (C D), and the slip stiffness K, which friction does not
change. H. B. Pacejka, Tire and Vehicle Dynamics, 3rd ed. (2012), chapters 1 and 4.

All values of the wheels are in one array, in rows of four: the compiler vectorises the loop over
the wheels only where it sees that nothing overlaps. That takes a third of the time.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import GRAVITY
from adk_ros.numerics.elementary import fast_atan, fast_sin
from adk_ros.numerics.numba_cache import inlined_kernel, relaxed_kernel
from adk_ros.numerics.similarity import FULL_SIZE_WHEELBASE, REFERENCE_WHEELBASE

MIN_LATERAL_UTILISATION = 0.15
"""Share of the lateral grip that a wheel keeps under any longitudinal force."""
MIN_FRICTION = 0.02
"""Least road friction: several active terms at one place may sum to less than zero."""
MIN_SPEED = 1.0
"""
Least longitudinal speed in slip angles, m/s, of a full-size car: they are undefined at standstill.
"""
MIN_WHEEL_LOAD = 50.0
"""Least load of a wheel, N, of a full-size car."""
MIN_LOAD_FACTOR = 0.2
"""Least factor of grip and of stiffness by load sensitivity, which is linear in the load."""

_MASS = INDEX["mass"]
_L_F = INDEX["cg_to_front_axle"]
_L_R = INDEX["cg_to_rear_axle"]
_TRACK = INDEX["track_width"]
_HEIGHT = INDEX["cg_height"]
_RADIUS = INDEX["wheel_radius"]
_K_F = INDEX["stiffness_f"]
_K_R = INDEX["stiffness_r"]
_C_F = INDEX["shape_f"]
_C_R = INDEX["shape_r"]
_E_F = INDEX["curvature_f"]
_E_R = INDEX["curvature_r"]
_MU_F = INDEX["grip_f"]
_MU_R = INDEX["grip_r"]
_SENSITIVITY = INDEX["load_sensitivity"]
_FALLOFF = INDEX["stiffness_falloff"]
_COMBINED = INDEX["combined_slip"]
_BRUSH = INDEX["brush_share"]
_ROLL_SHARE = INDEX["roll_share_front"]
_SPLIT = INDEX["torque_split_front"]
_ROLLING_RESISTANCE = INDEX["rolling"]
_SIDE_DRAG = INDEX["side_drag"]
_FRICTION = INDEX["friction"]

WHEELS = 4
"""Front left, front right, rear left, rear right."""
# Offsets of the rows. Constants of the parameters:
_FRONT, _X, _Y, _ACROSS, _GRIP, _STIFFNESS, _SHAPE, _CURVATURE, _DRIVEN, _DRAGGING = range(
    0, 10 * WHEELS, WHEELS
)
_SLOWEST, LEAST_LOAD = range(10 * WHEELS, 12 * WHEELS, WHEELS)
# Values of a step:
SLIP, SLIP_TARGET, FORCE_X, FORCE_Y = range(12 * WHEELS, 16 * WHEELS, WHEELS)
WHEEL_TABLE_SIZE = 16 * WHEELS
"""
A wheel table holds rows of four values: 1 at the front; position x and y, m; load transfer over
a_y, N per m/s²; friction; stiffness and shape of the tyre curve, and its curvature; longitudinal
force over drive torque, 1/m; force of a dragging brake, N; least speed in slip angles, m/s, and
load, N; slip angle after relaxation, and the
one it approaches, rad; forces in body axes, N.
"""


@inlined_kernel
def normalised_lateral_force(slip: float, shape: float, curvature: float, brush: float) -> float:
    """
    Return the lateral force over the peak force at normalised slip s = B tan(alpha).

    Blends the Magic Formula, sin(C atan(s - E (s - atan s))), with a share `brush` of the brush
    model, 3 z - 3 z^2 + z^3 with z = C |s| / 3 (1 beyond z = 1). Both have the initial slope C.
    """
    share = fast_sin(shape * fast_atan(slip - curvature * (slip - fast_atan(slip))))
    z = min(shape * abs(slip) / 3.0, 1.0)
    return share + brush * (math.copysign(z * (3.0 - 3.0 * z + z * z), slip) - share)


@relaxed_kernel
def set_wheels(table: FloatArray, p: FloatArray) -> None:
    """Write the rows of a wheel table that are constants of the parameters `p` (SIZE,)."""
    wheelbase = p[_L_F] + p[_L_R]
    # As `numerics.similarity.length_scale`.
    size = 1.0 if wheelbase >= FULL_SIZE_WHEELBASE else wheelbase / REFERENCE_WHEELBASE
    wheelbase_height = p[_MASS] * p[_HEIGHT] / p[_TRACK]
    for i in range(WHEELS):
        is_front = i < 2
        side = 1.0 if i % 2 == 0 else -1.0
        roll_share = p[_ROLL_SHARE] if is_front else 1.0 - p[_ROLL_SHARE]
        split = p[_SPLIT] if is_front else 1.0 - p[_SPLIT]
        table[_FRONT + i] = 1.0 if is_front else 0.0
        table[_X + i] = p[_L_F] if is_front else -p[_L_R]
        table[_Y + i] = 0.5 * side * p[_TRACK]
        table[_ACROSS + i] = side * roll_share * wheelbase_height
        table[_GRIP + i] = (p[_MU_F] if is_front else p[_MU_R]) * max(p[_FRICTION], MIN_FRICTION)
        table[_STIFFNESS + i] = p[_K_F] if is_front else p[_K_R]
        table[_SHAPE + i] = p[_C_F] if is_front else p[_C_R]
        table[_CURVATURE + i] = p[_E_F] if is_front else p[_E_R]
        table[_DRIVEN + i] = 0.5 * split / p[_RADIUS]
        # A dragging brake acts on the wheels of its side only.
        table[_SLOWEST + i] = MIN_SPEED * math.sqrt(size)
        table[LEAST_LOAD + i] = MIN_WHEEL_LOAD * (size * size * size)
        table[_DRAGGING + i] = max(side * p[_SIDE_DRAG], 0.0) / p[_RADIUS]


class WheelInputs(NamedTuple):
    """What acts on the wheels at one instant, SI."""

    v_x: float
    hub_v_y: float
    """Lateral velocity of the hubs without yaw, m/s."""
    yaw_rate: float
    front_load: float
    """Load of the front axle, N."""
    rear_load: float
    load_y: float
    """Lateral specific force that the wheel loads follow, m/s²."""
    front_angle: float
    rear_angle: float
    torque: float
    inertial: float
    """Force that accelerates the spin of the wheels, N."""


@inlined_kernel
def wheel_forces(table: FloatArray, p: FloatArray, at: WheelInputs, build_up: float) -> None:
    """
    Write the forces, and the slip angles that are approached, into a wheel table.

    `build_up`: the share of the slip angles after relaxation that still counts.
    """
    cos_f, sin_f = fast_sin(at.front_angle + 0.5 * math.pi), fast_sin(at.front_angle)
    cos_r, sin_r = fast_sin(at.rear_angle + 0.5 * math.pi), fast_sin(at.rear_angle)
    nominal = 0.25 * p[_MASS] * GRAVITY
    sensitivity, falloff, brush = p[_SENSITIVITY], p[_FALLOFF], p[_BRUSH]
    combined, rolling, inertial = p[_COMBINED], p[_ROLLING_RESISTANCE], 0.25 * at.inertial
    for i in range(WHEELS):
        is_front = table[_FRONT + i] > 0.5
        axle = at.front_load if is_front else at.rear_load
        load = max(0.5 * axle - table[_ACROSS + i] * at.load_y, table[LEAST_LOAD + i])
        angle = at.front_angle if is_front else at.rear_angle
        slowest = table[_SLOWEST + i]
        hub_x = max(max(at.v_x, slowest) - at.yaw_rate * table[_Y + i], slowest)
        hub_y = at.hub_v_y + at.yaw_rate * table[_X + i]
        target = angle - fast_atan(hub_y / hub_x)
        slip = target + (table[SLIP + i] - target) * build_up
        excess = load / nominal - 1.0
        peak = table[_GRIP + i] * load * max(1.0 - sensitivity * excess, MIN_LOAD_FACTOR)
        stiffness = table[_STIFFNESS + i] * load * max(1.0 - falloff * excess, MIN_LOAD_FACTOR)
        # The carcass determines the stiffness: a slippery road reduces the grip only.
        b = stiffness / (table[_SHAPE + i] * peak)
        t_x = table[_DRIVEN + i] * at.torque - table[_DRAGGING + i] - rolling * load
        used = min(abs(t_x - inertial) / peak, 1.0)
        utilisation = math.sqrt(
            max(1.0 - combined * used * used, MIN_LATERAL_UTILISATION * MIN_LATERAL_UTILISATION)
        )
        share = normalised_lateral_force(b * slip, table[_SHAPE + i], table[_CURVATURE + i], brush)
        t_y = peak * utilisation * share
        # The friction limits the force of a locked or spinning wheel.
        t_x = min(max(t_x, -peak), peak)
        cos = cos_f if is_front else cos_r
        sin = sin_f if is_front else sin_r
        table[SLIP_TARGET + i] = target
        table[FORCE_X + i] = t_x * cos - t_y * sin
        table[FORCE_Y + i] = t_x * sin + t_y * cos


@inlined_kernel
def summed_wheel_forces(table: FloatArray) -> tuple[float, float, float]:
    """Return the force (N) and moment (N·m) of all wheels (F_x, F_y, M_z) on the body."""
    f_x, f_y, m_z = 0.0, 0.0, 0.0
    for i in range(WHEELS):
        f_x += table[FORCE_X + i]
        f_y += table[FORCE_Y + i]
        m_z += table[_X + i] * table[FORCE_Y + i] - table[_Y + i] * table[FORCE_X + i]
    return f_x, f_y, m_z


@inlined_kernel
def relax_slips(table: FloatArray, keep: float) -> None:
    """Advance the slip angles of a wheel table by a step after which the share `keep` remains."""
    for i in range(WHEELS):
        target = table[SLIP_TARGET + i]
        table[SLIP + i] = target + (table[SLIP + i] - target) * keep
