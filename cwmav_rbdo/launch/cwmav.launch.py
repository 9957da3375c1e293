# SPDX-License-Identifier: Apache-2.0
"""The whole suite: simulation, rig and optimiser; `ros2 launch cwmav_rbdo cwmav.launch.py --show-args`."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

_ARGUMENTS = (
    ("recording", "", "recording that the rig node replays: rosbag2 folder or .mcap file; empty: none"),
    ("fidelity", "table", "how the simulation node answers: table, or a preset of the solver"),
    ("workers", "1", "simulations at the same time"),
    ("run_root", "runs", "folder that run folders are written to"),
    ("use_sim_time", "false", "take the time from /clock: true or false"),
    ("log_level", "info", "least severity shown: debug, info, warn, error"),
)


def _node(package, executable, name, parameters):
    return Node(
        package=package,
        executable=executable,
        name=name,
        parameters=[{**parameters, "use_sim_time": LaunchConfiguration("use_sim_time")}],
        arguments=["--ros-args", "--log-level", LaunchConfiguration("log_level")],
        output="screen",
    )


def generate_launch_description():
    arguments = [
        DeclareLaunchArgument(name, default_value=default, description=description)
        for name, default, description in _ARGUMENTS
    ]
    simulation = _node(
        "cwmav_sim",
        "sim_node",
        "sim",
        {"fidelity": LaunchConfiguration("fidelity"), "workers": LaunchConfiguration("workers")},
    )
    rig = _node("cwmav_rig", "rig_node", "rig", {"recording": LaunchConfiguration("recording")})
    optimiser = _node(
        "cwmav_rbdo", "optimiser_node", "optimiser", {"run_root": LaunchConfiguration("run_root")}
    )
    return LaunchDescription([*arguments, simulation, rig, optimiser])
