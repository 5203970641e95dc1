# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters: the table, the sample YAML, and the refusal of values that do not fit."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter

from adk_ros.errors import UsageError
from adk_ros.model.adaptation.online_methods import OnlineSettings
from adk_ros.model.pipeline import PipelineSettings
from adk_ros.ros.parameter_file import read_parameter_file
from adk_ros.ros.parameter_settings import (
    differences_from_training,
    model_path,
    pipeline_settings,
    sensor_config,
)
from adk_ros.ros.parameter_table import TABLE, defaults
from adk_ros.ros.parameters import declare_parameters, descriptor, unknown_parameters
from adk_ros.signals.decode import SensorConfig
from adk_ros.signals.gate import GateSettings

YAML = Path(__file__).resolve().parents[2] / "config" / "predictor.yaml"

WITHOUT_ROS = """
import sys


class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in ("rclpy", "rcl_interfaces", "sensor_msgs", "std_msgs"):
            raise ImportError(f"{name} is blocked")


sys.meta_path.insert(0, Blocked())
from pathlib import Path

from adk_ros.ros.parameter_file import read_parameter_file
from adk_ros.ros.parameter_settings import sensor_config

sensors = sensor_config(read_parameter_file(Path(sys.argv[1]))[0])
print(sensors.steer_joint, sensors.steering_ratio, sensors.imu_position, "rclpy" in sys.modules)
"""


@pytest.fixture
def node_with() -> Iterator[Callable[..., Any]]:
    """Return a function that makes a node with parameters given on its command line."""
    context: Any = Context()
    context.init()
    nodes = []

    def make(*given: str, file: Path | None = None) -> Any:
        arguments = ["--ros-args"]
        if file is not None:
            arguments += ["--params-file", str(file)]
        for item in given:
            arguments += ["-p", item]
        nodes.append(Node("predictor", context=context, cli_args=arguments))
        return nodes[-1]

    yield make
    for node in nodes:
        node.destroy_node()
    context.try_shutdown()


def test_sample_yaml_has_the_default_values() -> None:
    content = yaml.safe_load(YAML.read_text())
    assert list(content) == ["/**"]
    given = content["/**"]["ros__parameters"]
    table = defaults()
    assert given == table
    for name, value in given.items():
        assert type(value) is type(table[name]), name


def test_every_parameter_is_described() -> None:
    for spec in TABLE:
        described = descriptor(spec)
        assert described.description.endswith(".")
        assert described.read_only is not spec.live
    assert [spec.name for spec in TABLE if spec.live] == ["publish_horizon"]


def test_defaults_are_those_of_the_pipeline(node_with: Callable[..., Any]) -> None:
    values = declare_parameters(node_with("model:=somewhere"))
    model_settings = OnlineSettings(window=123, ridge=5.0)
    assert pipeline_settings(values, model_settings) == PipelineSettings(online=model_settings)
    assert sensor_config(values) == SensorConfig()


def test_node_loads_the_sample_yaml(node_with: Callable[..., Any]) -> None:
    values = declare_parameters(node_with("model:=somewhere", file=YAML))
    assert values == defaults() | {"model": "somewhere"}


def test_given_values_are_used(node_with: Callable[..., Any]) -> None:
    node = node_with(
        "model:=~/m", "method:=rls", "window:=50", "ridge:=20", "horizon_s:=1", "use_imu:=never",
        "reference_point:=[1, 0]", "imu_position:=[0.5, -0.25]", "imu_rotation:=[0.0, 0.0, 3.14]",
        "drive_joints:=[left, right]", "steer_joint:=wheel", "steering_ratio:=16",
        "odometry_timeout_s:=1", "frozen_after_s:=0", "max_wait_s:=0.1", "max_coast_s:=2",
        "forgetting:=0.9", "gate_false_rejection:=0.0001", "gate_confirmations:=7",
    )  # fmt: skip
    values = declare_parameters(node)
    settings = pipeline_settings(values, OnlineSettings())
    assert settings == PipelineSettings(
        sensors=SensorConfig(
            drive_joints=("left", "right"), steer_joint="wheel", steering_ratio=16.0,
            reference_point=(1.0, 0.0), imu_position=(0.5, -0.25), imu_rotation=(0.0, 0.0, 3.14),
        ),
        online=OnlineSettings("rls", 50, 20.0, 0.9),
        horizon_steps=40, odometry_timeout_s=1.0, frozen_after_s=0.0, max_wait_s=0.1,
        max_coast_s=2.0, gate=GateSettings(1e-4, 7),
    )  # fmt: skip
    assert model_path(values) == Path.home() / "m"
    # Declared as a real parameter although 20 was given.
    assert node.get_parameter("ridge").type_ == Parameter.Type.DOUBLE
    assert node.get_parameter("ridge").value == 20.0
    assert list(node.get_parameter("reference_point").value) == [1.0, 0.0]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("ridge:=abc", "parameter 'ridge' is 'abc': give a number from 0 to 1e+12"),
        ("ridge:=-1", "parameter 'ridge' is -1: give a number from 0"),
        ("ridge:=true", "parameter 'ridge' is True: give a number"),
        ("ridge:=.nan", "parameter 'ridge' is nan: give a number"),
        ("ridge:=.inf", "parameter 'ridge' is inf: give a number"),
        ("window:=10.5", "parameter 'window' is 10.5: give a whole number from 0 to 100000"),
        ("window:=[1]", "parameter 'window' is [1]: give a whole number"),
        ("method:=best", "parameter 'method' is 'best': give one of '', 'constant', 'rls'"),
        ("method:=5", "parameter 'method' is 5: give one of"),
        ("publish_horizon:=1", "parameter 'publish_horizon' is 1: give true or false"),
        ("use_imu:=yes", "is True: give one of 'auto', 'required', 'never'"),
        (
            "drive_joints:=[]",
            "is empty: give a list of at least one name",
        ),
        (
            "drive_joints:=[1, 2]",
            "is [1, 2]: give a list of at least one name",
        ),
        ("imu_position:=[1.0]", "parameter 'imu_position' is [1.0]: give a list of 2 numbers"),
        ("imu_position:=3.0", "parameter 'imu_position' is 3.0: give a list of 2 numbers"),
        ("imu_position:=[1.0, 99.0]", "[1.0, 99.0]: give a list of 2 numbers from -50 to 50"),
        ("frame_id:=7", "parameter 'frame_id' is 7: give a string"),
        ("horizon_s:=11", "parameter 'horizon_s' is 11: give a number from 0 to 10"),
        ("command_type:=twist", "'joint_state', 'ackermann', 'autoware_control'"),
    ],
)
def test_unsuitable_values_are_refused(
    node_with: Callable[..., Any], given: str, message: str
) -> None:
    with pytest.raises(UsageError) as refused:
        declare_parameters(node_with("model:=m", given))
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)


def test_the_model_is_required(node_with: Callable[..., Any]) -> None:
    with pytest.raises(UsageError, match="parameter 'model' is not given"):
        declare_parameters(node_with())


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("steering_ratio:=0.0", "steering_ratio is 0"),
        ("command_type:=ackermann", "set mass and wheel_radius"),
        ("window:=1", "window is 1 samples"),
        ("ridge:=0.0001", "ridge is 0.0001"),
        ("forgetting:=0.1", "forgetting is 0.1"),
        (
            "odometry_type:=ground_velocity use_imu:=never",
            "odometry_type 'ground_velocity' has no yaw rate, the IMU measures it: set use_imu",
        ),
    ],
)
def test_contradictory_values_are_refused(
    node_with: Callable[..., Any], given: str, message: str
) -> None:
    values = declare_parameters(node_with("model:=m", *given.split()))
    with pytest.raises(UsageError, match=message):
        pipeline_settings(values, OnlineSettings())


def test_unknown_names_are_reported(node_with: Callable[..., Any]) -> None:
    node = node_with("model:=m", "windw:=50", "whatever:=1", "use_sim_time:=true")
    declare_parameters(node)
    assert unknown_parameters(node) == [
        "parameter 'windw' is unknown and ignored: did you mean 'window'?",
        "parameter 'whatever' is unknown and ignored",
    ]


def test_only_live_parameters_can_be_changed(node_with: Callable[..., Any]) -> None:
    node = node_with("model:=m")
    declare_parameters(node)
    fixed, live = node.set_parameters(
        [Parameter("window", value=10), Parameter("publish_horizon", value=False)]
    )
    assert not fixed.successful
    assert live.successful
    assert node.get_parameter("publish_horizon").value is False


def test_parameter_file_is_read_without_ros(tmp_path: Path) -> None:
    """`--params` of the offline verbs works where rclpy is not installed."""
    file = tmp_path / "car.yaml"
    file.write_text(
        "/**:\n  ros__parameters:\n    steer_joint: column\n    steering_ratio: 16\n"
        "    imu_position: [1, 0.5]\n    use_sim_time: true\n    windw: 50\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_ROS, str(file)],
        capture_output=True, text=True, timeout=120.0, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.split("\n")[0] == "column 16.0 (1.0, 0.5) False"
    (warning,) = read_parameter_file(file)[1]
    assert warning == (f"{file}: parameter 'windw' is unknown and ignored: did you mean 'window'?")


@pytest.mark.parametrize(
    ("content", "mass"),
    [
        (
            "predictor: {ros__parameters: {mass: 1500}}\nother: {ros__parameters: {mass: 1}}",
            1500.0,
        ),
        ("car1: {predictor: {ros__parameters: {mass: 1400}}}", 1400.0),
        ("/**: {ros__parameters: {mass: 1300}}\nother: {ros__parameters: {mass: 1}}", 1300.0),
        ("/**: {ros__parameters: {mass: 1}}\npredictor: {ros__parameters: {mass: 1200}}", 1200.0),
        ("my_node: {ros__parameters: {mass: 1100}}", 1100.0),
        (
            "predictor: {ros__parameters: {mass: 900}}\n"
            "trajectory_predictor: {ros__parameters: {mass: 1}}",
            900.0,
        ),
        (
            "/predictor: {ros__parameters: {mass: 1}}\npredictor: {ros__parameters: {mass: 800}}",
            800.0,
        ),
    ],
)
def test_parameters_are_those_of_the_predictor(tmp_path: Path, content: str, mass: float) -> None:
    file = tmp_path / "car.yaml"
    file.write_text(content)
    values, warnings = read_parameter_file(file)
    assert values["mass"] == mass
    assert len(warnings) == ("other" in content or "trajectory" in content)
    assert all("parameters of other nodes are not used" in text for text in warnings)


def test_parameters_of_several_nodes_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "car.yaml"
    block = "{ros__parameters: {mass: 1500}}"
    file.write_text(f"car1/predictor: {block}\ncar2/predictor: {block}")
    with pytest.raises(UsageError, match=r"several nodes \(car1/predictor, car2/predictor\)"):
        read_parameter_file(file)


def test_a_parameter_file_that_refers_to_itself_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "car.yaml"
    file.write_text("a: &a {b: *a}\n")
    with pytest.raises(UsageError, match="refers to itself"):
        read_parameter_file(file)


@pytest.mark.parametrize("content", [b"\xff\xfe", b"a: [", b"[" * 5000, b"a: 2001-99-99"])
def test_damaged_parameter_file_is_refused_in_one_line(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "car.yaml"
    file.write_bytes(content)
    with pytest.raises(UsageError, match=r"car\.yaml is not YAML") as refused:
        read_parameter_file(file)
    assert str(refused.value).isprintable()


def test_differences_from_training_are_reported() -> None:
    trained = {"sensors": {"steer_joint": "steer", "imu_position": [0.5, 0.0]}}
    lines = differences_from_training(SensorConfig(imu_position=(1.0, 0.0)), trained)
    assert lines == [
        "parameter 'imu_position' is [1.0, 0.0], but the model was trained with [0.5, 0.0]"
    ]
    assert differences_from_training(SensorConfig(), {}) == []
