# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The single-track model of `adk_ros.model.lifting.single_track` for PyTorch and TorchScript.

The operators are those that an encoder of a model folder may use, see `program_grammar`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from adk_ros.model.lifting.single_track import (
    BLEND,
    COMMAND,
    FORCE_SCALE,
    GAIN,
    MEAN,
    MIN_GRIP,
    SCALE,
    single_track_batch,
)
from adk_ros.numerics.constants import GRAVITY
from adk_ros.signals.score import TICK_S


class _Slope(nn.Module):
    """The equations of motion; a module, since a program calls nothing else."""

    __constants__ = ("gravity", "min_grip")

    def __init__(self) -> None:
        super().__init__()
        self.gravity, self.min_grip = GRAVITY, MIN_GRIP

    def forward(self, state: Tensor, command: Tensor, car: Tensor) -> Tensor:
        """Return derivatives, forces and drive (b, 6) at states (b, 3) and commands (b, 2), SI."""
        v_x, v_y, rate = state[:, 0:1], state[:, 1:2], state[:, 2:3]
        torque, delta = command[:, 0:1], command[:, 1:2]
        speed = torch.maximum(torch.abs(v_x), car[11:12])
        front = (v_x * delta - v_y - car[0:1] * rate) / speed
        rear = (car[1:2] * rate - v_y) / speed
        drive = car[7:8] * torque
        a_x = drive - car[8:9] * v_x / speed - car[9:10] * v_x * torch.abs(v_x)
        length = car[0:1] + car[1:2]
        of_front, of_rear = drive / (car[4:5] * self.gravity), drive / (car[5:6] * self.gravity)
        grip_front = torch.sqrt(torch.clamp(1.0 - of_front * of_front, self.min_grip))
        grip_rear = torch.sqrt(torch.clamp(1.0 - of_rear * of_rear, self.min_grip))
        load_front = torch.clamp(self.gravity * car[1:2] / length - car[10:11] * a_x, 0.0)
        load_rear = torch.clamp(self.gravity * car[0:1] / length + car[10:11] * a_x, 0.0)
        f_front = car[4:5] * load_front * grip_front * torch.tanh(car[2:3] / car[4:5] * front)
        f_rear = car[5:6] * load_rear * grip_rear * torch.tanh(car[3:4] / car[5:6] * rear)
        s = delta * delta
        across = f_front * (1.0 - s * (0.5 - s * (1.0 / 24.0)))
        sin = delta * (1.0 - s * (1.0 / 6.0 - s * (1.0 / 120.0)))
        return torch.cat(
            [
                a_x - f_front * sin + rate * v_y,
                across + f_rear - rate * v_x,
                car[6:7] * (car[0:1] * across - car[1:2] * f_rear),
                f_front,
                f_rear,
                drive,
            ],
            dim=1,
        )


class SingleTrackModule(nn.Module):
    """`car` (24,), `command_filter` (n, 2), `limits` (3, 6): fields of `EncoderArrays`."""

    __constants__ = ("blend", "command", "force_scale", "gain", "mean", "scale", "tick")

    def __init__(self, car: Tensor, command_filter: Tensor, limits: Tensor) -> None:
        super().__init__()
        self.gain, self.mean, self.scale = GAIN, MEAN, SCALE
        self.command, self.blend = COMMAND, BLEND
        self.force_scale, self.tick = FORCE_SCALE, TICK_S
        self.car, self.limits = nn.Buffer(car), nn.Buffer(limits)
        self.command_filter = nn.Buffer(command_filter)
        self.slope = _Slope()

    def forward(self, row: Tensor) -> Tensor:
        """Return the six features and the weight of learned features, (b, 7), of rows (b, n)."""
        car, limits = self.car, self.limits
        state = row[:, 0:3] * car[self.scale : self.scale + 3]
        state = state + car[self.mean : self.mean + 3]
        command = torch.addmm(car[self.command : self.command + 2], row, self.command_filter)
        now = self.slope(state, command, car)
        half = state + 0.5 * self.tick * now[:, 0:3]
        change = self.slope(half, command, car)[:, 0:3]
        change = self.tick * change * car[self.gain : self.gain + 3]
        v_x, v_y, rate = state[:, 0:1], state[:, 1:2], state[:, 2:3]
        delta = command[:, 1:2]
        speed = torch.maximum(torch.abs(v_x), car[11:12])
        front = (v_x * delta - v_y - car[0:1] * rate) / speed
        rear = (car[1:2] * rate - v_y) / speed
        quantity = torch.cat([v_x, command, front, rear, v_x * rate], dim=1)
        outside = torch.maximum(limits[0:1] - quantity, quantity - limits[1:2])
        e = torch.clamp(outside, 0.0) * limits[2:3]
        s = e * e
        total = s[:, 0:1] + s[:, 1:2] + s[:, 2:3] + s[:, 3:4] + s[:, 4:5] + s[:, 5:6]
        weight = 1.0 / ((1.0 + total) * (1.0 + total))
        change = (1.0 - car[self.blend : self.blend + 1] * weight) * change
        return torch.cat([change, self.force_scale * now[:, 3:6], weight], dim=1)


class _Compiled(torch.autograd.Function):
    """The compiled features with their derivatives: a tenth of the time of some 100 operators."""

    @staticmethod
    def forward(ctx: Any, row: Tensor, car: Tensor, command_filter: Tensor, limits: Tensor) -> Any:
        """Return the features of input rows, as the module."""
        command = row @ command_filter
        points = torch.cat([row[:, :3], command], dim=1).double().numpy()
        slopes = np.empty((len(points), 7, 5))
        values = single_track_batch(points, car.double().numpy(), limits.double().numpy(), slopes)
        ctx.save_for_backward(torch.from_numpy(slopes).to(row.dtype), command_filter)
        return torch.from_numpy(values).to(row.dtype)

    @staticmethod
    def backward(ctx: Any, *outputs: Tensor) -> Any:
        """Return the gradient by the rows."""
        slopes, command_filter = ctx.saved_tensors
        by_point = torch.bmm(outputs[0][:, None], slopes)[:, 0]
        gradient = by_point[:, 3:] @ command_filter.t()
        gradient[:, :3] += by_point[:, :3]
        return gradient, None, None, None


def compiled_single_track(module: SingleTrackModule, row: Tensor) -> Tensor:
    """Run a module, on the CPU by the compiled kernel."""
    if row.device.type != "cpu":
        result: Tensor = module(row)
    else:
        result = _Compiled.apply(  # type: ignore[no-untyped-call]
            row, module.car, module.command_filter, module.limits
        )
    return result
