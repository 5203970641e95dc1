# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Installs the package, under colcon as well as under pip.

`ros2 run adk_ros <verb>` looks for executables in `lib/adk_ros`, which setup.cfg names for the
`setup.py install` and `setup.py develop` that colcon runs. pip builds a wheel instead and puts
scripts on the PATH; it installs only `adk`, because scripts called `echo` or `info` would shadow
other programs.
"""

import sys
from glob import glob
from pathlib import Path

from setuptools import find_packages, setup

NAME = "adk_ros"
VERBS = (
    "train", "replay", "play", "echo", "rollout", "demo", "info", "simulate", "mismatch",
    "detectable", "fleet", "bench", "compile", "watch", "import", "export", "check",
)  # fmt: skip

console_scripts = ["adk = adk_ros.cli.main:main", "predictor = adk_ros.ros.node:main"]
if {"install", "develop"} & set(sys.argv[1:]):
    console_scripts += [f"{verb} = adk_ros.cli.main:{verb}_main" for verb in VERBS]


def below_share(*patterns: str) -> list[tuple[str, list[str]]]:
    """Return the files matching `patterns`, with their folders below share/adk_ros."""
    found: dict[str, list[str]] = {}
    for pattern in patterns:
        for path in sorted(glob(pattern)):
            if Path(path).is_file():
                folder = (Path("share") / NAME / path).parent.as_posix()
                found.setdefault(folder, []).append(path)
    return sorted(found.items())


setup(
    name=NAME,
    version="0.1.0",
    description=(
        "Predicts a car's longitudinal velocity, lateral velocity and yaw rate, live at 40 Hz,"
        " with an adaptive deep Koopman model that is trained from rosbags."
        " Identifies the physics that a simulation lacks compared with a recording."
    ),
    author="The adk_ros authors",
    author_email="adk-ros@users.noreply.github.com",
    maintainer="The adk_ros authors",
    maintainer_email="adk-ros@users.noreply.github.com",
    license="Apache-2.0",
    python_requires=">=3.10",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed", "**/*.yaml", "**/*.j2", "**/*.html", "**/*.json"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        *below_share("package.xml", "launch/*.launch.py", "config/*", "bags/*", "bags/*/*"),
    ],
    install_requires=[
        "backports.zstd>=1.0; python_version < '3.14'",
        "jinja2>=3.1",
        "lz4>=4.0",
        "matplotlib>=3.8",
        "numba>=0.59",
        "numpy>=1.26",
        "pandas>=2.1",
        "psutil>=5.9",
        "pydantic>=2.5",
        "pyyaml>=6.0",
        "rich>=13.7",
        "rosbags>=0.11.9",
        "ruamel.yaml>=0.17",
        "scipy>=1.11",
        "torch>=2.13",
        "typer>=0.15",
    ],
    extras_require={
        # ROS itself, for machines without ROS packages.
        "ros": ["ros-jazzy-rclpy[fastrtps]>=7.1", "ros-jazzy-common-interfaces>=5.3"],
        # Parquet, MDF, CAN logs and units of `adk import` and `adk export`.
        "import": [
            "asammdf>=8.0",
            "cantools>=39.4",
            "fastparquet>=2024.11",
            "pint>=0.24",
            "python-can>=4.4",
        ],
        # Engine, storage and the page of the engine of `adk fleet`.
        "fleet": [
            "bokeh>=3.1",
            "cryptography>=41",
            "distributed>=2024.5",
            "pyarrow>=15",
            "s3fs>=2024.5",
        ],
        "tensorboard": ["tensorboard>=2.12"],
        "signature": ["cryptography>=41"],
        # What `adk bench` compares with: `latency` and `fleet --part throughput`.
        "bench": ["joblib>=1.3", "padasip>=1.2"],
        # The linear MPC of `adk bench control`, which is left out without it.
        "control": ["osqp>=1.0"],
        "test": [
            "colcon-common-extensions",
            "cryptography",
            "hypothesis",
            "mypy",
            "padasip",
            "pytest",
            "pytest-timeout",
            "pytest-xdist",
            "ruff",
            "tensorboard",
        ],
    },
    entry_points={"console_scripts": console_scripts},
    zip_safe=False,
)
