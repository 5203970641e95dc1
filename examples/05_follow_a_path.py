# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A sampling controller follows a path with the adapted predictor as its model.

The predictor adapts on a minute of bags/town. A simulated car, 160 kg heavier than the one that
the model knows, goes on from there on a slalom, and the controller (MPPI, Williams et al., ICRA
2017) drives it: every 25 ms it asks for the states under 200 candidates. Takes about a minute with
the model of the first example (`--model example_out/model`), two without. An example, not a
product: the pose is exact, and nothing checks the commands.
"""

import argparse
import time
from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt

import adk_ros
from adk_ros.plant.vehicle.seven_dof import (
    STATE_SIZE,
    STEP,
    V_X,
    YAW_RATE,
    X,
    Y,
    advance,
    rolling_state,
)
from adk_ros.plant.vehicle.vehicle_parameters import load_vehicle
from adk_ros.signals.channels import TICK_NS, Sample

BAGS = Path(__file__).resolve().parents[1] / "bags"
ADAPT_S = 60.0
TICK_S = TICK_NS * 1e-9
STEPS, CANDIDATES, NODES = 40, 200, 10
SPREAD = np.array([200.0, 0.01])
"""Standard deviation of the candidates at the nodes, N·m and rad."""
LIMITS = np.array([2000.0, 0.4])
TEMPERATURE = 0.02
AMPLITUDE, WAVELENGTH = 1.5, 70.0
"""Of the slalom, m."""
NOISE = np.array([0.02, 0.02, 0.002])
"""Standard deviations of the measured v_x, v_y and yaw rate, m/s and rad/s."""


def path(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return lateral position, m, and heading, rad, of the slalom; it grows over a wavelength."""
    wave = 2.0 * np.pi / WAVELENGTH
    y = AMPLITUDE * np.clip(x / WAVELENGTH, 0.0, 1.0) * np.sin(wave * x)
    slope = AMPLITUDE * np.clip(x / WAVELENGTH, 0.0, 1.0) * wave * np.cos(wave * x)
    return y, np.arctan(slope)


def cost(states: np.ndarray, commands: np.ndarray, pose: np.ndarray, speed: float) -> np.ndarray:
    """Return the costs (k,) of states (k, h, 3) under commands (k, h, 2) from a pose (3,)."""
    v_x, v_y, rate = np.moveaxis(states, 2, 0)
    heading = pose[2] + TICK_S * np.cumsum(rate, axis=1)
    x = pose[0] + TICK_S * np.cumsum(v_x * np.cos(heading) - v_y * np.sin(heading), axis=1)
    y = pose[1] + TICK_S * np.cumsum(v_x * np.sin(heading) + v_y * np.cos(heading), axis=1)
    wanted_y, wanted_heading = path(x)
    error = ((y - wanted_y) / 0.1) ** 2 + ((heading - wanted_heading) / 0.1) ** 2
    error += (v_x - speed) ** 2
    change = (np.diff(commands, axis=1) / np.array([500.0, 0.02])) ** 2
    return np.asarray(error.mean(axis=1) + change.sum(axis=2).mean(axis=1))


class Controller:
    """Samples candidates about its plan and averages them by exp(-cost / temperature)."""

    def __init__(self, speed: float, in_force: np.ndarray) -> None:
        self.speed, self.plan = speed, np.repeat(in_force[None], STEPS, axis=0)
        self.rng = np.random.default_rng(0)

    def decide(self, predictor, pose: np.ndarray, in_force: np.ndarray) -> np.ndarray:
        """Return the next command (2,); the one in force is no longer a choice."""
        plan = np.vstack([self.plan[1:], self.plan[-1:]])
        nodes = SPREAD * self.rng.normal(size=(CANDIDATES, NODES, 2))
        nodes[0] = 0.0  # The plan itself.
        at, known = np.linspace(0.0, NODES - 1.0, STEPS), np.arange(NODES)
        left = np.minimum(at.astype(int), NODES - 2)
        share = (at - known[left])[None, :, None]
        noise = (1.0 - share) * nodes[:, left] + share * nodes[:, left + 1]
        candidates = np.clip(plan + noise, -LIMITS, LIMITS)
        candidates[:, 0] = in_force
        costs = cost(predictor.roll_out_many(candidates), candidates, pose, self.speed)
        weights = np.exp(-(costs - costs.min()) / TEMPERATURE)
        self.plan = np.einsum("k,khc->hc", weights / weights.sum(), candidates)
        return np.array(self.plan[1])


def main() -> None:
    """Adapt, close the loop, print errors and times, draw the path."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument("--out", type=Path, default=Path("example_out"), help="output folder")
    parser.add_argument("--model", type=Path, help="model folder [default: train one]")
    parser.add_argument("--steps", type=int, default=500, help="training steps")
    parser.add_argument("--duration", type=float, default=20.0, help="s to drive")
    arguments = parser.parse_args()
    if arguments.model is not None:
        model = adk_ros.load_model(arguments.model)
    else:
        model = adk_ros.train_model(
            BAGS / "handling", out=arguments.out / "model", steps=arguments.steps, force=True
        )
    recording = adk_ros.read_recording(BAGS / "town")
    predictor = adk_ros.adapted_predictor(recording, model, until_s=ADAPT_S)
    last = int((recording.time_s <= ADAPT_S).sum()) - 1
    velocity, in_force = recording.record.x[last], recording.record.u[last].copy()
    stamp_ns = int(recording.record.stamp_ns[last])

    vehicle = load_vehicle("imdv")
    constants = vehicle.model_copy(update={"mass": vehicle.mass + 160.0}).constants()
    car = rolling_state(constants, float(velocity[0]))
    car[: YAW_RATE + 1] = velocity
    road = np.array([0.85, 0.0, 0.0, 0.0, 0.0])  # Friction; no grade, bank or wind.
    rng = np.random.default_rng(1)
    controller = Controller(float(velocity[0]), in_force)
    driven, times_s = [], []
    for _ in range(round(arguments.duration / TICK_S)):
        began_s = time.perf_counter()
        pose = car[X : Y + 2].copy()
        command = controller.decide(predictor, pose, in_force)
        times_s.append(time.perf_counter() - began_s)
        driven.append([*pose, car[V_X]])
        states, forces = np.empty((2, STATE_SIZE)), np.empty((2, 2))
        advance(constants, car, in_force[None], road, STEP, 25, states, forces)
        # The decision acts from the next sample on, which reports it.
        in_force, stamp_ns = command, stamp_ns + TICK_NS
        x = tuple((car[: YAW_RATE + 1] + NOISE * rng.normal(size=3)).tolist())
        predictor.step(Sample(stamp_ns, x, tuple(in_force.tolist()), tuple(forces[1].tolist()), 0))

    rows = np.array(driven)
    wanted, heading = path(rows[:, 0])
    error = (rows[:, 1] - wanted) * np.cos(heading)
    print(
        f"{rows[-1, 0]:.0f} m at {rows[:, 3].mean():.1f} m/s: lateral error "
        f"RMS {np.sqrt(np.mean(error**2)):.3f} m, largest {np.abs(error).max():.3f} m; "
        f"a decision takes {1e3 * np.median(times_s):.1f} ms"
    )
    arguments.out.mkdir(parents=True, exist_ok=True)
    figure, (above, below) = plt.subplots(2, 1, sharex=True, layout="constrained")
    above.plot(rows[:, 0], wanted, "k:", label="path")
    above.plot(rows[:, 0], rows[:, 1], label="driven")
    above.set_ylabel("y, m")
    above.legend()
    below.plot(rows[:, 0], error)
    below.set_ylabel("lateral error, m")
    below.set_xlabel("x, m")
    figure.savefig(arguments.out / "followed_path.png")
    print(f"figure in {arguments.out}")


if __name__ == "__main__":
    main()
