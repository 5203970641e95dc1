# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The node and the tools that need rclpy; only this package imports ROS messages."""
