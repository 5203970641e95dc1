# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Start the predictor on a car's own topics.

    ros2 launch adk_ros predictor.launch.py model:=/path/to/model \
        imu:=/imu/data odometry:=/odom command:=/vehicle/command
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterFile, ParameterValue
from launch_ros.substitutions import FindPackageShare


def generate_launch_description() -> LaunchDescription:
    """Return the arguments and the one node that they configure."""
    default_params = PathJoinSubstitution(
        [FindPackageShare("adk_ros"), "config", "predictor.yaml"]
    )
    arguments = [
        DeclareLaunchArgument("model", description="Model folder that `adk train` wrote."),
        DeclareLaunchArgument(
            "imu",
            default_value="imu",
            description="Topic of sensor_msgs/Imu; the node works without one and says so.",
        ),
        DeclareLaunchArgument(
            "odometry", default_value="odometry", description="Topic of nav_msgs/Odometry."
        ),
        DeclareLaunchArgument(
            "command",
            default_value="command",
            description="Topic of the vehicle's commands, of the type that `command_type` names.",
        ),
        DeclareLaunchArgument(
            "steering",
            default_value="steering",
            description="Topic of the measured steering angle, where `command_type` has one.",
        ),
        DeclareLaunchArgument(
            "params_file",
            default_value=default_params,
            description="YAML file of the node's parameters.",
        ),
        DeclareLaunchArgument(
            "use_sim_time",
            default_value="false",
            description="Follow /clock, as with `ros2 bag play --clock`.",
        ),
        DeclareLaunchArgument(
            "namespace", default_value="", description="Namespace of the node and its topics."
        ),
        DeclareLaunchArgument(
            "log_level",
            default_value="info",
            description="debug, info, warn, error or fatal; NAME:=LEVEL for a single logger.",
        ),
    ]
    node = Node(
        package="adk_ros",
        executable="predictor",
        name="predictor",
        namespace=LaunchConfiguration("namespace"),
        # The later entry wins: what is said on the command line overrides the file.
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
            for name in ("imu", "odometry", "command", "steering")
        ],
        ros_arguments=["--log-level", LaunchConfiguration("log_level")],
        output="screen",
    )
    return LaunchDescription([*arguments, node])
