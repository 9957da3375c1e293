# SPDX-License-Identifier: Apache-2.0
"""Round trip of a service and throughput of force blocks between nodes of one process."""

import time
from array import array

import numpy as np
import pytest
from cwmav_msgs.msg import WrenchBlock
from cwmav_msgs.srv import EvaluateLift

from cwmav_sim.nodes.sim_node import SimNode
from support.ros_harness import Ros, wait_for

pytestmark = pytest.mark.bench

SAMPLES = 100  # of a block
BLOCKS = 3000


@pytest.fixture
def ros():
    corner = Ros()
    yield corner
    corner.close()


def test_round_trip_of_a_lift_request(benchmarks, ros):
    ros.make(SimNode)
    point = {"flapping_frequency": 12.0, "angle_of_attack": 0.26, "forward_velocity": 3.0}
    request = EvaluateLift.Request(fidelity="table")
    for name, value in point.items():
        setattr(request.point, name, value)
    client = ros.tester.create_client(EvaluateLift, ros.name("sim/evaluate_lift"))
    wait_for(client.service_is_ready, "sim/evaluate_lift")
    times = []
    for _ in range(200):
        begin = time.perf_counter()
        future = client.call_async(request)
        while not future.done():
            time.sleep(1e-5)
        times.append(time.perf_counter() - begin)
    assert future.result().success
    benchmarks.cost("round trip of EvaluateLift from the table, median", 1e3 * float(np.median(times)), "ms")
    benchmarks.cost("the same, 99 % of calls below", 1e3 * float(np.quantile(times, 0.99)), "ms")


def test_throughput_of_force_blocks(benchmarks, ros):
    received = ros.collect(WrenchBlock, "force")
    publisher = ros.tester.create_publisher(WrenchBlock, ros.name("force"), 1000)
    wait_for(lambda: publisher.get_subscription_count() == 1, "the subscription")
    values = np.random.default_rng(0).normal(size=(SAMPLES, 6)).astype(np.float32)
    block = WrenchBlock(sample_rate_hz=10_000.0, data=array("f", values.tobytes()))
    begin = time.perf_counter()
    for number in range(BLOCKS):
        block.sequence = number * SAMPLES
        publisher.publish(block)
        while number - len(received) > 500:
            time.sleep(1e-4)
    wait_for(lambda: len(received) == BLOCKS, "all blocks")
    seconds = time.perf_counter() - begin
    benchmarks.rate(
        f"force samples delivered in blocks of {SAMPLES}", 1e-3 * BLOCKS * SAMPLES / seconds, "kHz"
    )
