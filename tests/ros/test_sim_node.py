# SPDX-License-Identifier: Apache-2.0
"""The node /sim against stand-ins of table and solver: every service, action and topic."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from cwmav_msgs.action import Simulate
from cwmav_msgs.msg import ControlPoint, LiftSample
from cwmav_msgs.srv import EvaluateLift
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import MarkerArray

from cwmav_common.errors import InputError
from cwmav_sim.nodes.sim_node import SimNode
from support import ros_fakes as fakes
from support.ros_harness import Ros, wait_for


@pytest.fixture
def sim(ros: Ros, tmp_path: Path) -> SimNode:
    return ros.make(SimNode, fakes.FakeTable, fakes.live, store=str(tmp_path))


def point(frequency: float, angle_deg: float = 15.0, airspeed: float = 3.0) -> ControlPoint:
    return ControlPoint(
        flapping_frequency=frequency,
        angle_of_attack=math.radians(angle_deg),
        forward_velocity=airspeed,
    )


def set_parameter(ros: Ros, **values: Any) -> Any:
    kinds = {str: (4, "string_value"), int: (2, "integer_value"), float: (3, "double_value")}
    parameters = []
    for name, value in values.items():
        number, field = kinds[type(value)]
        parameters.append(Parameter(name=name, value=ParameterValue(type=number, **{field: value})))
    return ros.call(SetParameters, "sim/set_parameters", parameters=parameters).results


def test_lift_from_the_table(ros: Ros, sim: SimNode) -> None:
    answer = ros.call(EvaluateLift, "sim/evaluate_lift", point=point(12.0))
    assert answer.success
    assert answer.lift == pytest.approx(12e-3)
    assert answer.lift_std == pytest.approx(1e-4)
    assert answer.source == "fake table"


def test_the_table_says_when_it_extrapolates(ros: Ros, sim: SimNode) -> None:
    answer = ros.call(EvaluateLift, "sim/evaluate_lift", point=point(25.0), fidelity="table")
    assert answer.success
    assert answer.source.endswith("outside of the runs it rests on")


def test_lift_from_a_live_run_keeps_the_angle(ros: Ros, sim: SimNode) -> None:
    answer = ros.call(EvaluateLift, "sim/evaluate_lift", point=point(12.0, 21.5), fidelity="smoke")
    assert answer.success
    assert answer.lift == 1e-2 * 21.5  # exactly: degrees survive the trip through radians
    assert "SPH smoke" in answer.source


@pytest.mark.parametrize(
    ("fidelity", "frequency", "expected"),
    [
        ("finest", 12.0, "fidelity is 'finest'; allowed: table, smoke, coarse, fine, default, paper"),
        ("table", 31.0, "allowed: 4 to 30 Hz"),
        ("smoke", 31.0, "flapping_frequency"),
        ("smoke", fakes.REFUSE, "refused, as asked"),
        ("smoke", fakes.FAIL, "failed, as asked"),
        ("smoke", fakes.DIE, "signal 9"),
    ],
)
def test_no_lift_with_the_reason(
    ros: Ros, sim: SimNode, fidelity: str, frequency: float, expected: str
) -> None:
    answer = ros.call(EvaluateLift, "sim/evaluate_lift", point=point(frequency), fidelity=fidelity)
    assert not answer.success
    assert expected in answer.message
    assert math.isnan(answer.lift)


def test_answers_while_a_run_hangs(ros: Ros, sim: SimNode) -> None:
    goal = ros.goal(Simulate, "sim/simulate", point=point(fakes.HANG), fidelity="smoke")
    wait_for(lambda: goal.feedback, "feedback")
    assert ros.call(EvaluateLift, "sim/evaluate_lift", point=point(12.0)).success
    assert ros.call(GetParameters, "sim/get_parameters", names=["workers"]).values[0].integer_value == 1
    goal.cancel()
    status, result = goal.result()
    assert status == GoalStatus.STATUS_CANCELED
    assert not result.success
    assert result.message == "cancelled, as asked"


def test_several_workers_run_at_once(ros: Ros, tmp_path: Path) -> None:
    ros.make(SimNode, fakes.FakeTable, fakes.live, store=str(tmp_path), workers=2)
    first = ros.goal(Simulate, "sim/simulate", point=point(fakes.HANG))
    second = ros.goal(Simulate, "sim/simulate", point=point(fakes.HANG))
    for goal in (first, second):
        wait_for(lambda goal=goal: goal.feedback, "feedback of both")
    for goal in (first, second):
        goal.cancel()
        assert goal.result()[0] == GoalStatus.STATUS_CANCELED


def test_simulate_gives_feedback_topics_and_result(ros: Ros, sim: SimNode) -> None:
    lift = ros.collect(LiftSample, "sim/lift")
    wings = ros.collect(MarkerArray, "sim/wings")
    particles = ros.collect(PointCloud2, "sim/particles")
    for name in ("lift", "wings", "particles"):
        wait_for(lambda name=name: ros.tester.count_publishers(ros.name(f"sim/{name}")), "discovery")
    goal = ros.goal(Simulate, "sim/simulate", point=point(12.0), publish_particles=True)
    status, result = goal.result()
    assert status == GoalStatus.STATUS_SUCCEEDED
    assert result.success
    assert (result.lift, result.cycles, result.periodic) == (0.15, 4, True)
    assert json.loads(result.result_json)["mean_lift_n"] == 0.15
    wait_for(lambda: len(goal.feedback) == 2 and len(lift) == 2 and wings and particles, "all messages")
    assert [f.fraction for f in goal.feedback] == [0.5, 1.0]
    assert goal.feedback[0].mean_lift == 0.19
    assert (lift[1].phase, lift[1].drag, lift[1].power) == pytest.approx((2.4, 0.02, 0.4))
    assert lift[0].header.frame_id == "wind"
    panels = {marker.ns for marker in wings[0].markers}
    assert len(panels) == len(wings[0].markers) >= 2
    table = np.frombuffer(particles[0].data, np.float32).reshape(-1, 7)
    assert [field.name for field in particles[0].fields] == ["x", "y", "z", "vx", "vy", "vz", "pressure"]
    assert np.array_equal(table[:, 6], np.arange(particles[0].width))


def test_particles_are_off_unless_asked(ros: Ros, sim: SimNode) -> None:
    wings = ros.collect(MarkerArray, "sim/wings")
    particles = ros.collect(PointCloud2, "sim/particles")
    wait_for(lambda: ros.tester.count_publishers(ros.name("sim/wings")), "discovery")
    ros.goal(Simulate, "sim/simulate", point=point(12.0)).result()
    wait_for(lambda: wings, "wings")
    assert not particles


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ({"fidelity": "table"}, "a live run needs one of: smoke"),
        ({"fidelity": "finest"}, "finest"),
        ({"overrides": ["flow.resolution.dq=1"]}, "flow.resolution.dq"),
        ({"overrides": ["run.cycles"]}, "expected key=value"),
        ({"point": point(99.0)}, "flapping_frequency"),
    ],
)
def test_a_goal_that_makes_no_sense_ends_with_the_reason(
    ros: Ros, sim: SimNode, fields: dict[str, Any], expected: str
) -> None:
    status, result = ros.goal(Simulate, "sim/simulate", **({"point": point(12.0)} | fields)).result()
    assert status == GoalStatus.STATUS_ABORTED
    assert not result.success
    assert expected in result.message


def test_every_parameter_is_described_and_limited(ros: Ros, sim: SimNode) -> None:
    own = [
        "fidelity",
        "preset",
        "workers",
        "device",
        "store",
        "view_rate",
        "publish_particles",
        "particle_share",
    ]
    names = ros.call(ListParameters, "sim/list_parameters").result.names
    assert set(own) <= set(names)
    described = ros.call(DescribeParameters, "sim/describe_parameters", names=own).descriptors
    assert all(d.description for d in described)
    workers = described[own.index("workers")].integer_range[0]
    assert (workers.from_value, workers.to_value) == (1, 64)
    rate = described[own.index("view_rate")]
    assert rate.description.endswith("[Hz]")
    assert (rate.floating_point_range[0].from_value, rate.floating_point_range[0].to_value) == (0.0, 100.0)
    assert "smoke" in described[own.index("fidelity")].additional_constraints


def test_parameters_are_refused_with_the_reason(ros: Ros, sim: SimNode) -> None:
    (refused,) = set_parameter(ros, fidelity="finest")
    assert not refused.successful
    assert "'fidelity' is 'finest'; allowed: one of table" in refused.reason
    (refused,) = set_parameter(ros, view_rate=0.0)  # inside of the closed range, outside of the open one
    assert not refused.successful
    assert "> 0" in refused.reason
    (refused,) = set_parameter(ros, workers=65)
    assert not refused.successful
    (refused,) = set_parameter(ros, wokers=2)
    assert not refused.successful
    assert sim.settings.workers == 1
    (accepted,) = set_parameter(ros, workers=3)
    assert accepted.successful
    assert sim.settings.workers == 3


def test_a_start_value_out_of_range_names_it(ros: Ros) -> None:
    with pytest.raises(InputError, match="workers"):
        ros.make(SimNode, fakes.FakeTable, fakes.live, workers=0)


def test_diagnostics_tell_of_deaths(ros: Ros, sim: SimNode) -> None:
    heard = ros.collect(DiagnosticArray, "/diagnostics")
    name = f"{ros.name('sim')}: work"

    def last() -> Any:
        found = [s for array in heard for s in array.status if s.name == name]
        return found[-1] if found else None

    wait_for(last, "diagnostics")
    assert (last().level, last().message) == (DiagnosticStatus.OK, "idle")
    ros.call(EvaluateLift, "sim/evaluate_lift", point=point(fakes.DIE), fidelity="smoke")
    wait_for(lambda: last().level == DiagnosticStatus.WARN, "a warning")
    assert {"worker deaths": "1", "failed": "1"}.items() <= {v.key: v.value for v in last().values}.items()
