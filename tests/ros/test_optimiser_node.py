# SPDX-License-Identifier: Apache-2.0
"""The node /optimiser between the two other nodes: its action, its topic, its patience."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from action_msgs.msg import GoalStatus
from cwmav_msgs.action import Optimise
from cwmav_msgs.msg import OptimiserIteration, UncertaintyEstimate
from cwmav_msgs.srv import EstimateUncertainty, EvaluatePower
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import GetParameters
from rclpy.node import Node

from cwmav_common import interfaces
from cwmav_common.mcap_reader import open_recording
from cwmav_common.ros.qos import LATCHED
from cwmav_rbdo.nodes.optimiser_node import OptimiserNode
from cwmav_sim.nodes.sim_node import SimNode
from support import ros_fakes as fakes
from support.ros_harness import Ros, wait_for

PROBLEM: dict[str, Any] = {
    "id": "small",
    "kind": "lift_to_power",
    "design": [{"name": "F", "lo": 4, "hi": 30}, {"name": "AoA", "lo": -10, "hi": 60}],
    "fixed": {"U": 3.0},
    "require": {"lift_to_power": 0.12, "reliability": 0.9974},
}


class FakeRig(Node):
    """Power of 2 W everywhere, scatter as in the paper; counts what it is asked."""

    def __init__(self, **options: Any) -> None:
        super().__init__("rig", **options)
        self.asked = 0
        self.create_service(EvaluatePower, "~/evaluate_power", self._power)
        self.create_service(EstimateUncertainty, "~/estimate_uncertainty", self._scatter)

    def _power(self, request: Any, response: Any) -> Any:
        self.asked += 1
        response.success, response.power, response.power_std, response.source = True, 2.0, 0.01, "fake rig"
        return response

    def _scatter(self, request: Any, response: Any) -> Any:
        response.success = True
        response.estimate = UncertaintyEstimate(
            source="fake",
            cycles=100,
            flapping_frequency_std=0.153,
            angle_of_attack_std=math.radians(0.462),
            forward_velocity_std=0.05,
            distribution=["normal"] * 3,
        )
        return response


@pytest.fixture
def make_optimiser(ros: Ros, tmp_path: Path) -> Callable[..., OptimiserNode]:
    def make(**parameters: Any) -> OptimiserNode:
        names = {"sim": ros.name("sim"), "rig": ros.name("rig"), "run_root": str(tmp_path / "runs")}
        return ros.make(OptimiserNode, fakes.study, **(names | parameters))

    return make


@pytest.fixture
def optimiser(ros: Ros, make_optimiser: Callable[..., OptimiserNode]) -> OptimiserNode:
    ros.make(SimNode, fakes.FakeTable, fakes.live, workers=3)
    ros.make(FakeRig)
    return make_optimiser()


def text(**changes: Any) -> str:
    return yaml.safe_dump(PROBLEM | changes)


def test_a_study_over_the_services(ros: Ros, optimiser: OptimiserNode) -> None:
    goal = ros.goal(Optimise, "optimiser/optimise", problem=text(), seed=5)
    status, result = goal.result()
    assert (status, result.success, result.message) == (GoalStatus.STATUS_SUCCEEDED, True, "as asked")
    assert result.lift_to_power == pytest.approx(12e-3 / 2.0)
    assert result.design.flapping_frequency == 12.0
    assert result.design.angle_of_attack == pytest.approx(math.radians(22.0))
    assert result.design.forward_velocity == 3.0
    assert list(result.reliability_interval) == [0.997, 0.999]
    details = json.loads(result.result_json)
    assert details["workers"] == 3
    assert details["noise"]["scatter"]["AoA"]["std"] == pytest.approx(0.462)
    assert details["sources"] == ["fake table", "fake rig"]
    assert (details["seed"], details["resumed"]) == (5, False)
    rows = {f.iteration.iteration: f for f in goal.feedback if f.iteration.evaluations}
    assert sorted(rows) == [0, 1]
    assert rows[0].iteration.evaluations == 7
    assert rows[0].iteration.error_percent == pytest.approx(100.0 / 11.0)
    assert rows[0].iteration.window_lower.angle_of_attack == pytest.approx(math.radians(19.0))


def test_the_last_iteration_is_latched(ros: Ros, optimiser: OptimiserNode) -> None:
    ros.goal(Optimise, "optimiser/optimise", problem=text()).result()
    late = ros.collect(OptimiserIteration, "optimiser/iteration", LATCHED)
    wait_for(lambda: late, "the latched iteration")
    assert (late[0].iteration, late[0].converged, late[0].evaluations) == (1, True, 8)


def test_everything_published_is_recorded(ros: Ros, optimiser: OptimiserNode) -> None:
    heard = ros.collect(DiagnosticArray, "/diagnostics")
    wait_for(lambda: heard, "diagnostics")
    _, result = ros.goal(Optimise, "optimiser/optimise", problem=text()).result()
    with open_recording(Path(result.run_folder) / "run.mcap") as recording:
        topic = ros.name("optimiser/iteration")
        messages = list(recording.messages([topic]))
        rows = [interfaces.deserialise(m.data, m.type_name) for m in messages]
        assert [row.iteration for row in rows] == [0, 1]
        assert rows[1].run == Path(result.run_folder).name
        assert "/diagnostics" in recording.topics


@pytest.mark.parametrize(
    ("problem", "expected"),
    [
        ("no_such_problem.yaml", "no_such_problem.yaml: no such file"),
        (text(require={"lift_to_power": -1.0}), "'require.lift_to_power' is -1.0; allowed: float > 0 N/W"),
        (text(fixed={}), "U is neither in design nor in fixed"),
        ("{id: [", "is not valid YAML"),
        (
            "{id: x, kind: global, design: [{name: b, lo: 1, hi: 2}], objective: b}",
            "allowed here: lift_to_power",
        ),
    ],
)
def test_a_problem_that_makes_no_sense_ends_with_the_reason(
    ros: Ros, optimiser: OptimiserNode, problem: str, expected: str
) -> None:
    status, result = ros.goal(Optimise, "optimiser/optimise", problem=problem).result()
    assert status == GoalStatus.STATUS_ABORTED
    assert expected in result.message


def test_cancel_and_one_study_at_a_time(ros: Ros, optimiser: OptimiserNode) -> None:
    first = ros.goal(Optimise, "optimiser/optimise", problem=text(), seed=int(fakes.HANG))
    _, refused = ros.goal(Optimise, "optimiser/optimise", problem=text()).result()
    assert "a study is running" in refused.message
    names = ["patience"]
    assert ros.call(GetParameters, "optimiser/get_parameters", names=names).values[0].double_value == 60.0
    first.cancel()
    status, result = first.result()
    assert status == GoalStatus.STATUS_CANCELED
    assert result.message == "cancelled, as asked"
    assert ros.goal(Optimise, "optimiser/optimise", problem=text()).result()[1].success


def test_failures_of_the_study_come_with_their_run_folder(ros: Ros, optimiser: OptimiserNode) -> None:
    status, result = ros.goal(Optimise, "optimiser/optimise", problem=text(), seed=int(fakes.DIE)).result()
    assert status == GoalStatus.STATUS_ABORTED
    assert "signal 9" in result.message
    assert Path(result.run_folder).is_dir()


def test_resume_needs_a_run_folder(ros: Ros, optimiser: OptimiserNode, tmp_path: Path) -> None:
    _, result = ros.goal(Optimise, "optimiser/optimise", problem=text(), resume=str(tmp_path)).result()
    assert f"{tmp_path}: is no run folder" in result.message


def test_missing_nodes_are_named(ros: Ros, make_optimiser: Callable[..., OptimiserNode]) -> None:
    make_optimiser(patience=1.0)
    status, result = ros.goal(Optimise, "optimiser/optimise", problem=text()).result()
    assert status == GoalStatus.STATUS_ABORTED
    assert f"nobody has offered the service {ros.name('sim/get_parameters')} for 1 s" in result.message


def test_a_refused_point_reaches_the_study(ros: Ros, make_optimiser: Callable[..., OptimiserNode]) -> None:
    ros.make(SimNode, fakes.FakeTable, fakes.live)
    ros.make(FakeRig)
    make_optimiser(fidelity="finest")
    _, result = ros.goal(Optimise, "optimiser/optimise", problem=text()).result()
    assert "fidelity is 'finest'" in result.message


def test_a_sim_node_that_comes_later_is_waited_for(
    ros: Ros, make_optimiser: Callable[..., OptimiserNode]
) -> None:
    ros.make(FakeRig)
    make_optimiser()
    goal = ros.goal(Optimise, "optimiser/optimise", problem=text())
    wait_for(lambda: goal.feedback, "the study to begin")
    ros.make(SimNode, fakes.FakeTable, fakes.live)
    assert goal.result()[1].success
