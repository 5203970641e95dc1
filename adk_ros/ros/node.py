# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The executable `predictor`: starts the node, spins it, ends it on a signal.

Exit code 0 after SIGINT or SIGTERM, 2 where a parameter or the model is refused, with the reason
in one line on the standard error. The heavy imports come after the signal handlers, so that a
signal during start-up ends it as cleanly.
"""

from __future__ import annotations

import signal
import sys
from types import FrameType

from adk_ros.errors import AdkError, UsageError

_SPIN_S = 0.1
_USAGE = """\
usage: predictor --ros-args -p model:=FOLDER [-p NAME:=VALUE ...] [-r imu:=/TOPIC ...]

Predicts v_x, v_y and yaw rate from the topics imu, odometry and command; publishes
~/predicted_twist, ~/predicted_horizon and /diagnostics, and offers the service ~/reset.
Example: predictor --ros-args -p model:=model -r imu:=/imu/data -r command:=/vehicle/command

Parameters, with their defaults:"""


class Stop:
    """
    Remembers that a signal asked for the end; a second one changes nothing.

    While `starting`, the signal raises SystemExit(0) where it strikes: no loop is there to end.
    """

    def __init__(self) -> None:
        self.requested = False
        self.starting = True
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._on_signal)

    def _on_signal(self, _number: int, _frame: FrameType | None) -> None:
        again, self.requested = self.requested, True
        if self.starting and not again:
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

    # Whatever rclpy raises here is about the arguments; its classes differ between versions.
    try:
        strange = remove_ros_args(argv)[1:]
        # Signals are ours: rclpy's handlers shut the context down under a running callback.
        rclpy.init(args=argv, signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:
        raise UsageError(f"ROS refuses the arguments: {_first_line(error)}") from None
    try:
        if strange and strange[0] in ("-h", "--help"):
            from adk_ros.ros.parameters import help_text

            print(f"{_USAGE}\n{help_text()}")
            return 0
        if strange:
            raise UsageError(
                f"argument '{strange[0]}' is not understood: parameters are given as "
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
        # spin() of the events executor does not return on a signal, spin_once with a timeout does.
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
