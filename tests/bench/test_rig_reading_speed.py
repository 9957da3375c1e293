# SPDX-License-Identifier: Apache-2.0
"""How fast one-sample messages are read, against the decoder of mcap-ros2-support in the same run."""

import time

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from cwmav_common import interfaces
from cwmav_common.cdr import Columns
from cwmav_common.mcap_reader import open_recording
from cwmav_common.mcap_writer import BagWriter
from cwmav_rig.analysis import analyse
from cwmav_rig.synthesis_settings import Synthesis
from cwmav_rig.synthesise import synthesise

KIND = "geometry_msgs/msg/WrenchStamped"
PATHS = ["header.stamp.sec", "header.stamp.nanosec", *(f"wrench.force.{axis}" for axis in "xyz")]
N = 100_000


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    path = tmp_path_factory.mktemp("speed") / "wrench.mcap"
    message = interfaces.new(KIND)
    rng = np.random.default_rng(0)
    values = np.round(rng.standard_normal(N), 3).tolist()
    with BagWriter(path) as writer:
        for k, value in enumerate(values):
            message.header = interfaces.header(k * 100_000, "sensor")
            message.wrench.force.z = value
            writer.write("/ft", KIND, message, k * 100_000)
    return path


def by_columns(path):
    total = 0.0
    with open_recording(path) as recording:
        for batch in recording.batches(["/ft"]):
            columns = Columns(KIND, PATHS, batch.topic.schema)
            for group in columns.groups(batch.buffer, batch.starts, batch.lengths):
                total += float(group.columns["wrench.force.z"].sum())
    return total


def one_by_one(path):
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        return sum(decoded.wrench.force.z for *_, decoded in reader.iter_decoded_messages(["/ft"]))


def by_rosbags(path):
    with AnyReader([path]) as reader:
        messages = reader.messages([c for c in reader.connections if c.topic == "/ft"])
        return sum(reader.deserialize(raw, link.msgtype).wrench.force.z for link, _, raw in messages)


@pytest.mark.bench
def test_columns_against_one_by_one(bag, benchmarks):
    by_columns(bag)  # compile
    begin = time.perf_counter()
    fast = by_columns(bag)
    middle = time.perf_counter()
    slow = one_by_one(bag)
    end = time.perf_counter()
    third = by_rosbags(bag)
    last = time.perf_counter()
    assert fast == pytest.approx(slow, abs=1e-6)
    assert fast == pytest.approx(third, abs=1e-6)
    benchmarks.rate(
        "WrenchStamped messages read", N / (middle - begin), "/s", N / (end - middle), "mcap-ros2-support"
    )
    benchmarks.rate("WrenchStamped messages read", N / (middle - begin), "/s", N / (last - end), "rosbags")


@pytest.mark.bench
@pytest.mark.parametrize("seconds", [10.0, 60.0, 300.0])
def test_analysis_grows_with_the_length(tmp_path, benchmarks, seconds):
    bag = tmp_path / "bag"
    synthesise(bag, Synthesis(seconds=seconds, seed=1))
    begin = time.perf_counter()
    report = analyse(bag)
    spent = time.perf_counter() - begin
    assert report.cycles > 11 * seconds
    benchmarks.rate(f"recording of {seconds:.0f} s analysed", seconds / spent, "times real time")
