# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Start the predictor node with the topics of a vehicle.

    ros2 launch adk_ros predictor.launch.py model:=/path/to/model \
        imu:=/imu/data odometry:=/odom command:=/vehicle/command
"""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.events.process import ProcessExited
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterFile, ParameterValue
from launch_ros.substitutions import FindPackageShare


def check_exit(event: ProcessExited, _context: LaunchContext) -> None:
    """
    End the launch with exit code 1 if the node failed; without this `ros2 launch` returns 0.

    :raises RuntimeError: the node's exit code is not 0.
    """
    if event.returncode != 0:
        raise RuntimeError(f"predictor ended with exit code {event.returncode}, see its output")


def generate_launch_description() -> LaunchDescription:
    """Return the launch arguments and the predictor node."""
    default_params = PathJoinSubstitution(
        [FindPackageShare("adk_ros"), "config", "predictor.yaml"]
    )
    arguments = [
        DeclareLaunchArgument("model", description="Model folder written by `adk train`."),
        DeclareLaunchArgument(
            "imu",
            default_value="imu",
            description="Topic of sensor_msgs/Imu; optional.",
        ),
        DeclareLaunchArgument(
            "odometry", default_value="odometry", description="Topic of nav_msgs/Odometry."
        ),
        DeclareLaunchArgument(
            "command",
            default_value="command",
            description="Topic of the vehicle commands; message type by parameter `command_type`.",
        ),
        DeclareLaunchArgument(
            "steering",
            default_value="steering",
            description="Topic of the measured road-wheel angle; used with autoware_control only.",
        ),
        DeclareLaunchArgument(
            "planned_command",
            default_value="planned_command",
            description="Topic of planned commands, which the horizon follows; optional.",
        ),
        DeclareLaunchArgument(
            "params_file",
            default_value=default_params,
            description="YAML file with the node's parameters.",
        ),
        DeclareLaunchArgument(
            "use_sim_time",
            default_value="false",
            description="Use simulation time from /clock, e.g. of `ros2 bag play --clock`.",
        ),
        DeclareLaunchArgument(
            "namespace", default_value="", description="Namespace of the node and its topics."
        ),
        DeclareLaunchArgument(
            "log_level",
            default_value="info",
            description="debug, info, warn, error or fatal; NAME:=LEVEL for one logger.",
        ),
    ]
    node = Node(
        package="adk_ros",
        executable="predictor",
        name="predictor",
        namespace=LaunchConfiguration("namespace"),
        # Later entries override earlier ones: launch arguments override the file.
        parameters=[
            ParameterFile(LaunchConfiguration("params_file")),
            {
                "model": ParameterValue(LaunchConfiguration("model"), value_type=str),
                "use_sim_time": ParameterValue(
                    LaunchConfiguration("use_sim_time"), value_type=bool
                ),
            },
        ],
        remappings=[
            (name, LaunchConfiguration(name))
            for name in ("imu", "odometry", "command", "steering", "planned_command")
        ],
        ros_arguments=["--log-level", LaunchConfiguration("log_level")],
        output="screen",
        on_exit=check_exit,
    )
    return LaunchDescription([*arguments, node])
