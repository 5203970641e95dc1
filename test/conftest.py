# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What every test runs under, set before anything reads it.

The children that tests start inherit all of it.
"""

import os
import tempfile

from hypothesis import settings

# Two cores at most are to be expected, and results must not depend on how sums are split.
for variable in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[variable] = "1"

os.environ["MPLBACKEND"] = "Agg"

# A domain for each run and each of its workers, this machine only: neither another run nor a robot
# answers. Domains above 101 meet the ports that Linux hands out.
worker = os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw")
run = os.getppid() if "PYTEST_XDIST_WORKER" in os.environ else os.getpid()
os.environ["ROS_DOMAIN_ID"] = str(1 + (4 * run + int(worker)) % 100)
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ.pop("ROS_STATIC_PEERS", None)
# rclpy.init refuses to start without a place for its log.
os.environ.setdefault("HOME", tempfile.gettempdir())
os.environ.setdefault("ROS_LOG_DIR", tempfile.mkdtemp(prefix="adk_ros_log_"))

# The same examples each time: a failure that comes and goes says nothing about a change.
settings.register_profile("adk_ros", derandomize=True, deadline=None, database=None)
settings.load_profile("adk_ros")
