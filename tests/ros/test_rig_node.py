# SPDX-License-Identifier: Apache-2.0
"""The node /rig on a short synthetic recording: every service and topic."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from cwmav_msgs.msg import ControlPoint, PowerBlock, ScalarStamped, UncertaintyEstimate, WrenchBlock
from cwmav_msgs.srv import EstimateUncertainty, EvaluatePower, Pause, Resume, Seek, SetRate
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TwistWithCovarianceStamped, WrenchStamped
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import SetParameters
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from cwmav_common.errors import InputError
from cwmav_common.mcap_reader import open_recording
from cwmav_common.ros.qos import LATCHED
from cwmav_rig.nodes.rig_node import RigNode
from cwmav_rig.power_model import OperatingPoint, PowerModel
from support.ros_harness import Ros, wait_for


@pytest.fixture
def model(tmp_path: Path) -> Path:
    """Make a power model whose power is (1 + F/10) W."""
    points = [
        OperatingPoint(f, a, u, 1.0 + f / 10.0, 0.01, source="test")
        for f in (5.0, 15.0, 25.0)
        for a in (0.0, 0.8)
        for u in (1.0, 5.0)
    ]
    path = tmp_path / "power.json"
    PowerModel(points).save(path)
    return path


@pytest.fixture
def rig(ros: Ros, recording: Path, model: Path) -> RigNode:
    return ros.make(RigNode, recording=str(recording), power_model=str(model), start_paused=True, rate=4.0)


def start_ns(recording: Path) -> int:
    with open_recording(recording) as opened:
        return opened.span_ns[0]


def time_at(recording: Path, seconds: float) -> Time:
    sec, nanosec = divmod(start_ns(recording) + round(seconds * 1e9), 1_000_000_000)
    return Time(sec=sec, nanosec=nanosec)


def stamp(message: Any) -> float:
    return float(message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec)


def test_every_topic_of_a_replay(ros: Ros, rig: RigNode) -> None:
    topics = {
        "wrench": WrenchStamped,
        "wrench_block": WrenchBlock,
        "power_block": PowerBlock,
        "angle_of_attack": ScalarStamped,
        "airspeed": TwistWithCovarianceStamped,
        "flapping_frequency": ScalarStamped,
    }
    heard = {name: ros.collect(kind, f"rig/{name}", 10000) for name, kind in topics.items()}
    for name in topics:
        wait_for(
            lambda name=name: ros.tester.count_publishers(ros.name(f"rig/{name}")), f"discovery of {name}"
        )
    ros.call(Resume, "rig/resume")
    wait_for(lambda: len(heard["flapping_frequency"]) > 20, "cycles")
    assert all(heard.values())
    frequencies = [m.value for m in heard["flapping_frequency"]]
    assert np.mean(frequencies) == pytest.approx(12.0, abs=0.3)
    ends = [stamp(m) for m in heard["flapping_frequency"]]
    assert np.diff(ends) == pytest.approx(1.0 / np.array(frequencies[1:]), rel=0.05)
    blocks = heard["wrench_block"]
    assert len(blocks[0].data) % 6 == 0
    samples = len(blocks[0].data) // 6
    spacing = np.diff([stamp(b) for b in blocks[:20]])
    assert spacing == pytest.approx(samples / blocks[0].sample_rate_hz, rel=0.02)  # stamps jitter
    view = np.diff([stamp(m) for m in heard["wrench"]])
    assert np.median(view) == pytest.approx(1.0 / 200.0, rel=0.1)
    power = heard["power_block"][0]
    assert np.mean(np.array(power.voltage) * np.array(power.current)) > 0.1
    assert np.degrees(np.median([m.value for m in heard["angle_of_attack"]])) == pytest.approx(15.0, abs=2.0)
    assert np.median([m.twist.twist.linear.x for m in heard["airspeed"]]) == pytest.approx(3.5, abs=0.3)


def test_player_services(ros: Ros, rig: RigNode, recording: Path) -> None:
    blocks = ros.collect(WrenchBlock, "rig/wrench_block", 10000)
    wait_for(lambda: ros.tester.count_publishers(ros.name("rig/wrench_block")), "discovery")
    assert ros.call(Seek, "rig/seek", time=time_at(recording, 5.0)).success
    assert not ros.call(Seek, "rig/seek", time=time_at(recording, 500.0)).success
    assert not ros.call(SetRate, "rig/set_rate", rate=0.0).success
    assert ros.call(SetRate, "rig/set_rate", rate=2.0).success
    assert not blocks  # paused so far
    ros.call(Resume, "rig/resume")
    wait_for(lambda: len(blocks) > 5, "blocks after the resume")
    assert stamp(blocks[0]) == pytest.approx(1e-9 * start_ns(recording) + 5.0, abs=0.2)
    ros.call(Pause, "rig/pause")
    position = rig._player.position
    assert rig._player.rate == 2.0
    assert not rig._player.running
    assert ros.call(Trigger, "rig/tare").success
    assert rig._player.position == position


def test_tare_takes_the_mean_away(ros: Ros, rig: RigNode, recording: Path) -> None:
    before = ros.call(Trigger, "rig/tare")
    assert not before.success
    assert "no force has been replayed yet" in before.message
    blocks = ros.collect(WrenchBlock, "rig/wrench_block", 10000)
    wait_for(lambda: ros.tester.count_publishers(ros.name("rig/wrench_block")), "discovery")
    ros.call(Resume, "rig/resume")
    wait_for(lambda: len(blocks) > 150, "force")
    ros.call(Pause, "rig/pause")
    assert ros.call(Trigger, "rig/tare").success
    assert np.abs(rig._publisher.offset).max() > 0
    raw = np.array(blocks[50].data).reshape(-1, 6)
    at, count = blocks[50].header.stamp, len(blocks)
    assert ros.call(Seek, "rig/seek", time=at).success
    ros.call(Resume, "rig/resume")
    wait_for(lambda: any(b.header.stamp == at for b in blocks[count:]), "the same block again")
    again = next(b for b in blocks[count:] if b.header.stamp == at)
    tared = np.array(again.data).reshape(-1, 6)
    assert raw - tared == pytest.approx(np.broadcast_to(rig._publisher.offset, raw.shape), abs=1e-5)


def test_power(ros: Ros, rig: RigNode) -> None:
    point = ControlPoint(flapping_frequency=15.0, angle_of_attack=0.8, forward_velocity=5.0)  # a measured one
    answer = ros.call(EvaluatePower, "rig/evaluate_power", point=point)
    assert answer.success, answer.message
    assert answer.power == pytest.approx(2.5, rel=0.05)
    assert 0 < answer.power_std < 0.5
    assert "12 recordings" in answer.source
    refused = ros.call(EvaluatePower, "rig/evaluate_power", point=point, fidelity="smoke")
    assert not refused.success
    assert refused.message == "fidelity is 'smoke'; allowed: recorded, or empty"


def test_power_without_a_model_says_which_file(ros: Ros, tmp_path: Path) -> None:
    path = tmp_path / "power.json"
    path.write_text("{}")
    ros.make(RigNode, power_model=str(path))
    answer = ros.call(EvaluatePower, "rig/evaluate_power")
    assert not answer.success
    assert str(path) in answer.message


def test_uncertainty_is_answered_and_latched(ros: Ros, rig: RigNode, recording: Path) -> None:
    answer = ros.call(EstimateUncertainty, "rig/estimate_uncertainty", deadline=60.0)
    assert answer.success, answer.message
    assert answer.flapping_frequency_std == pytest.approx(0.153, rel=0.4)
    assert math.degrees(answer.angle_of_attack_std) == pytest.approx(0.462, rel=0.4)
    assert answer.forward_velocity_std == pytest.approx(0.05, rel=0.4)
    estimate = answer.estimate
    low, high = estimate.flapping_frequency_std_interval
    assert low < answer.flapping_frequency_std < high
    assert estimate.synthetic
    assert estimate.cycles > 80
    late = ros.collect(UncertaintyEstimate, "rig/uncertainty", LATCHED)
    wait_for(lambda: late, "the latched estimate")
    assert late[0] == estimate
    part = ros.call(EstimateUncertainty, "rig/estimate_uncertainty", window_start=2.0, window_duration=3.0)
    assert part.success, part.message
    assert 30 <= part.estimate.cycles <= 37
    wait_for(lambda: len(late) == 2, "the new estimate")


def test_uncertainty_refusals(ros: Ros, rig: RigNode, tmp_path: Path) -> None:
    missing = tmp_path / "none.mcap"
    answer = ros.call(EstimateUncertainty, "rig/estimate_uncertainty", recording=str(missing))
    assert not answer.success
    assert str(missing) in answer.message
    answer = ros.call(EstimateUncertainty, "rig/estimate_uncertainty", window_start=-1.0)
    assert "window_start -1 s" in answer.message
    assert math.isnan(answer.flapping_frequency_std)


def test_a_node_without_recording_says_so(ros: Ros) -> None:
    ros.make(RigNode)
    assert "no recording" in ros.call(EstimateUncertainty, "rig/estimate_uncertainty").message
    assert not ros.call(SetRate, "rig/set_rate", rate=1.0).success


def test_missing_recording_stops_the_start(ros: Ros, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such recording"):
        ros.make(RigNode, recording=str(tmp_path / "none"))


def test_a_wrong_recording_is_refused_and_the_old_one_stays(ros: Ros, rig: RigNode, tmp_path: Path) -> None:
    junk = tmp_path / "junk.mcap"
    junk.write_bytes(b"not a recording")
    parameter = Parameter(name="recording", value=ParameterValue(type=4, string_value=str(junk)))
    (result,) = ros.call(SetParameters, "rig/set_parameters", parameters=[parameter]).results
    assert not result.successful
    assert str(junk) in result.reason
    ros.call(Resume, "rig/resume")
    wait_for(lambda: rig._counts["messages replayed"], "the old recording")


def test_clock_of_the_recording(ros: Ros, recording: Path) -> None:
    heard = ros.collect(Clock, "/clock")
    ros.make(RigNode, recording=str(recording), publish_clock=True)
    wait_for(lambda: len(heard) > 20, "the clock")
    times = [c.clock.sec + 1e-9 * c.clock.nanosec for c in heard]
    assert all(np.diff(times) >= 0)
    assert 0 <= times[0] - 1e-9 * start_ns(recording) < 8.0


def test_diagnostics_tell_the_position(ros: Ros, rig: RigNode) -> None:
    heard = ros.collect(DiagnosticArray, "/diagnostics")
    name = f"{ros.name('rig')}: replay"
    wait_for(lambda: any(s.name == name for a in heard for s in a.status), "diagnostics")
    status = next(s for a in heard for s in a.status if s.name == name)
    assert status.message.startswith("paused, 0.0 of 8")
