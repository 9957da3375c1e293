# SPDX-License-Identifier: Apache-2.0
"""Life cycle of the node /rig, live instruments from simulated devices, and a replay that loses nothing."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cwmav_msgs.msg import PowerBlock, WrenchBlock
from cwmav_msgs.srv import EstimateUncertainty
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import TwistWithCovarianceStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from std_srvs.srv import Trigger

from cwmav_common.mcap_reader import open_recording
from cwmav_rig.nodes.rig_node import RigNode
from cwmav_rig.simulated.net_box import SimulatedNetBox
from cwmav_rig.simulated.scpi_server import TUNNEL, SimulatedScpi
from support.ros_harness import Ros, wait_for

pytest.importorskip("pynetft")
pytest.importorskip("pyvisa")


def state(ros: Ros) -> str:
    return str(ros.call(GetState, "rig/get_state").current_state.label)


def change(ros: Ros, transition: int) -> bool:
    return bool(ros.call(ChangeState, "rig/change_state", transition=Transition(id=transition)).success)


def latest(heard: list[DiagnosticArray], name: str) -> DiagnosticStatus | None:
    found = [s for array in heard for s in array.status if s.name == name]
    return found[-1] if found else None


def values(status: DiagnosticStatus) -> dict[str, str]:
    return {pair.key: pair.value for pair in status.values}


class Bench:
    """Simulated force sensor, oscilloscope and tunnel."""

    def __init__(self, folder: Path) -> None:
        self.box = SimulatedNetBox(
            lambda n: (0.1, 0.0, -0.2 + 0.3 * np.sin(0.0377 * n), 0.0, 0.0, 0.0), 2000.0
        )
        self.scope, self.tunnel = SimulatedScpi(), SimulatedScpi(identity=TUNNEL)
        self.file = folder / "bench.yaml"
        self.file.write_text(
            f"force: {{host: 127.0.0.1, rate: 2000, stall: 3, rdt_port: {self.box.rdt_port},"
            f" http_port: {self.box.http_port}}}\n"
            f"oscilloscope: {{resource: '{self.scope.resource}'}}\n"
            f"tunnel: {{resource: '{self.tunnel.resource}', rate: 20}}\n"
        )


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    made = Bench(tmp_path)
    with made.box, made.scope, made.tunnel:
        yield made


def test_a_recording_starts_by_itself(ros: Ros, recording: Path) -> None:
    ros.make(RigNode, recording=str(recording))
    assert state(ros) == "active"


def test_the_life_cycle_of_a_replay(ros: Ros, recording: Path) -> None:
    rig = ros.make(RigNode, recording=str(recording), autostart=False)
    assert state(ros) == "unconfigured"
    assert change(ros, Transition.TRANSITION_CONFIGURE)
    assert state(ros) == "inactive"
    assert rig._counts["messages replayed"] == 0
    assert change(ros, Transition.TRANSITION_ACTIVATE)
    wait_for(lambda: rig._counts["messages replayed"] > 100, "the replay")
    assert change(ros, Transition.TRANSITION_DEACTIVATE)
    position = rig._player.position
    assert change(ros, Transition.TRANSITION_ACTIVATE)
    wait_for(lambda: rig._player.position > position, "the rest of the replay")
    assert change(ros, Transition.TRANSITION_DEACTIVATE)
    assert change(ros, Transition.TRANSITION_CLEANUP)
    assert rig._player is None
    assert state(ros) == "unconfigured"


def test_a_paced_replay_of_10_khz_blocks_loses_nothing(ros: Ros, recording: Path) -> None:
    heard: dict[str, list[Any]] = {
        "wrench_block": ros.collect(WrenchBlock, "rig/wrench_block", 10_000),
        "power_block": ros.collect(PowerBlock, "rig/power_block", 10_000),
    }
    rig = ros.make(RigNode, recording=str(recording), start_offset=4.0, autostart=False)
    for name in heard:
        wait_for(lambda name=name: ros.tester.count_publishers(ros.name(f"rig/{name}")), "discovery")
    assert change(ros, Transition.TRANSITION_CONFIGURE)
    assert change(ros, Transition.TRANSITION_ACTIVATE)
    wait_for(lambda: rig._player.finished, "the end")
    with open_recording(recording) as opened:
        begin, _ = opened.span_ns
        later = [m.topic for m in opened.messages(start_ns=begin + 4_000_000_000)]
    for name, blocks in heard.items():
        expected = later.count(f"/rig/{name}")
        wait_for(lambda blocks=blocks, expected=expected: len(blocks) == expected, f"all of {name}")
        assert expected > 350
        assert (np.diff([block.sequence for block in blocks]) == 100).all()
        assert blocks[0].sample_rate_hz == 10_000.0


def test_live_instruments_stream_are_told_of_and_recorded(ros: Ros, bench: Bench, tmp_path: Path) -> None:
    diagnostics = ros.collect(DiagnosticArray, "/diagnostics")
    heard: dict[str, list[Any]] = {
        "wrench_block": ros.collect(WrenchBlock, "rig/wrench_block"),
        "power_block": ros.collect(PowerBlock, "rig/power_block"),
        "airspeed": ros.collect(TwistWithCovarianceStamped, "rig/airspeed"),
    }
    rig = ros.make(RigNode, bench=str(bench.file), record_folder=str(tmp_path / "runs"))
    assert state(ros) == "active"
    for name, messages in heard.items():
        wait_for(lambda messages=messages: len(messages) > 3, name)
    assert heard["airspeed"][-1].twist.twist.linear.x == pytest.approx(3.5)
    assert ros.call(Trigger, "rig/tare").success
    assert rig._publisher.offset[0] == pytest.approx(0.1, abs=1e-3)
    name = f"{ros.name('rig')}: force"
    wait_for(lambda: (found := latest(diagnostics, name)) and float(values(found)["rate [Hz]"]) > 0, "a rate")
    status = latest(diagnostics, name)
    assert status is not None
    assert status.message == "streaming"
    told = values(status)
    assert told["instrument"] == "Simulated Net F/T"
    assert float(told["rate [Hz]"]) == pytest.approx(2000.0, rel=0.3)
    assert float(told["age [s]"]) < 1.0
    assert "loss [%]" in told
    wait_for(lambda: rig._live.recording.stat().st_size > 300_000, "some seconds of recording")
    answer = ros.call(EstimateUncertainty, "rig/estimate_uncertainty")  # of what is recorded so far
    assert answer.success, answer.message
    assert answer.estimate.flapping_frequency_mean == pytest.approx(12.0, abs=0.1)
    assert change(ros, Transition.TRANSITION_DEACTIVATE)
    (folder,) = (tmp_path / "runs").iterdir()
    with open_recording(folder) as recorded:
        assert not recorded.problems
        counts = {topic.name: topic.count for topic in recorded.topics.values()}
        raw = [m.data for m in recorded.messages(["/rig/wrench_block"])]
    assert counts["/rig/wrench_block"] >= len(heard["wrench_block"])
    assert len(raw) == counts["/rig/wrench_block"]
    assert min(counts.values()) > 3


def test_unplugging_is_an_error_state_and_no_crash(ros: Ros, bench: Bench, tmp_path: Path) -> None:
    diagnostics = ros.collect(DiagnosticArray, "/diagnostics")
    rig = ros.make(RigNode, bench=str(bench.file), record_folder=str(tmp_path / "runs"))
    wait_for(lambda: rig._counts["messages live"] > 20, "messages")
    bench.box.unplug()
    wait_for(lambda: state(ros) == "unconfigured", "the error state")
    name = f"{ros.name('rig')}: replay"
    wait_for(lambda: (s := latest(diagnostics, name)) and s.level == DiagnosticStatus.ERROR, "the diagnosis")
    status = latest(diagnostics, name)
    assert status is not None
    assert status.message.startswith("force: ")
    (folder,) = (tmp_path / "runs").iterdir()
    with open_recording(folder) as recorded:
        assert not recorded.problems  # what came until then is complete
    before = rig._counts["messages live"]
    bench.box.plug()
    assert change(ros, Transition.TRANSITION_CONFIGURE)
    assert change(ros, Transition.TRANSITION_ACTIVATE)
    wait_for(lambda: rig._counts["messages live"] > before + 20, "messages again")


def test_nobody_on_the_bench_is_said_and_can_be_tried_again(ros: Ros, tmp_path: Path) -> None:
    path = tmp_path / "bench.yaml"
    path.write_text("tunnel: {resource: 'TCPIP::127.0.0.1::1::SOCKET'}\n")
    diagnostics = ros.collect(DiagnosticArray, "/diagnostics")
    ros.make(RigNode, bench=str(path))
    assert state(ros) == "unconfigured"
    name = f"{ros.name('rig')}: replay"
    wait_for(lambda: (s := latest(diagnostics, name)) and "tunnel: TCPIP" in s.message, "the reason")
    assert not change(ros, Transition.TRANSITION_CONFIGURE)
