# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters: the table, the sample YAML, and what is said to a value that does not fit."""

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
from adk_ros.ros import parameters
from adk_ros.signals.decode import SensorConfig

YAML = Path(__file__).resolve().parents[2] / "config" / "predictor.yaml"

Read = Callable[..., Any]


@pytest.fixture
def node_with() -> Iterator[Callable[..., Any]]:
    """Make a node that was given parameters on its command line."""
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


def test_yaml_holds_the_defaults() -> None:
    content = yaml.safe_load(YAML.read_text())
    assert list(content) == ["/**"]
    given = content["/**"]["ros__parameters"]
    table = {spec.name: spec.default for spec in parameters.TABLE}
    assert given == table
    for name, value in given.items():
        assert type(value) is type(table[name]), name


def test_every_parameter_is_described() -> None:
    for spec in parameters.TABLE:
        described = spec.descriptor()
        assert described.description.endswith(".")
        assert described.read_only is not spec.live
    assert [spec.name for spec in parameters.TABLE if spec.live] == ["publish_horizon"]


def test_defaults_are_those_of_the_pipeline(node_with: Callable[..., Any]) -> None:
    values = parameters.read(node_with("model:=somewhere"))
    own = OnlineSettings(window=123, ridge=5.0)
    assert parameters.pipeline_settings(values, own) == PipelineSettings(online=own)
    assert parameters.sensor_config(values) == SensorConfig()


def test_the_yaml_loads(node_with: Callable[..., Any]) -> None:
    values = parameters.read(node_with("model:=somewhere", file=YAML))
    table = {spec.name: spec.default for spec in parameters.TABLE}
    assert values == table | {"model": "somewhere"}


def test_values_arrive(node_with: Callable[..., Any]) -> None:
    node = node_with(
        "model:=~/m", "method:=rls", "window:=50", "ridge:=20", "horizon_s:=1", "use_imu:=never",
        "reference_point:=[1, 0]", "imu_position:=[0.5, -0.25]", "imu_rotation:=[0.0, 0.0, 3.14]",
        "drive_joints:=[left, right]", "steer_joint:=wheel", "steering_ratio:=16",
        "odometry_timeout_s:=1", "frozen_after_s:=0", "max_wait_s:=0.1", "max_coast_s:=2",
        "forgetting:=0.9",
    )  # fmt: skip
    values = parameters.read(node)
    settings = parameters.pipeline_settings(values, OnlineSettings())
    assert settings == PipelineSettings(
        sensors=SensorConfig(
            drive_joints=("left", "right"), steer_joint="wheel", steering_ratio=16.0,
            reference_point=(1.0, 0.0), imu_position=(0.5, -0.25), imu_rotation=(0.0, 0.0, 3.14),
        ),
        online=OnlineSettings("rls", 50, 20.0, 0.9),
        horizon_steps=40, odometry_timeout_s=1.0, frozen_after_s=0.0, max_wait_s=0.1,
        max_coast_s=2.0,
    )  # fmt: skip
    assert parameters.model_path(values) == Path.home() / "m"
    # Declared as what they are, though 20 was given.
    assert node.get_parameter("ridge").type_ == Parameter.Type.DOUBLE
    assert node.get_parameter("ridge").value == 20.0
    assert list(node.get_parameter("reference_point").value) == [1.0, 0.0]


@pytest.mark.parametrize(
    ("given", "said"),
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
        ("use_imu:=yes", "parameter 'use_imu' is True: give one of 'auto', 'required', 'never'"),
        ("drive_joints:=[]", "parameter 'drive_joints' is nothing: give a list of one name"),
        ("drive_joints:=[1, 2]", "parameter 'drive_joints' is [1, 2]: give a list of one name"),
        ("imu_position:=[1.0]", "parameter 'imu_position' is [1.0]: give a list of 2 numbers"),
        ("imu_position:=3.0", "parameter 'imu_position' is 3.0: give a list of 2 numbers"),
        ("imu_position:=[1.0, 99.0]", "[1.0, 99.0]: give a list of 2 numbers from -50 to 50"),
        ("frame_id:=7", "parameter 'frame_id' is 7: give a text"),
        ("horizon_s:=11", "parameter 'horizon_s' is 11: give a number from 0 to 10"),
        ("command_type:=twist", "'joint_state', 'ackermann', 'autoware_control'"),
    ],
)
def test_what_does_not_fit_is_refused(
    node_with: Callable[..., Any], given: str, said: str
) -> None:
    with pytest.raises(UsageError) as refused:
        parameters.read(node_with("model:=m", given))
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


def test_the_model_is_required(node_with: Callable[..., Any]) -> None:
    with pytest.raises(UsageError, match="parameter 'model' is not given"):
        parameters.read(node_with())


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("steering_ratio:=0.0", "steering_ratio is 0"),
        ("command_type:=ackermann", "set mass and wheel_radius"),
        ("window:=1", "window is 1 samples"),
        ("ridge:=0.0001", "ridge is 0.0001"),
        ("forgetting:=0.1", "forgetting is 0.1"),
    ],
)
def test_what_contradicts_itself_is_refused(
    node_with: Callable[..., Any], given: str, said: str
) -> None:
    values = parameters.read(node_with("model:=m", given))
    with pytest.raises(UsageError, match=said):
        parameters.pipeline_settings(values, OnlineSettings())


def test_a_name_given_wrongly_is_told(node_with: Callable[..., Any]) -> None:
    node = node_with("model:=m", "windw:=50", "whatever:=1", "use_sim_time:=true")
    parameters.read(node)
    assert parameters.unknown(node) == [
        "parameter 'windw' is unknown and ignored: did you mean 'window'?",
        "parameter 'whatever' is unknown and ignored",
    ]


def test_structural_parameters_are_fixed(node_with: Callable[..., Any]) -> None:
    node = node_with("model:=m")
    parameters.read(node)
    fixed, live = node.set_parameters(
        [Parameter("window", value=10), Parameter("publish_horizon", value=False)]
    )
    assert not fixed.successful
    assert live.successful
    assert node.get_parameter("publish_horizon").value is False
