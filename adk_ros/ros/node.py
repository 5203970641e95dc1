# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The executable `predictor`: starts the node, spins it, ends it on a signal.

Exit code 0 after SIGINT or SIGTERM; 2 if a parameter or the model is refused, with a one-line
reason on standard error.

A Python signal handler runs between two bytecodes of the main thread, which the compiler of the
kernels may keep busy for seconds, and what it raises can be lost in a callback from C. So signals
are blocked, and a thread waits for them. It needs Python's lock, so nothing that holds it may wait
for a reader of the output.
"""

from __future__ import annotations

import math
import os
import signal
import sys
import threading
import time

from adk_ros.errors import AdkError, UsageError, first_line
from adk_ros.ros.unread_output import STDERR, STDOUT, discard_unread_output

_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_SPIN_S = 0.1
"""s after which the loops check for a signal or its consequence: far below `GRACE_S`."""
GRACE_S = 1.5
"""s that the end may take after a signal: launch files and service managers expect two."""
_USAGE = """\
usage: predictor --ros-args -p model:=FOLDER [-p NAME:=VALUE ...] [-r imu:=/TOPIC ...]

Predicts v_x, v_y and yaw rate from the topics imu, odometry and command. Publishes
~/predicted_twist, ~/predicted_horizon and /diagnostics; services ~/reset and ~/enable.
Example: predictor --ros-args -p model:=model -r imu:=/imu/data -r command:=/vehicle/command

Parameters and their defaults:"""


class Stop:
    """
    Waits for SIGINT and SIGTERM from construction to `close`; more of them have no effect.

    While `starting`, a signal ends the process at once, since no loop checks for it yet; nothing
    is half-written then. Later it sets `requested`, and the process has `GRACE_S` to end.
    """

    def __init__(self) -> None:
        self.requested = False
        self.starting = True
        self._closed = False
        self._ends_s = math.inf
        # Threads of libraries that run already are not masked: a signal may end in one of them.
        is_main = threading.current_thread() is threading.main_thread()
        self._handlers = {
            number: signal.signal(number, lambda _number, _frame: self._request())
            for number in (_SIGNALS if is_main else ())
        }
        # Threads that are started from now on inherit the mask.
        self._mask = signal.pthread_sigmask(signal.SIG_BLOCK, _SIGNALS)
        threading.Thread(target=self._wait, name="signals", daemon=True).start()

    def close(self) -> None:
        """Let signals have their usual effect again."""
        self._closed = True
        for number, handler in self._handlers.items():
            signal.signal(number, handler or signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_SETMASK, self._mask)

    def _request(self) -> None:
        if self.starting:
            os._exit(0)
        self.requested = True
        self._ends_s = min(self._ends_s, time.monotonic() + GRACE_S)

    def _wait(self) -> None:
        while not self._closed:
            if signal.sigtimedwait(_SIGNALS, _SPIN_S) is not None:
                self._request()
            if time.monotonic() > self._ends_s:
                os._exit(0)


def main(argv: list[str] | None = None) -> int:
    """Run the node until a signal; return the exit code."""
    stop = Stop()
    discard_unread_output(STDERR)
    try:
        return _run(sys.argv if argv is None else argv, stop)
    except AdkError as error:
        print(f"predictor: {error}", file=sys.stderr)
        return error.exit_code
    except BrokenPipeError:
        # The reader of `predictor --help | head` has seen enough.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    finally:
        stop.close()


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
        raise UsageError(f"ROS refuses the arguments: {first_line(error)}") from None
    try:
        if unknown and unknown[0] in ("-h", "--help"):
            from adk_ros.ros.parameter_table import help_text

            print(f"{_USAGE}\n{help_text()}", flush=True)
            return 0
        if unknown:
            raise UsageError(
                f"argument '{unknown[0]}' is not understood: give parameters as "
                "--ros-args -p NAME:=VALUE, topics as -r imu:=/TOPIC"
            )
        discard_unread_output(STDOUT)
        _spin(stop)
    finally:
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
        raise UsageError(f"ROS refuses the arguments: {first_line(error)}") from None
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


if __name__ == "__main__":
    sys.exit(main())
