# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A planner feeds its plan to the live node: how much better is the horizon with it?

The node runs on bags/town, played in real time for a minute. The planner here knows the commands
that the recording holds; in the first half it keeps them to itself. Takes two minutes with the
model of the first example (`--model example_out/model`), four without. Needs ROS 2 (`make install`
brings it).
"""

import argparse
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import rclpy
from builtin_interfaces.msg import Duration
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint, MultiDOFJointTrajectory

import adk_ros

BAGS = Path(__file__).resolve().parents[1] / "bags"
STEP_NS, STEPS = 25_000_000, 80
AHEAD = 40
"""Steps, 1 s, at which the horizon is compared with what happened."""


def nanoseconds(stamp) -> int:
    """Return a time stamp as an integer."""
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


class Planner(Node):
    """Publishes the commands of a recording ahead of time; collects horizons and odometry."""

    def __init__(self, recording: adk_ros.BagRecording) -> None:
        super().__init__("planner")
        self.record = recording.record
        self.plans = self.create_publisher(JointTrajectory, "planned_command", 1)
        self.states: dict[int, tuple[float, float, float]] = {}
        self.predicted: dict[int, tuple[float, float, float]] = {}
        self.followed: dict[int, bool] = {}
        self.create_subscription(Odometry, "odometry", self.on_odometry, qos_profile_sensor_data)
        self.create_subscription(
            MultiDOFJointTrajectory, "/predictor/predicted_horizon", self.on_horizon, 10
        )
        self.create_subscription(
            JointState, "/predictor/predicted_horizon_plan", self.on_label, 10
        )
        self.begin_ns = int(self.record.stamp_ns[0])
        self.planning_from_ns = self.begin_ns + 30 * 1_000_000_000

    def on_odometry(self, message: Odometry) -> None:
        """Keep the state, and publish a plan every fifth time: 10 Hz."""
        now_ns = nanoseconds(message.header.stamp)
        twist = message.twist.twist
        self.states[now_ns] = (twist.linear.x, twist.linear.y, twist.angular.z)
        if now_ns > self.planning_from_ns and len(self.states) % 5 == 0:
            self.plans.publish(self.plan(now_ns))

    def plan(self, now_ns: int) -> JointTrajectory:
        """Return the commands of the next two seconds, for the joints of the command message."""
        made = JointTrajectory(joint_names=["drive", "steer"])
        made.header.stamp.sec, made.header.stamp.nanosec = divmod(now_ns, 1_000_000_000)
        row = int(np.searchsorted(self.record.stamp_ns, now_ns))
        for i in range(row, min(row + STEPS + 8, len(self.record))):
            torque, angle = self.record.u[i].tolist()
            after = divmod(int(self.record.stamp_ns[i]) - now_ns, 1_000_000_000)
            made.points.append(
                JointTrajectoryPoint(
                    effort=[torque, 0.0],
                    positions=[0.0, angle],
                    time_from_start=Duration(sec=after[0], nanosec=after[1]),
                )
            )
        return made

    def on_horizon(self, message: MultiDOFJointTrajectory) -> None:
        """Keep the state that is predicted one second ahead."""
        twist = message.points[AHEAD - 1].velocities[0]
        ahead_ns = nanoseconds(message.header.stamp) + AHEAD * STEP_NS
        self.predicted[ahead_ns] = (twist.linear.x, twist.linear.y, twist.angular.z)

    def on_label(self, message: JointState) -> None:
        """Keep whether the horizon follows the plan for a second."""
        ahead_ns = nanoseconds(message.header.stamp) + AHEAD * STEP_NS
        self.followed[ahead_ns] = min(message.position) >= AHEAD * STEP_NS * 1e-9

    def errors(self, *, planned: bool) -> np.ndarray:
        """Return predicted minus measured states (n, 3), with or without a plan."""
        times = np.array(sorted(self.states))
        measured = np.array([self.states[t] for t in times])
        chosen = [
            t for t in sorted(self.predicted)
            if self.followed.get(t, False) is planned and times[0] + 5e9 < t < times[-1]
        ]  # fmt: skip
        known = np.column_stack([np.interp(chosen, times, column) for column in measured.T])
        return np.asarray(np.array([self.predicted[t] for t in chosen]) - known)


def main() -> None:
    """Run node, player and planner; print the errors one second ahead."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument("--out", type=Path, default=Path("example_out"), help="output folder")
    parser.add_argument("--model", type=Path, help="model folder [default: train one]")
    parser.add_argument("--steps", type=int, default=1000, help="training steps")
    arguments = parser.parse_args()
    model = arguments.model
    if model is None:
        model = arguments.out / "model"
        adk_ros.train_model(BAGS / "handling", out=model, steps=arguments.steps, force=True)

    # Other robots on the network are left alone.
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
    node = [sys.executable, "-m", "adk_ros.ros.node", "--ros-args", "-p", f"model:={model}"]
    adk = "import sys; from adk_ros.cli.main import main; sys.exit(main(sys.argv[1:]))"
    player = [
        sys.executable, "-c", adk, "play", str(BAGS / "town"), "--duration", "60",
        "--remap", "/imu/data:=imu", "--remap", "/odometry:=odometry",
        "--remap", "/vehicle/command:=command",
    ]  # fmt: skip
    rclpy.init()
    planner = Planner(adk_ros.read_recording(BAGS / "town"))
    processes = [subprocess.Popen(node)]
    try:
        while not planner.count_publishers("/predictor/predicted_horizon"):
            if processes[0].poll() is not None:
                sys.exit("the node has stopped")
            rclpy.spin_once(planner, timeout_sec=0.1)
        processes.append(subprocess.Popen(player))
        while processes[1].poll() is None:
            rclpy.spin_once(planner, timeout_sec=0.1)
    finally:
        for process in processes:
            process.terminate()
            process.wait()
    for name, planned in (("commands held", False), ("under the plan", True)):
        rms = np.sqrt(np.mean(planner.errors(planned=planned) ** 2, axis=0))
        print(
            f"RMS error 1 s ahead, {name}: v_x {rms[0]:.3f} m/s, v_y {rms[1]:.3f} m/s, "
            f"yaw rate {np.degrees(rms[2]):.2f} deg/s"
        )
    planner.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
