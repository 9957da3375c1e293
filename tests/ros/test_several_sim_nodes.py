# SPDX-License-Identifier: Apache-2.0
"""Points shared among simulation nodes; one that fails at a point is not asked for it again at once."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from cwmav_msgs.srv import EvaluateLift, EvaluatePower
from rclpy.node import Node

from cwmav_common.errors import InputError
from cwmav_common.ros.calls import CallQueue
from cwmav_rbdo.dispatch import DispatchSettings, evaluate_all
from cwmav_rbdo.evaluation import Request
from cwmav_rbdo.ros.dispatch import RosEvaluator
from cwmav_rbdo.ros.settings import OptimiserSettings
from support.ros_harness import Ros


class Simulation(Node):
    """Lift of 1 N from a node of any name, or a refusal; counts what it is asked."""

    def __init__(self, name: str, workers: int, broken: bool, **options: Any) -> None:
        super().__init__(name, **options)
        self.declare_parameter("workers", workers)
        self.asked = 0
        self._broken = broken
        self.create_service(EvaluateLift, "~/evaluate_lift", self._lift)
        self.create_service(EvaluatePower, "~/evaluate_power", self._power)

    def _lift(self, request: Any, response: Any) -> Any:
        self.asked += 1
        response.success, response.message = not self._broken, "the solver blew up"
        response.lift, response.lift_std, response.source = 1.0, 0.01, self.get_name()
        return response

    def _power(self, request: Any, response: Any) -> Any:
        response.success, response.power, response.source = True, 2.0, "fake rig"
        return response


@pytest.fixture
def evaluator(ros: Ros) -> RosEvaluator:
    names = ",".join(ros.name(name) for name in ("sim_a", "sim_b"))
    settings = OptimiserSettings(sim=names, rig=ros.name("rig"), patience=20.0)
    return RosEvaluator(ros.tester, settings, CallQueue(ros.tester))


def evaluate(evaluator: RosEvaluator, count: int) -> dict[int, Any]:
    answers: dict[int, Any] = {}
    points = [np.array([10.0 + k, 0.2, 3.0]) for k in range(count)]
    requests = [Request(k, x, x, "initial") for k, x in enumerate(points)]
    evaluate_all(requests, evaluator, DispatchSettings(attempts=3, timeout=60.0), answers.__setitem__)
    return answers


def test_two_nodes_share_the_points_and_their_workers_add_up(ros: Ros, evaluator: RosEvaluator) -> None:
    a = ros.make(Simulation, "sim_a", 1, False)
    b = ros.make(Simulation, "sim_b", 2, False)
    ros.make(Simulation, "rig", 1, False)
    assert evaluator.learn_workers().result(60) == 3
    answers = evaluate(evaluator, 12)
    assert all(answer.outcome.lift == 1.0 and answer.attempts == 1 for answer in answers.values())
    assert {answer.outcome.lift_source for answer in answers.values()} == {"sim_a", "sim_b"}
    assert a.asked + b.asked == 12


def test_what_fails_on_one_node_is_repeated_on_the_other(ros: Ros, evaluator: RosEvaluator) -> None:
    broken = ros.make(Simulation, "sim_a", 1, True)
    ros.make(Simulation, "sim_b", 1, False)
    ros.make(Simulation, "rig", 1, False)
    answers = evaluate(evaluator, 6)
    assert all(answer.outcome.lift_source == "sim_b" for answer in answers.values())
    assert 0 < broken.asked <= 6
    assert any("the solver blew up" in answer.note for answer in answers.values())
    assert max(answer.attempts for answer in answers.values()) == 2


def test_names_of_nodes_that_make_no_sense_are_refused() -> None:
    with pytest.raises(InputError, match="sim is empty"):
        OptimiserSettings(sim=" , ")
    with pytest.raises(InputError, match="a node is named twice"):
        OptimiserSettings(sim="/sim,/sim")
