# SPDX-License-Identifier: Apache-2.0
"""How fast one-sample messages are read, against the decoder of mcap-ros2-support in the same run."""

import time

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from cwmav_common import interfaces
from cwmav_common.cdr import Columns
from cwmav_common.mcap_io import BagWriter, open_recording

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


@pytest.mark.bench
def test_columns_against_one_by_one(bag, capsys):
    by_columns(bag)  # compile
    begin = time.perf_counter()
    fast = by_columns(bag)
    middle = time.perf_counter()
    slow = one_by_one(bag)
    end = time.perf_counter()
    assert fast == pytest.approx(slow, abs=1e-6)
    rates = N / (middle - begin), N / (end - middle)
    with capsys.disabled():
        print(
            f"\n{rates[0]:.3g} messages/s in columns, {rates[1]:.3g} one by one: {rates[0] / rates[1]:.0f} x"
        )
