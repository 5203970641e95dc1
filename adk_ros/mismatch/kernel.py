# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The stand-in's equations, and one run of them along a recording.

Body axes, REP-103, origin at the centre of gravity. Wheels are quasi-static: what the drive gives,
less what the wheels' spin takes up, is on the road, F_x = (T - I_w dv_x/dt / R) / R, and the
lateral force is what the friction circle leaves,

    F_y = D sin(C atan(B a - E (B a - atan B a))) sqrt(1 - c (F_x / D)^2),

D = mu F_z, B = K / C D, at slip angle a; K is the slip stiffness, which friction leaves as it is.
v_x is followed (taken from a smoothed measurement) or simulated; v_y and yaw rate are simulated,
each drawn towards its measurement by a gain, since a slippery car's model would spin otherwise:

    dv_x/dt = a_x + r v_y - g sin(grade)           dr/dt = M_z / I_z
    dv_y/dt = a_y - r v_x - g sin(bank)

Loads follow a_x and a_y (m h a_x / L between axles, m h a_y / track across), the cross slope
(m (g cos(bank) - v_x r sin(bank))) and the downforce. Integrated by the
midpoint rule, its middle reached by the last step's derivative; dead times by the mean of the held
command over a step, lags and the slip's build-up by their exact solution over a step, so that all
are smooth in their parameters and may be zero.
"""

from __future__ import annotations

import math

import numpy as np

from adk_ros.mismatch.jit import kernel
from adk_ros.mismatch.parameters import INDEX
from adk_ros.plant.params import AIR_DENSITY, GRAVITY
from adk_ros.signals.channels import FloatArray, IntArray

A_X, A_Y, YAW_RATE, V_Y, V_X, YAW_ACCELERATION = range(6)
"""Rows of a run's output, each at the middle of a step."""
OUTPUTS = 6

S_V_X, S_V_Y, S_YAW_RATE, S_LOAD_X, S_LOAD_Y = range(5)
S_STEER, S_STEER_MORE, S_PLAY, S_TORQUE, S_TORQUE_MORE = range(5, 10)
S_SLIP = 10
S_X, S_Y, S_HEADING = 14, 15, 16
STATE_SIZE = 17
"""Named state: slips are of the four wheels, the pose is of the map."""

LEFT_OVER = 0.15
"""Share of the lateral grip that a wheel keeps whatever it drives or brakes."""

_MASS, _INERTIA, _L_F, _L_R = (
    INDEX["mass"], INDEX["yaw_inertia"], INDEX["cg_to_front_axle"], INDEX["cg_to_rear_axle"]
)
_TRACK, _HEIGHT, _RADIUS, _SPIN = (
    INDEX["track_width"], INDEX["cg_height"], INDEX["wheel_radius"], INDEX["wheel_inertia"]
)
_AREA, _VOLUME = INDEX["side_force_area"], INDEX["yaw_moment_volume"]
_K_F, _K_R, _C_F, _C_R = (
    INDEX["stiffness_f"], INDEX["stiffness_r"], INDEX["shape_f"], INDEX["shape_r"]
)
_E_F, _E_R, _MU_F, _MU_R = (
    INDEX["curvature_f"], INDEX["curvature_r"], INDEX["grip_f"], INDEX["grip_r"]
)
_SENSITIVITY, _FALLOFF = INDEX["load_sensitivity"], INDEX["stiffness_falloff"]
_COMBINED = INDEX["combined_slip"]
_RELAX, _ROLL, _LOAD_LAG = (
    INDEX["relaxation_length"], INDEX["roll_share_front"], INDEX["load_lag"]
)
_SPLIT, _DRAG, _LIFT, _ROLLING = (
    INDEX["torque_split_front"], INDEX["drag_area"], INDEX["lift_area"], INDEX["rolling"]
)
_STEER_GAIN, _STEER_OFFSET = INDEX["steer_gain"], INDEX["steer_offset"]
_STEER_DELAY, _STEER_LAG = INDEX["steer_delay"], INDEX["steer_lag"]
_STEER_MORE, _GAP = INDEX["steer_lag_more"], INDEX["steer_half_gap"]
_COMPLIANCE, _REAR = INDEX["steer_compliance"], INDEX["rear_steer"]
_GAIN, _BRAKE, _OFFSET = INDEX["torque_gain"], INDEX["brake_gain"], INDEX["torque_offset"]
_T_DELAY, _T_LAG, _T_MORE = (
    INDEX["torque_delay"], INDEX["torque_lag"], INDEX["torque_lag_more"]
)
_POWER, _SIDE, _DELAY = INDEX["power_inverse"], INDEX["side_drag"], INDEX["command_delay"]
_GRADE, _BANK, _FRICTION = INDEX["grade"], INDEX["bank"], INDEX["friction"]
_WIND_X, _WIND_Y = INDEX["wind_x"], INDEX["wind_y"]
_EXTRA_X, _EXTRA_Y, _EXTRA_YAW = INDEX["extra_x"], INDEX["extra_y"], INDEX["extra_yaw"]
_ODOMETRY_GAIN, _ODOMETRY_LAG = INDEX["odometry_gain"], INDEX["odometry_lag"]


@kernel
def lateral_share(slip: float, shape: float, curvature: float) -> float:
    """Return the Magic Formula's sin(C atan(s - E (s - atan s))) of a normalised slip."""
    return math.sin(shape * math.atan(slip - curvature * (slip - math.atan(slip))))


@kernel
def lagged(state: float, to: float, time: float, step: float) -> tuple[float, float]:
    """Return a first-order lag's (mean over, value after) a step towards a constant input."""
    if time < 1e-6 * step:
        return to, to
    x = step / time
    keep = math.exp(-x)
    return to + (state - to) * (1.0 - keep) / x, to + (state - to) * keep


@kernel
def held_mean(total: FloatArray, spacing: float, begin: float, step: float) -> float:
    """Return the mean of a held signal from `begin` on for `step`; `total` is its integral."""
    last = total.shape[0] - 1
    at = min(max(begin / spacing, 0.0), last - 1e-6)
    i = int(at)
    first = total[i] + (at - i) * (total[i + 1] - total[i])
    at = min(max((begin + step) / spacing, 0.0), last - 1e-6)
    i = int(at)
    second = total[i] + (at - i) * (total[i + 1] - total[i])
    most = last * spacing
    span = min(max(begin + step, 0.0), most) - min(max(begin, 0.0), most)
    mean: float = (second - first) / max(span, 1e-9)
    if span < 0.5 * step:
        # Before the first command, or after the last: that one holds.
        mean = (total[1] - total[0]) / spacing
        if begin > step:
            mean = (total[last] - total[last - 1]) / spacing
    return mean


@kernel
def body_forces(
    p: FloatArray,
    v_x: float,
    v_y: float,
    yaw_rate: float,
    delta: float,
    torque: float,
    load_x: float,
    load_y: float,
    slips: FloatArray,
    build_up: float,
    targets: FloatArray,
) -> tuple[float, float, float]:
    """
    Return (a_x, a_y, yaw acceleration): specific force at the centre of gravity, SI.

    `load_x`, `load_y` are the specific forces that the loads follow; `slips` (4,) the slip angles
    as far as they have built up, of which `build_up` remains; what they tend to is written into
    `targets` (4,).
    """
    mass, radius, wheelbase = p[_MASS], p[_RADIUS], p[_L_F] + p[_L_R]
    speed = max(v_x, 1.0)
    w_x, w_y = v_x - p[_WIND_X], p[_WIND_Y] - v_y
    air = math.hypot(w_x, w_y)
    pressure = 0.5 * AIR_DENSITY * air
    sin_grade, sin_bank = math.sin(p[_GRADE]), math.sin(p[_BANK])
    normal = GRAVITY * math.cos(p[_GRADE]) * math.cos(p[_BANK])
    weight = mass * (normal - v_x * yaw_rate * sin_bank)
    down = pressure * p[_LIFT] * w_x
    along = mass * p[_HEIGHT] * load_x / wheelbase
    front = max(weight * p[_L_R] / wheelbase - along + 0.5 * down, 100.0)
    rear = max(weight * p[_L_F] / wheelbase + along + 0.5 * down, 100.0)
    across = mass * p[_HEIGHT] * load_y / p[_TRACK]
    nominal = 0.25 * mass * GRAVITY
    f_x = -pressure * p[_DRAG] * w_x
    f_y = pressure * p[_AREA] * w_y
    m_z = pressure * p[_VOLUME] * w_y
    spin = p[_SPIN] / (radius * radius)
    # What takes the wheels' spin along: known but for a_x itself, which is solved for below.
    carried = yaw_rate * v_y - GRAVITY * sin_grade
    inertial = spin * (load_x + carried)
    cos_f, sin_f = math.cos(delta), math.sin(delta)
    rear_angle = p[_REAR] * delta
    cos_r, sin_r = 1.0, 0.0
    if rear_angle != 0.0:
        cos_r, sin_r = math.cos(rear_angle), math.sin(rear_angle)
    for i in range(4):
        is_front = i < 2
        side = 1.0 if i % 2 == 0 else -1.0
        axle = front if is_front else rear
        share = p[_ROLL] if is_front else 1.0 - p[_ROLL]
        load = max(0.5 * axle - side * share * across, 50.0)
        x = p[_L_F] if is_front else -p[_L_R]
        y = 0.5 * side * p[_TRACK]
        angle = delta if is_front else rear_angle
        cos, sin = (cos_f, sin_f) if is_front else (cos_r, sin_r)
        hub_x = max(speed - yaw_rate * y, 1.0)
        hub_y = v_y + yaw_rate * x
        targets[i] = angle - math.atan(hub_y / hub_x)
        slip = targets[i] + (slips[i] - targets[i]) * build_up
        more = load / nominal - 1.0
        grip = (p[_MU_F] if is_front else p[_MU_R]) * max(1.0 - p[_SENSITIVITY] * more, 0.2)
        peak = grip * p[_FRICTION] * load
        stiffness = (p[_K_F] if is_front else p[_K_R]) * load * max(1.0 - p[_FALLOFF] * more, 0.2)
        shape = p[_C_F] if is_front else p[_C_R]
        # The stiffness is the carcass's: a slippery road takes the grip alone.
        b = stiffness / (shape * peak)
        split = p[_SPLIT] if is_front else 1.0 - p[_SPLIT]
        # A brake that drags does so on its own side alone.
        driven = (0.5 * split * torque - max(side * p[_SIDE], 0.0)) / radius
        resisting = p[_ROLLING] * load
        t_x = driven - resisting
        used = min(abs(t_x - 0.25 * inertial) / peak, 1.0)
        left = math.sqrt(max(1.0 - p[_COMBINED] * used * used, LEFT_OVER * LEFT_OVER))
        t_y = peak * left * lateral_share(b * slip, shape, p[_E_F] if is_front else p[_E_R])
        # A locked or spinning wheel gives no more than the road takes.
        most = peak
        t_x = min(max(t_x, -most), most)
        b_x = t_x * cos - t_y * sin
        b_y = t_x * sin + t_y * cos
        f_x += b_x
        f_y += b_y
        m_z += x * b_y - y * b_x
    a_x = (f_x - spin * carried) / (mass + spin) + p[_EXTRA_X]
    a_y = f_y / mass + p[_EXTRA_Y]
    return a_x, a_y, m_z / p[_INERTIA] + p[_EXTRA_YAW]


@kernel
def _set_parameters(
    base: FloatArray, index: IntArray, amount: FloatArray, gate: IntArray, gates: FloatArray,
    k: int, p: FloatArray,
) -> None:
    p[:] = base
    for j in range(index.shape[0]):
        p[index[j]] += amount[j] * gates[gate[j], k]


@kernel
def commanded(
    p: FloatArray, state: FloatArray, torques: FloatArray, angles: FloatArray, spacing: float,
    time: float, step: float, v_x: float,
) -> tuple[float, float]:
    """
    Return the (torque, road-wheel angle) that act over the step from `time` on; advances lags.

    `torques`, `angles` are the commands' integrals over time, every `spacing` seconds.
    """
    begin = time - p[_DELAY]
    wish = held_mean(angles, spacing, begin - p[_STEER_DELAY], step)
    wish = p[_STEER_GAIN] * wish
    gap = p[_GAP]
    play = min(max(state[S_PLAY], wish - gap), wish + gap)
    state[S_PLAY] = play
    mean, state[S_STEER] = lagged(state[S_STEER], play, p[_STEER_LAG], step)
    delta, state[S_STEER_MORE] = lagged(state[S_STEER_MORE], mean, p[_STEER_MORE], step)
    delta += p[_STEER_OFFSET] - p[_COMPLIANCE] * state[S_LOAD_Y]
    asked = held_mean(torques, spacing, begin - p[_T_DELAY], step)
    asked *= p[_GAIN] * (p[_BRAKE] if asked < 0.0 else 1.0)
    mean, state[S_TORQUE] = lagged(state[S_TORQUE], asked, p[_T_LAG], step)
    torque, state[S_TORQUE_MORE] = lagged(state[S_TORQUE_MORE], mean, p[_T_MORE], step)
    torque += p[_OFFSET]
    if p[_POWER] > 0.0:
        torque = min(torque, p[_RADIUS] / (p[_POWER] * max(v_x, 1.0)))
    return torque, delta


@kernel
def simulate(
    base: FloatArray,
    index: IntArray,
    amount: FloatArray,
    gate: IntArray,
    gates: FloatArray,
    torques: FloatArray,
    angles: FloatArray,
    spacing: float,
    start: float,
    step: float,
    followed: FloatArray,
    measured: FloatArray,
    gains: FloatArray,
    extra: FloatArray,
    state: FloatArray,
    out: FloatArray,
    states: FloatArray,
) -> None:
    """
    Run the stand-in over `n` steps from `start` (s after the commands' integrals begin).

    The parameters are `base` plus `amount[j]` times row `gate[j]` of `gates` (g, n) at entry
    `index[j]`. `followed` (n + 1,) is v_x at the ends of the steps; empty: v_x is simulated.
    `measured` (n, 3) is (v_x, v_y, yaw rate) at the middle of each step, NaN where there is none,
    and `gains` (3,) the share of the difference that is made up at once. `extra` (n, 3) is added
    to the accelerations (a_x, a_y, yaw), and may be empty. `state` (STATE_SIZE,) is advanced in
    place; `out` (OUTPUTS, n) receives the middles of the steps, `states` (n + 1, 6) unless empty
    the v_x, v_y, yaw rate, x, y and heading at their ends.
    """
    n = out.shape[1]
    p = base.copy()
    slip_to = np.zeros(4)
    last_v_x, last_v_y, last_yaw_rate = 0.0, 0.0, 0.0
    follows = followed.shape[0] > 0
    more = extra.shape[0] > 0
    keeps = states.shape[0] > 0
    for k in range(n):
        changed = k == 0
        for j in range(index.shape[0]):
            if k > 0 and gates[gate[j], k] != gates[gate[j], k - 1]:
                changed = True
        if changed:
            _set_parameters(base, index, amount, gate, gates, k, p)
        v_x, v_y, yaw_rate = state[S_V_X], state[S_V_Y], state[S_YAW_RATE]
        v_x0 = followed[k] / p[_ODOMETRY_GAIN] if follows else v_x
        if keeps and k == 0:
            states[0, 0], states[0, 1], states[0, 2] = v_x0, v_y, yaw_rate
            states[0, 3], states[0, 4] = state[S_X], state[S_Y]
            states[0, 5] = state[S_HEADING]
        torque, delta = commanded(
            p, state, torques, angles, spacing, start + k * step, step, v_x0
        )
        load_x, load_y = state[S_LOAD_X], state[S_LOAD_Y]
        x = v_x0 * step / max(p[_RELAX], 1e-4)
        half = math.exp(-0.5 * x)
        slips = state[S_SLIP : S_SLIP + 4]
        sin_grade, sin_bank = math.sin(p[_GRADE]), math.sin(p[_BANK])
        # The middle of the step, by the last step's derivative.
        v_y1 = v_y + 0.5 * step * last_v_y
        yaw_rate1 = yaw_rate + 0.5 * step * last_yaw_rate
        v_x1 = v_x0 + 0.5 * step * last_v_x
        if follows:
            v_x1 = 0.5 * (followed[k] + followed[k + 1]) / p[_ODOMETRY_GAIN]
        a_x, a_y, w = body_forces(
            p, v_x1, v_y1, yaw_rate1, delta, torque, load_x, load_y, slips, half, slip_to
        )
        if more:
            a_x += extra[k, 0]
            a_y += extra[k, 1]
            w += extra[k, 2]
        last_v_x = a_x + yaw_rate1 * v_y1 - GRAVITY * sin_grade
        last_v_y = a_y - yaw_rate1 * v_x1 - GRAVITY * sin_bank
        last_yaw_rate = w
        new_v_x = v_x + step * last_v_x
        new_v_y = v_y + step * last_v_y
        new_yaw_rate = yaw_rate + step * w
        out[0, k], out[1, k], out[5, k] = a_x, a_y, w
        out[2, k] = 0.5 * (yaw_rate + new_yaw_rate)
        out[3, k] = 0.5 * (v_y + new_v_y)
        out[4, k] = 0.5 * (v_x + new_v_x)
        mid_heading = state[S_HEADING] + 0.5 * step * out[2, k]
        cos, sin = math.cos(mid_heading), math.sin(mid_heading)
        mean_x = out[4, k]
        state[S_X] += step * (mean_x * cos - out[3, k] * sin)
        state[S_Y] += step * (mean_x * sin + out[3, k] * cos)
        state[S_HEADING] += step * out[2, k]
        if not math.isnan(measured[k, 0]):
            new_v_x += gains[0] * (measured[k, 0] / p[_ODOMETRY_GAIN] - out[4, k])
        if not math.isnan(measured[k, 1]):
            new_v_y += gains[1] * (measured[k, 1] - out[3, k])
        if not math.isnan(measured[k, 2]):
            # A filtered rate is brought forward by what it lags behind.
            rate = measured[k, 2]
            if p[_ODOMETRY_LAG] > 0.0 and 0 < k < n - 1:
                rate += p[_ODOMETRY_LAG] * (measured[k + 1, 2] - measured[k - 1, 2]) / (2.0 * step)
            new_yaw_rate += gains[2] * (rate - out[2, k])
        state[S_V_X] = new_v_x
        state[S_V_Y] = min(max(new_v_y, -30.0), 30.0)
        state[S_YAW_RATE] = min(max(new_yaw_rate, -5.0), 5.0)
        _, state[S_LOAD_X] = lagged(load_x, a_x, p[_LOAD_LAG], step)
        _, state[S_LOAD_Y] = lagged(load_y, a_y, p[_LOAD_LAG], step)
        keep = math.exp(-x)
        for i in range(4):
            slips[i] = slip_to[i] + (slips[i] - slip_to[i]) * keep
        if keeps:
            states[k + 1, 0], states[k + 1, 1] = state[S_V_X], state[S_V_Y]
            states[k + 1, 2] = state[S_YAW_RATE]
            states[k + 1, 3], states[k + 1, 4] = state[S_X], state[S_Y]
            states[k + 1, 5] = state[S_HEADING]
