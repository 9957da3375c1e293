# SPDX-License-Identifier: Apache-2.0
"""MCAP files of any writer, whole or damaged."""

import random
import tracemalloc

import numpy as np
import pytest
from mcap.reader import make_reader

from cwmav_common import interfaces
from cwmav_common.errors import InputError
from cwmav_common.mcap_reader import open_recording
from cwmav_common.mcap_writer import BagWriter
from support.rig_recordings import WRITERS, rewrite, split

SCALAR = "cwmav_msgs/msg/ScalarStamped"


def write_scalars(path, n=200, **options):
    with BagWriter(path, **options) as bag:
        for k in range(n):
            message = interfaces.new(SCALAR, header=interfaces.header(k * 1000 + 1), value=float(k))
            bag.write("/a" if k % 2 else "/b", SCALAR, message, k * 1000)
        bag.add_metadata("about", {"key": "value"})
    return path


def everything(path):
    with open_recording(path) as recording:
        return [(m.topic, m.type_name, m.log_time_ns, m.data) for m in recording.messages()]


def test_what_was_written_is_read_and_indexed(tmp_path):
    path = write_scalars(tmp_path / "x.mcap")
    with open_recording(path) as recording:
        assert recording.indexed
        assert recording.problems == []
        assert {name: topic.count for name, topic in recording.topics.items()} == {"/a": 100, "/b": 100}
        assert recording.span_ns == (0, 199_000)
        assert recording.metadata == {"about": {"key": "value"}}
        values = [interfaces.deserialise(m.data, m.type_name).value for m in recording.messages()]
    assert values == [float(k) for k in range(200)]


def test_the_format_library_reads_our_files_with_profile_and_schemas(tmp_path):
    path = write_scalars(tmp_path / "x.mcap")
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        schemas = {channel.topic: schema for schema, channel, _ in reader.iter_messages()}
    assert schemas["/a"].encoding == "ros2msg"
    assert b"std_msgs/Header" in schemas["/a"].data
    assert b"float64 value" in schemas["/a"].data


@pytest.mark.parametrize("writer", WRITERS)
def test_files_of_other_writers_hold_the_same_messages(small_bag, tmp_path, writer):
    copy = rewrite(small_bag, tmp_path / "copy.mcap", **WRITERS[writer])
    assert everything(copy) == everything(small_bag)
    with open_recording(copy) as recording, open_recording(small_bag) as original:
        assert {n: t.count for n, t in recording.topics.items()} == {
            n: t.count for n, t in original.topics.items()
        }
        assert recording.span_ns == original.span_ns


def test_split_files_are_one_recording(small_bag, tmp_path):
    folder = split(small_bag, tmp_path / "bag", [0.2, 0.21, 0.7])
    assert everything(folder) == everything(small_bag)


def test_messages_of_overlapping_chunks_come_in_order_of_time(tmp_path):
    path = tmp_path / "x.mcap"
    times = random.Random(1).sample(range(10_000), 3000)
    with BagWriter(path, chunk_size=4000) as bag:
        for time in times:
            bag.write("/a", SCALAR, interfaces.new(SCALAR, value=float(time)), time)
    assert [entry[2] for entry in everything(path)] == sorted(times)


def test_a_range_of_time_and_a_choice_of_topics(tmp_path):
    path = write_scalars(tmp_path / "x.mcap", chunk_size=2000)
    with open_recording(path) as recording:
        found = list(recording.messages(["/a"], start_ns=10_000, end_ns=20_000))
    assert [m.log_time_ns for m in found] == [11_000, 13_000, 15_000, 17_000, 19_000]


def test_every_truncation_gives_a_beginning_and_says_so(tmp_path):
    whole = write_scalars(tmp_path / "x.mcap", n=40, chunk_size=500)
    data, complete = whole.read_bytes(), everything(whole)
    cut = tmp_path / "cut.mcap"
    saved = []
    for size in range(8, len(data), 29):
        cut.write_bytes(data[:size])
        with open_recording(cut) as recording:
            found = [(m.topic, m.type_name, m.log_time_ns, m.data) for m in recording.messages()]
            assert recording.problems, size
        assert found == complete[: len(found)]
        saved.append(len(found))
    assert saved == sorted(saved)
    assert saved[-1] >= 39


def test_flipped_bits_never_crash_and_never_change_a_message(tmp_path):
    whole = write_scalars(tmp_path / "x.mcap", n=60, chunk_size=800)
    data, complete = whole.read_bytes(), set(everything(whole))
    rng = np.random.default_rng(0)
    bad = tmp_path / "bad.mcap"
    losses = 0
    for _ in range(150):
        damaged = bytearray(data)
        position = int(rng.integers(8, len(data)))
        damaged[position] ^= 1 << int(rng.integers(8))
        bad.write_bytes(damaged)
        found = everything(bad)
        wrong = [entry for entry in found if (entry[2], entry[3]) not in {(e[2], e[3]) for e in complete}]
        assert not wrong
        losses += len(found) < 60
    assert losses


def test_random_bytes_after_the_magic_are_survived(tmp_path):
    rng = np.random.default_rng(1)
    path = tmp_path / "noise.mcap"
    for size in (0, 1, 9, 100, 5000):
        path.write_bytes(b"\x89MCAP0\r\n" + rng.bytes(size))
        with open_recording(path) as recording:
            assert list(recording.messages()) == []
            assert recording.problems


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "it is empty"),
        (b"SQLite format 3\0" + bytes(100), "SQLite"),
        (b"#ROSBAG V2.0\n", "ROS 1"),
        (b"hello, world, this is text", "starts with b'hello, w'"),
        (b"\x28\xb5\x2f\xfd" + bytes(20), "zstd"),
    ],
)
def test_what_is_no_mcap_is_named(tmp_path, content, said):
    path = tmp_path / "other.mcap"
    path.write_bytes(content)
    with pytest.raises(InputError, match="not an MCAP") as caught:
        open_recording(path)
    assert str(path) in str(caught.value)
    assert said in str(caught.value)


def test_missing_and_empty_places_are_named(tmp_path):
    with pytest.raises(InputError, match="no such recording"):
        open_recording(tmp_path / "nothing")
    with pytest.raises(InputError, match=r"neither metadata\.yaml nor an \.mcap"):
        open_recording(tmp_path)
    (tmp_path / "metadata.yaml").write_text(
        "rosbag2_bagfile_information: {storage_identifier: mcap, relative_file_paths: [gone.mcap]}"
    )
    with pytest.raises(InputError, match=r"gone\.mcap"):
        open_recording(tmp_path)
    (tmp_path / "metadata.yaml").write_text(
        "rosbag2_bagfile_information: {storage_identifier: sqlite3, relative_file_paths: [a.db3]}"
    )
    with pytest.raises(InputError, match="sqlite3"):
        open_recording(tmp_path)


def test_a_missing_part_of_a_split_recording_is_reported(small_bag, tmp_path):
    folder = split(small_bag, tmp_path / "bag", [0.5])
    (folder / "part_1.mcap").unlink()
    with open_recording(folder) as recording:
        assert any("part_1.mcap" in problem for problem in recording.problems)
        assert len(recording.files) == 1


def test_writing_refuses_what_is_wrong(tmp_path):
    with pytest.raises(InputError, match="cannot be written"):
        BagWriter(tmp_path / "no" / "x.mcap")
    with pytest.raises(InputError, match="none, lz4, zstd"):
        BagWriter(tmp_path / "x.mcap", compression="rar")
    with BagWriter(tmp_path / "x.mcap") as bag:
        bag.write("/a", SCALAR, interfaces.new(SCALAR), 0)
        with pytest.raises(InputError, match=r"/a carries cwmav_msgs/msg/ScalarStamped"):
            bag.write("/a", "std_msgs/msg/Float64", interfaces.new("std_msgs/msg/Float64"), 0)
        with pytest.raises(InputError, match="unknown message type"):
            bag.write("/b", "std_msgs/msg/Nothing", None, 0)


def test_new_messages_take_mappings_and_refuse_unknown_fields():
    message = interfaces.new(
        "geometry_msgs/msg/WrenchStamped",
        header=interfaces.header(2_500_000_001, "ft"),
        wrench={"force": {"z": 2.0}},
    )
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (2, 500_000_001)
    assert message.wrench.force.z == 2.0
    assert message.wrench.torque.x == 0
    block = interfaces.new("cwmav_msgs/msg/WrenchBlock", data=[1, 2, 3])
    assert block.data.dtype == np.float32
    with pytest.raises(InputError, match="unknown field 'nope'"):
        interfaces.new(SCALAR, nope=1)
    with pytest.raises(InputError, match="are no cwmav_msgs"):
        interfaces.deserialise(b"\0\1\0\0abc", SCALAR)


def test_only_one_piece_is_in_memory_at_a_time(tmp_path):
    kind = "cwmav_msgs/msg/WrenchBlock"
    rng = np.random.default_rng(0)
    path = tmp_path / "long.mcap"
    with BagWriter(path, chunk_size=100_000) as bag:
        for k in range(200):
            bag.write("/ft", kind, interfaces.new(kind, data=rng.standard_normal(6000)), k)
    assert path.stat().st_size > 4_000_000
    with open_recording(path) as recording:
        next(iter(recording.batches()))  # whatever is imported or compiled once
        tracemalloc.start()
        try:
            assert sum(len(batch.starts) for batch in recording.batches()) == 200
            assert sum(1 for _ in recording.messages()) == 200
            peak = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
    assert peak < 1_000_000
