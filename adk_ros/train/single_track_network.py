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

from adk_ros.model.lifting.single_track import single_track_batch


class _Slope(nn.Module):
    """The equations of motion; a module, since a program calls nothing else."""

    def forward(self, state: Tensor, command: Tensor, car: Tensor) -> Tensor:
        """Return derivatives, forces and drive (b, 6) at states (b, 3) and commands (b, 2), SI."""
        v_x, v_y, rate = state[:, 0:1], state[:, 1:2], state[:, 2:3]
        torque, delta = command[:, 0:1], command[:, 1:2]
        gravity = 9.81
        speed = torch.maximum(torch.abs(v_x), car[11:12])
        front = (v_x * delta - v_y - car[0:1] * rate) / speed
        rear = (car[1:2] * rate - v_y) / speed
        drive = car[7:8] * torque
        a_x = drive - car[8:9] * v_x / speed - car[9:10] * v_x * torch.abs(v_x)
        length = car[0:1] + car[1:2]
        of_front, of_rear = drive / (car[4:5] * gravity), drive / (car[5:6] * gravity)
        left_front = torch.sqrt(torch.clamp(1.0 - of_front * of_front, 0.25))
        left_rear = torch.sqrt(torch.clamp(1.0 - of_rear * of_rear, 0.25))
        load_front = gravity * car[1:2] / length - car[10:11] * a_x
        load_rear = gravity * car[0:1] / length + car[10:11] * a_x
        f_front = car[4:5] * load_front * left_front * torch.tanh(car[2:3] / car[4:5] * front)
        f_rear = car[5:6] * load_rear * left_rear * torch.tanh(car[3:4] / car[5:6] * rear)
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

    def __init__(self, car: Tensor, command_filter: Tensor, limits: Tensor) -> None:
        super().__init__()
        self.car, self.limits = nn.Buffer(car), nn.Buffer(limits)
        self.command_filter = nn.Buffer(command_filter)
        self.slope = _Slope()

    def forward(self, row: Tensor) -> Tensor:
        """Return the six features and the weight of what is learned, (b, 7), of rows (b, n)."""
        car, limits = self.car, self.limits
        state = row[:, 0:3] * car[18:21] + car[15:18]
        command = torch.addmm(car[21:23], row, self.command_filter)
        now = self.slope(state, command, car)
        tick = 0.025
        half = state + 0.5 * tick * now[:, 0:3]
        change = tick * self.slope(half, command, car)[:, 0:3] * car[12:15]
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
        change = (1.0 - car[23:24] * weight) * change
        return torch.cat([change, 0.25 * now[:, 3:6], weight], dim=1)


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
