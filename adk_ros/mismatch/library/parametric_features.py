# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Features with parameters of their own: memory, thresholds, wear, and oscillations.

Each has a name that holds its parameters, so that a file can name it:

- `lag:SIGNAL:TAU`, a first-order lag, y' = (s - y) / tau;
- `resonance:SIGNAL:FREQUENCY:DAMPING`, the force of a mass on a spring and a damper per unit of
  mass, w^2 x + 2 z w x' with x'' + 2 z w x' + w^2 x = s and w = 2 pi FREQUENCY;
- `hysteresis:SIGNAL:WIDTH`, the stress of a spring in series with dry friction that yields at
  WIDTH: the hysteretic part of backlash (`numerics.filters.stop_operator`);
- `gate:FEATURE:CONDITION>THRESHOLD` (or `<`), a feature where a condition holds, zero elsewhere;
- `excess:FEATURE:THRESHOLD`, the part of a feature beyond +-THRESHOLD;
- `drift:FEATURE:VARIABLE:SCALE`, a feature times 1 - exp(-x / SCALE), x the time or the braking
  work since the start of the recording;
- `decay:FEATURE:VARIABLE:SCALE`, a feature times exp(-x / SCALE);
- `heat:FEATURE:TAU`, a feature times the braking power with a first-order lag: work that cools;
- `wave:FREQUENCY:PHASE` and `wave:FREQUENCY:PHASE:CONDITION>THRESHOLD`, cos(2 pi FREQUENCY t +
  PHASE) with t from the start of the recording;
- `pulsation:FREQUENCY:PHASE:FEATURE`, a feature times the same;
- `ripple:WAVELENGTH:PHASE:FEATURE`, a feature times cos(2 pi s / WAVELENGTH + PHASE) with s the
  distance travelled;
- `speed_wave:PERIOD:PHASE:FEATURE`, a feature times cos(2 pi v_x / PERIOD + PHASE).

Time and the phase of an oscillation cannot be transferred to another recording. The braking work
is the integral of max(-T v_x, 0), in N m^2: J times the wheel radius. Signals and features are
those of `library.features`, which also needs `time`, s, on an even grid.
"""

from __future__ import annotations

from collections.abc import Sequence

LAG, RESONANCE, GATE, WAVE = "lag", "resonance", "gate", "wave"
HYSTERESIS, EXCESS, DRIFT, HEAT, RIPPLE = "hysteresis", "excess", "drift", "heat", "ripple"
DECAY, PULSATION, SPEED_WAVE = "decay", "pulsation", "speed_wave"
TIME, BRAKE_WORK = "time", "brake_work"
FILTERED_SIGNALS = {
    "a_x": ("longitudinal acceleration", "a_x", "m/s^2"),
    "a_y": ("lateral acceleration", "a_y", "m/s^2"),
    "yaw_rate": ("yaw rate", "r", "rad/s"),
    "torque": ("torque", "T", "N m"),
    "delta": ("steering angle", "delta", "rad"),
}
"""Signal -> words, symbol and unit, of those that may act with a memory."""
CONDITIONS = {
    "lateral_size": ("lateral acceleration", "|a_y|", "m/s²"),
    "speed": ("speed", "v_x", "m/s"),
    "delta_size": ("steering angle", "|delta|", "rad"),
    "torque": ("torque", "T", "N·m"),
    "deceleration": ("deceleration", "-a_x", "m/s²"),
    TIME: ("time", "t", "s"),
}
"""Name -> words, symbol and unit, of what may switch a feature on."""
MAX_FREQUENCY_HZ, MIN_FREQUENCY_HZ = 10.0, 0.02
MAX_TAU_S = 1000.0
_TAU = (1e-3, MAX_TAU_S)
_FREQUENCY = (MIN_FREQUENCY_HZ, MAX_FREQUENCY_HZ)
_PHASE = (-10.0, 10.0)
_DAMPING = (0.0, 2.0)
_WAVELENGTH_M = (0.1, 1e4)
_PERIOD_MPS = (0.1, 1e3)
_SIZE = (1e-9, 1e12)
_LAYOUTS: dict[str, tuple[str | tuple[float, float], ...]] = {
    LAG: ("signal", _TAU),
    RESONANCE: ("signal", _FREQUENCY, _DAMPING),
    HYSTERESIS: ("signal", _SIZE),
    GATE: ("feature", "condition"),
    EXCESS: ("feature", _SIZE),
    DRIFT: ("feature", "variable", _SIZE),
    DECAY: ("feature", "variable", _SIZE),
    HEAT: ("feature", _TAU),
    WAVE: (_FREQUENCY, _PHASE, "condition"),
    PULSATION: (_FREQUENCY, _PHASE, "feature"),
    RIPPLE: (_WAVELENGTH_M, _PHASE, "feature"),
    SPEED_WAVE: (_PERIOD_MPS, _PHASE, "feature"),
}
"""Kind -> its arguments: a name, or the range of a number. The condition of a wave is optional."""
_SEARCHED = {RESONANCE: 2, PULSATION: 2, RIPPLE: 2, SPEED_WAVE: 2}
"""Searched parameters of a kind, where not one; those of a wave depend on its condition."""


_FORMS = {
    LAG: LAG,
    RESONANCE: RESONANCE,
    HYSTERESIS: HYSTERESIS,
    EXCESS: "threshold",
    HEAT: "wear",
    WAVE: "oscillation in time",
    PULSATION: "oscillation in time",
    RIPPLE: "oscillation in distance",
    SPEED_WAVE: "oscillation with speed",
    "sine_of_speed": "oscillation with speed",
}


def kind_of(name: str) -> str:
    """Return the kind of a parametric feature's name, or an empty text."""
    kind = name.split(":", 1)[0]
    return kind if kind in _LAYOUTS and ":" in name else ""


def searched_parameters(name: str) -> int:
    """Return how many parameters of a feature were searched, besides its coefficient."""
    kind = kind_of(name)
    if kind == WAVE:
        return 2 + name.count(">") + name.count("<")
    return _SEARCHED.get(kind, 1) if kind else 0


def has_memory(name: str) -> bool:
    """Whether a feature depends on earlier signals."""
    return kind_of(name) in {LAG, RESONANCE, HYSTERESIS} or has_unlimited_memory(name)


def has_unlimited_memory(name: str) -> bool:
    """Whether a feature depends on all signals since the start of a recording."""
    return kind_of(name) in {DRIFT, DECAY, HEAT, RIPPLE}


def form_of(name: str) -> str:
    """
    Return the form of a term's dependence on its variable, in a word or two.

    "static", "lag", "resonance", "hysteresis", "threshold", "change with time", "wear" (by work
    done), or "oscillation in time", "in distance" or "with speed".
    """
    kind = kind_of(name)
    if kind == GATE:
        by_time = split_condition(name.split(":")[2])[0] == TIME
        return "change with time" if by_time else "threshold"
    if kind in {DRIFT, DECAY}:
        return "change with time" if name.split(":")[2] == TIME else "wear"
    return _FORMS.get("sine_of_speed" if name == "sine_of_speed" else kind, "static")


def is_transferable(name: str) -> bool:
    """Whether a feature has a meaning in another recording."""
    kind = kind_of(name)
    if kind == GATE:
        return split_condition(name.split(":")[2])[0] != TIME
    if kind in {DRIFT, DECAY}:
        return name.split(":")[2] != TIME
    return kind not in {WAVE, PULSATION, RIPPLE}


def base_of(name: str) -> str:
    """Return the feature that a parametric feature modifies, or an empty text."""
    kind, *arguments = name.split(":")
    layout = _LAYOUTS.get(kind, ())
    return arguments[layout.index("feature")] if "feature" in layout else ""


def number_text(value: float) -> str:
    """Return a parameter with the digits that a name keeps."""
    return f"{value:.4g}"


def lag_name(signal: str, tau: float) -> str:
    """Return the name of a first-order lag of a signal."""
    return f"{LAG}:{signal}:{number_text(tau)}"


def resonance_name(signal: str, frequency: float, damping: float) -> str:
    """Return the name of a resonance excited by a signal."""
    return f"{RESONANCE}:{signal}:{number_text(frequency)}:{number_text(damping)}"


def hysteresis_name(signal: str, width: float) -> str:
    """Return the name of the hysteresis of a signal."""
    return f"{HYSTERESIS}:{signal}:{number_text(width)}"


def gate_name(feature: str, condition: str, above: bool, threshold: float) -> str:
    """Return the name of a feature that acts above or below a threshold."""
    return f"{GATE}:{feature}:{condition}{'>' if above else '<'}{number_text(threshold)}"


def excess_name(feature: str, threshold: float) -> str:
    """Return the name of the part of a feature beyond a threshold."""
    return f"{EXCESS}:{feature}:{number_text(threshold)}"


def drift_name(feature: str, variable: str, scale: float) -> str:
    """Return the name of a feature that grows with the time or the braking work."""
    return f"{DRIFT}:{feature}:{variable}:{number_text(scale)}"


def decay_name(feature: str, variable: str, scale: float) -> str:
    """Return the name of a feature that fades with the time or the braking work."""
    return f"{DECAY}:{feature}:{variable}:{number_text(scale)}"


def heat_name(feature: str, tau: float) -> str:
    """Return the name of a feature that grows with the recent braking power."""
    return f"{HEAT}:{feature}:{number_text(tau)}"


def wave_name(frequency: float, phase: float, gate: str = "") -> str:
    """Return the name of an oscillation in time; `gate` as in `CONDITION>THRESHOLD`."""
    # The phase is that at t = 0: the frequency needs more digits than others.
    text = f"{WAVE}:{frequency:.6g}:{number_text(phase)}"
    return f"{text}:{gate}" if gate else text


def pulsation_name(frequency: float, phase: float, feature: str) -> str:
    """Return the name of a feature that oscillates in time."""
    return f"{PULSATION}:{frequency:.6g}:{number_text(phase)}:{feature}"


def ripple_name(wavelength: float, phase: float, feature: str) -> str:
    """Return the name of a feature that oscillates with the distance travelled."""
    return f"{RIPPLE}:{wavelength:.7g}:{number_text(phase)}:{feature}"


def speed_wave_name(period: float, phase: float, feature: str) -> str:
    """Return the name of a feature that oscillates with the speed."""
    return f"{SPEED_WAVE}:{period:.6g}:{number_text(phase)}:{feature}"


def sizes_of(name: str) -> list[float]:
    """Return the positive numbers of a feature that scale it: no threshold of a gate, no phase."""
    kind, arguments = parsed(name)
    if kind in {GATE, WAVE, PULSATION, RIPPLE, SPEED_WAVE}:
        return []
    layout = _LAYOUTS[kind]
    return [float(x) for x, of in zip(arguments, layout, strict=True) if isinstance(of, tuple)]


def scaled(name: str, factors: Sequence[float]) -> str:
    """Return a feature with each of its `sizes_of` multiplied by a factor, within its range."""
    kind, arguments = parsed(name)
    remaining = list(factors)
    parts = [kind]
    for argument, expected in zip(arguments, _LAYOUTS[kind], strict=True):
        if isinstance(expected, tuple):
            value = float(argument) * float(remaining.pop(0))
            parts.append(number_text(min(max(value, expected[0]), expected[1])))
        else:
            parts.append(argument)
    return ":".join(parts)


def split_condition(text: str) -> tuple[str, bool, float]:
    """
    Return (condition, above, threshold) of `CONDITION>THRESHOLD`.

    Raises `ValueError` for anything else.
    """
    for sign in (">", "<"):
        name, found, value = text.partition(sign)
        if found and name in CONDITIONS:
            return name, sign == ">", _number(value, -1e9, 1e9)
    raise ValueError(f"'{text}' is not a condition")


def parsed(name: str) -> tuple[str, list[str]]:
    """
    Return kind and checked arguments of a parametric feature.

    Raises `ValueError` with what is wrong.
    """
    kind, *arguments = name.split(":")
    layout = _LAYOUTS.get(kind, ())
    if kind == WAVE and len(arguments) == len(layout) - 1:
        layout = layout[:-1]
    if not layout or len(arguments) != len(layout):
        raise ValueError(f"feature '{name}' is unknown")
    for argument, expected in zip(arguments, layout, strict=True):
        if isinstance(expected, tuple):
            _number(argument, *expected)
        elif expected == "condition":
            split_condition(argument)
        elif (expected == "signal" and argument not in FILTERED_SIGNALS) or (
            expected == "variable" and argument not in {TIME, BRAKE_WORK}
        ):
            raise ValueError(f"feature '{name}' is unknown")
    return kind, arguments


def _number(text: str, low: float, high: float) -> float:
    try:
        value = float(text)
    except ValueError:
        raise ValueError(f"'{text}' is not a number") from None
    if not low <= value <= high:
        raise ValueError(f"{text} is not within {low:g} to {high:g}")
    return value
