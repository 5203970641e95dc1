# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Drives that nobody has looked at: roads, speeds, cars and noise drawn from a seed.

A seed that is fixed only after the code, such as the hash of the code itself, makes it impossible
to choose anything on these drives. The training drive is one of the nominal car on a random road.
Each test has another road, and a car or conditions with one to three changes that the training
data do not contain; two tests are slaloms with open-loop steering. Two further tests are driven in
other simulators (`other_simulators`).

The draw is stratified, so that no set of 12 tests lacks what is hard: one slalom reaches speeds
above those of all training roads, the first test with changes has the friction of packed snow, and
each change occurs in every ten tests with changes.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from adk_ros.bench.paper.cases import NOMINAL, DriveSet
from adk_ros.bench.paper.other_simulators import DESCRIPTIONS, OtherDrive
from adk_ros.errors import DataError
from adk_ros.numerics.constants import GRAVITY
from adk_ros.plant.scenario.random_routes import ROAD_STYLES, RoadStyle, random_route, spins
from adk_ros.plant.scenario.scenario_file import Scenario, load_scenario
from adk_ros.plant.scenario.simulate import simulate
from adk_ros.plant.vehicle.vehicle_parameters import Vehicle, load_vehicle

VEHICLE = "imdv"
TRAINING_S, TEST_S, SLALOM_S = 1400.0, 150.0, 80.0
"""Durations, s; the training drive has that of the paper's."""
SLALOM_TOPS = ((25.0, 35.0), (35.0, 44.0))
"""
Ranges of the slaloms' top speeds, m/s: 90 to 126 and 126 to 158 km/h. Training roads are driven at
up to 27 m/s times 1.1, and 6 % more by the driver: 31.5 m/s.
"""
SLALOMS = len(SLALOM_TOPS)
MIN_TESTS, MAX_TESTS = 3, 200
TRAINING_FRICTION = 0.85
"""Of the paper's training road."""
STYLES = {
    "open": RoadStyle(
        10, (60.0, 350.0), (25.0, 250.0), 15.0, (2000.0, 5000.0), 27.0, (3.0, 4.2), 1.8, 2.6
    ),
    "hills": RoadStyle(
        10, (60.0, 220.0), (14.0, 80.0), 7.0, (1000.0, 3000.0), 22.0, (3.0, 4.2), 1.8, 2.6
    ),
    **ROAD_STYLES,
}
_STEEPEST = {"open": 0.05, "hills": 0.14, "track": 0.03, "town": 0.04}
"""Largest grade of the random height profile, by choice: usual of such roads."""
_GRIP_SHARE = (0.35, 0.65)
"""Range of the lateral acceleration, as a share of the friction: driven hard, but on the road."""
_HEIGHT_EVERY = 250.0
_SENSORS = {
    "imu": {"rate_hz": 200.0},
    "odometry": {"rate_hz": 50.0},
    "command": {"rate_hz": 40.0},
}

_SLOWER, _MAX_TRIES = 0.9, 9
"""As in `random_routes`."""
_SLIPPERY = (0.3, 0.5)
"""Friction of packed snow with winter tyres, by choice."""
Progress = Callable[[float, float, str], None]
Content = dict[str, Any]
Change = Callable[[np.random.Generator, Vehicle], Content]
"""Draws replacements of keys of a scenario."""


def _car(**changes: Any) -> Content:
    return {"vehicle_changes": changes}


def _load(rng: np.random.Generator, car: Vehicle) -> Content:
    factor = rng.uniform(1.1, 1.4)
    # Half of a load lies near the axles, half at the centre.
    inertia = car.yaw_inertia * (1.0 + 0.5 * (factor - 1.0))
    return _car(mass=car.mass * factor, yaw_inertia=inertia)


def _tyres(rng: np.random.Generator, car: Vehicle) -> Content:
    changes = {}
    for axle in ("front_tyre", "rear_tyre"):
        tyre = getattr(car, axle)
        changes[axle] = {
            "mu": tyre.mu * rng.uniform(0.8, 1.05),
            "b_y": tyre.b_y * rng.uniform(0.75, 1.1),
        }
    return _car(**changes)


def _centre_of_gravity(rng: np.random.Generator, car: Vehicle) -> Content:
    moved = rng.uniform(-0.12, 0.12)
    return _car(
        cg_to_front_axle=car.cg_to_front_axle + moved, cg_to_rear_axle=car.cg_to_rear_axle - moved
    )


def _wind(rng: np.random.Generator, car: Vehicle) -> Content:
    x, y = rng.uniform(-8.0, 8.0, 2).tolist()
    return {"wind": {"x": x, "y": y, "gust": rng.uniform(1.0, 5.0)}}


CHANGES: dict[str, Change] = {
    "load": _load,
    "light": lambda rng, car: _car(mass=car.mass * rng.uniform(0.86, 0.95)),
    "inertia": lambda rng, car: _car(yaw_inertia=car.yaw_inertia * rng.uniform(0.85, 1.2)),
    "tyres": _tyres,
    "balance": _centre_of_gravity,
    "friction": lambda rng, car: {"mu": rng.uniform(0.3, 0.75)},
    "steer_lag": lambda rng, car: _car(steer_lag=rng.uniform(0.06, 0.15)),
    "torque_lag": lambda rng, car: _car(torque_lag=rng.uniform(0.06, 0.15)),
    "drag": lambda rng, car: _car(
        cda=car.cda * rng.uniform(1.2, 2.0), crr=rng.uniform(0.008, 0.02)
    ),
    "wind": _wind,
}
"""What may differ from training: ranges of cars in use, by choice; friction from snow to damp."""


def write_confirmation_drives(
    folder: Path,
    seed: str,
    tests: int,
    progress: Progress | None = None,
    others: Sequence[str] = tuple(DESCRIPTIONS),
) -> DriveSet:
    """
    Write the scenario files of a set to a new folder, and return the set.

    A test in which the car spins is driven at 0.9 of its speeds until it does not, a slalom with
    0.81 of its steering.

    :param seed: any text; equal seeds give equal drives.
    :param tests: number of tests besides the nominal one and those in other simulators,
        `MIN_TESTS` to `MAX_TESTS`.
    :param others: simulators of the further tests, keys of `other_simulators.DESCRIPTIONS`.
    :param progress: called with (drives done, drives in all, text).
    """
    number = int.from_bytes(hashlib.sha256(seed.encode()).digest()[:8], "big")
    rng = np.random.default_rng(number)
    folder.mkdir(parents=True)
    car = load_vehicle(VEHICLE)
    training = _on_a_road(rng, "open", TRAINING_FRICTION) | {"duration_s": TRAINING_S}
    files = {NOMINAL: _written(folder, "training", training, rng)}
    order = ["friction", *rng.permutation([name for name in CHANGES if name != "friction"])]
    for index in range(tests):
        if index < SLALOMS:
            name, content = _slalom(rng, SLALOM_TOPS[index])
        else:
            turn = index - SLALOMS
            name, content = _test(rng, car, str(order[turn % len(order)]), slippery=turn == 0)
        name = f"{index + 1:02d}_{name}"
        files[name] = _written(folder, name, content, rng)
        _slow_down_to_the_road(Path(files[name]))
        if progress is not None:
            progress(index + 1, tests, "drawing drives")
    drives = {}
    for index, plant in enumerate(others):
        name, drive = _in_other_simulator(plant, (number, index))
        drives[name] = drive
        path = folder / f"{name}.drive.yaml"
        path.write_text(yaml.safe_dump(asdict(drive), sort_keys=False), encoding="utf-8")
    return DriveSet(
        training=files[NOMINAL],
        tests=(*files, *drives),
        files={test: path for test, path in files.items() if test != NOMINAL},
        noise_scale=float(rng.uniform(0.5, 1.5)),
        noise_seed=int(rng.integers(2**31)),
        others=drives,
    )


def _in_other_simulator(plant: str, seed: tuple[int, int]) -> tuple[str, OtherDrive]:
    rng = np.random.default_rng(seed)
    style = str(rng.choice(list(ROAD_STYLES)))
    return f"{plant}_{style}", OtherDrive(plant, style, int(rng.integers(2**31)), TEST_S)


def _written(folder: Path, name: str, content: Content, rng: np.random.Generator) -> str:
    base = {"name": name, "plant": "fourteen_dof", "vehicle": VEHICLE, "sensors": _SENSORS}
    content = base | {"seed": int(rng.integers(2**31))} | content
    path = folder / f"{name}.scenario.yaml"
    path.write_text(yaml.safe_dump(_plain(content), sort_keys=False), encoding="utf-8")
    load_scenario(path)
    return str(path)


def _slow_down_to_the_road(path: Path) -> None:
    """
    Reduce the speeds in a scenario file, or a slalom's steering, until the car does not spin.

    :raises DataError: it spins at any of them.
    """
    for _ in range(_MAX_TRIES):
        if not drive_spins(load_scenario(path)):
            return
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
        if "steering" in content:
            content["steering"]["amplitude"] *= _SLOWER**2
        else:
            content["speed"]["top"] *= _SLOWER
            content["speed"]["lateral_accel"] *= _SLOWER**2
        path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    raise DataError(
        f"{path.name}: the car spins with {_SLOWER ** (2 * (_MAX_TRIES - 1)):.2g} of its lateral "
        "acceleration as well"
    )


def drive_spins(scenario: Scenario) -> bool:
    """Return whether the car spins in a drive."""
    return spins(simulate(scenario).x[:, 1])


def _plain(value: Any) -> Any:
    """Return a value with NumPy numbers as Python's, which YAML needs."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_plain(item) for item in value]
    return float(value) if isinstance(value, float) else value


def _test(
    rng: np.random.Generator, car: Vehicle, change: str, *, slippery: bool
) -> tuple[str, Content]:
    """Return a drive with `change` and up to two others; `slippery`: on packed snow."""
    style = str(rng.choice(list(STYLES)))
    excluded = {change, {"load": "light", "light": "load"}.get(change, "")}
    more = rng.permutation([name for name in CHANGES if name not in excluded]).tolist()
    chosen = [change, *more[: int(rng.integers(0, 3))]]
    if {"load", "light"} <= set(chosen):
        chosen.remove("light")
    changes: Content = {"vehicle_changes": {}, "duration_s": TEST_S}
    for name in sorted(chosen):
        drawn = CHANGES[name](rng, car)
        changes["vehicle_changes"] |= drawn.pop("vehicle_changes", {})
        changes |= drawn
    if slippery:
        changes["mu"] = float(rng.uniform(*_SLIPPERY))
    tyres = [changes["vehicle_changes"].get(f"{axle}_tyre", {}) for axle in ("front", "rear")]
    grip = min(tyre.get("mu", car.front_tyre.mu) for tyre in tyres)
    friction = changes.get("mu", float(rng.uniform(0.8, 1.0)))
    content = _on_a_road(rng, style, friction, grip) | changes
    return "_".join([style, *sorted(chosen)]), content


def _on_a_road(
    rng: np.random.Generator, style: str, friction: float, grip: float = 1.0
) -> Content:
    """Return a random road with heights, and the speeds on it."""
    roads = STYLES[style]
    segments, length = random_route(rng, roads)
    limit = friction * grip * GRAVITY
    lateral = min(float(rng.uniform(*_GRIP_SHARE)) * limit, roads.lateral[1])
    return {
        "mu": friction,
        "route": [segment.model_dump(exclude_none=True) for segment in segments],
        "heights": _heights(rng, length, _STEEPEST[style]),
        "speed": {
            "top": roads.top * float(rng.uniform(0.85, 1.1)),
            "lateral_accel": lateral,
            "accel": min(roads.accel, 0.3 * limit),
            "brake": min(roads.brake, 0.4 * limit),
            "variation": 0.06,
        },
        "excitation": {
            "steer": 0.002 * friction, "torque": 80.0 * friction, "torque_step": 100.0 * friction,
        },
    }  # fmt: skip


def _heights(rng: np.random.Generator, length: float, steepest: float) -> list[Content]:
    """Return a height profile over a lap, m, whose mean grades stay within `steepest`."""
    count = max(4, int(length / _HEIGHT_EVERY))
    spacing = length / count
    # A smooth curve is up to 1.5 times as steep as the lines between its points.
    steps = rng.uniform(-1.0, 1.0, count) * steepest * spacing / 1.5
    steps -= steps.mean()
    height = np.concatenate([[0.0], np.cumsum(steps)[:-1]])
    return [{"at": i * spacing, "height": float(h)} for i, h in enumerate(height)]


def _slalom(rng: np.random.Generator, tops: tuple[float, float]) -> tuple[str, Content]:
    """Return a slalom with open-loop steering on a flat road; its top speed is in `tops`, m/s."""
    friction, top = float(rng.uniform(0.5, 1.0)), float(rng.uniform(*tops))
    share = float(rng.uniform(0.3, 0.6))
    # Steady cornering of a neutral car: a_y = v^2 delta / l.
    wheelbase = 2.67
    amplitude = share * friction * GRAVITY * wheelbase / top**2
    bend = {"bend": {"radius": 400.0, "angle_deg": 90.0, "transition": 60.0}}
    straight = {"straight": 4500.0}
    content = {
        "duration_s": SLALOM_S,
        "mu": friction,
        "start_speed": float(rng.uniform(0.5, 0.8)) * top,
        "route": [straight, bend, {"straight": 200.0}, bend] * 2,
        "speed": {
            "top": top, "lateral_accel": 3.0, "accel": 1.2, "brake": 2.0, "variation": 0.0,
        },
        "excitation": {"steer": 0.0, "torque": 40.0, "torque_step": 50.0},
        "steering": {
            "amplitude": amplitude,
            "slow_hz": float(rng.uniform(0.05, 0.15)), "fast_hz": float(rng.uniform(0.3, 0.8)),
            "fast_from": 10.0, "fast_until": 45.0, "blend": 6.0, "period": SLALOM_S,
        },
    }  # fmt: skip
    return f"slalom_{3.6 * top:.0f}kmh", content
