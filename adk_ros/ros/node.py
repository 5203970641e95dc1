# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The executable `predictor`: starts the node, spins it, ends it on a signal.

Exit code 0 after SIGINT or SIGTERM; 2 if a parameter or the model is refused, with a one-line
reason on standard error. Heavy imports follow the signal handlers, so that a signal during
start-up also ends the process cleanly.
"""

from __future__ import annotations

import signal
import sys
from types import FrameType

from adk_ros.errors import AdkError, UsageError

_SPIN_S = 0.1
"""s after which the spin loop checks for a signal: below the 1 s that a stop may take."""
_USAGE = """\
usage: predictor --ros-args -p model:=FOLDER [-p NAME:=VALUE ...] [-r imu:=/TOPIC ...]

Predicts v_x, v_y and yaw rate from the topics imu, odometry and command. Publishes
~/predicted_twist, ~/predicted_horizon and /diagnostics; provides the service ~/reset.
Example: predictor --ros-args -p model:=model -r imu:=/imu/data -r command:=/vehicle/command

Parameters and their defaults:"""


class Stop:
    """
    Records that SIGINT or SIGTERM came; a second signal has no effect.

    While `starting`, the first signal raises SystemExit(0), since no loop checks for it yet.
    """

    def __init__(self) -> None:
        self.requested = False
        self.starting = True
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._on_signal)

    def _on_signal(self, _number: int, _frame: FrameType | None) -> None:
        repeated, self.requested = self.requested, True
        if self.starting and not repeated:
            raise SystemExit(0)


def main(argv: list[str] | None = None) -> int:
    """Run the node until a signal; return the exit code."""
    stop = Stop()
    try:
        return _run(sys.argv if argv is None else argv, stop)
    except AdkError as error:
        print(f"predictor: {error}", file=sys.stderr)
        return error.exit_code
    except SystemExit:
        return 0


def _run(argv: list[str], stop: Stop) -> int:
    import rclpy
    from rclpy.signals import SignalHandlerOptions
    from rclpy.utilities import remove_ros_args, try_shutdown

    # Any exception here is about the arguments; the classes differ between versions of rclpy.
    try:
        unknown = remove_ros_args(argv)[1:]
        # The handlers of rclpy would shut the context down during a callback.
        rclpy.init(args=argv, signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:
        raise UsageError(f"ROS refuses the arguments: {_first_line(error)}") from None
    try:
        if unknown and unknown[0] in ("-h", "--help"):
            from adk_ros.ros.parameter_table import help_text

            print(f"{_USAGE}\n{help_text()}")
            return 0
        if unknown:
            raise UsageError(
                f"argument '{unknown[0]}' is not understood: give parameters as "
                "--ros-args -p NAME:=VALUE, topics as -r imu:=/TOPIC"
            )
        _spin(stop)
    finally:
        stop.starting = False
        try_shutdown()
    return 0


def _spin(stop: Stop) -> None:
    from rclpy.exceptions import NameValidationException, ParameterException
    from rclpy.utilities import ok

    from adk_ros.ros.predictor_node import PredictorNode, freeze_garbage_collector
    from adk_ros.ros.session import make_executor

    executor = make_executor()
    try:
        predictor = PredictorNode()
    except (NameValidationException, ParameterException) as error:
        raise UsageError(f"ROS refuses the arguments: {_first_line(error)}") from None
    executor.add_node(predictor.node)
    freeze_garbage_collector()
    stop.starting = False
    try:
        # spin() of the events executor does not return on a signal; spin_once with a timeout does.
        while ok() and not stop.requested:
            executor.spin_once(_SPIN_S)
    finally:
        executor.remove_node(predictor.node)
        predictor.node.destroy_node()
        executor.shutdown()


def _first_line(error: Exception) -> str:
    return (str(error).strip() or type(error).__name__).splitlines()[0]


if __name__ == "__main__":
    sys.exit(main())
