# SPDX-License-Identifier: Apache-2.0
"""Fields of many messages at once, against the decoder of rosbags."""

import numpy as np
import pytest

from cwmav_common import interfaces
from cwmav_common.cdr import Columns, LayoutError
from cwmav_common.interfaces import new, serialise


def laid_out(payloads, gap=0):
    """Put payloads into one buffer, `gap` bytes apart."""
    starts, buffer = [], b""
    for payload in payloads:
        starts.append(len(buffer))
        buffer += payload + bytes(gap)
    return (
        np.frombuffer(buffer, np.uint8),
        np.array(starts, np.int64),
        np.array([len(p) for p in payloads], np.int64),
    )


def column(columns, path, payloads, **layout):
    values = {}
    for group in columns.groups(*laid_out(payloads, **layout)):
        values.update(zip(group.rows.tolist(), group.columns[path].tolist(), strict=True))
    return [values[k] for k in sorted(values)]


@pytest.mark.parametrize("gap", [0, 31])
def test_fields_behind_strings_of_any_length(gap):
    kind = "geometry_msgs/msg/WrenchStamped"
    frames = ["", "a", "sensor", "ab", "sensor", "abcdefghijk"]
    payloads = [
        serialise(new(kind, header=interfaces.header(k, f), wrench={"torque": {"y": k + 0.25}}), kind)
        for k, f in enumerate(frames)
    ]
    columns = Columns(kind, ["wrench.torque.y", "header.stamp.nanosec", "header.frame_id"])
    assert column(columns, "wrench.torque.y", payloads, gap=gap) == [k + 0.25 for k in range(6)]
    assert column(columns, "header.stamp.nanosec", payloads, gap=gap) == list(range(6))
    names = column(columns, "header.frame_id", payloads, gap=gap)
    assert [bytes(name).rstrip(b"\0").decode() for name in names] == frames


def test_messages_with_arrays_and_nested_lists_agree_with_the_general_decoder():
    kind = "sensor_msgs/msg/BatteryState"
    rng = np.random.default_rng(0)
    payloads = []
    for k in range(12):
        message = new(
            kind,
            header=interfaces.header(k, "x" * (k % 3)),
            voltage=float(k),
            current=-0.5 * k,
            cell_voltage=rng.random(k % 4),
            location="here"[: k % 4],
            serial_number=str(k),
        )
        payloads.append(serialise(message, kind))
    columns = Columns(kind, ["voltage", "current", "cell_voltage"])
    decoded = [interfaces.deserialise(p, kind) for p in payloads]
    assert column(columns, "current", payloads) == [float(m.current) for m in decoded]
    assert column(columns, "cell_voltage", payloads) == [m.cell_voltage.tolist() for m in decoded]


def test_blocks_come_as_rows():
    kind = "cwmav_msgs/msg/WrenchBlock"
    payloads = [
        serialise(new(kind, sample_rate_hz=1e4, data=np.arange(12) + 100 * k), kind) for k in range(3)
    ]
    (group,) = Columns(kind, ["data", "sample_rate_hz"]).groups(*laid_out(payloads))
    assert group.columns["data"].shape == (3, 12)
    assert group.columns["data"][2, 5] == 205.0
    assert group.columns["sample_rate_hz"].tolist() == [1e4] * 3


def test_big_endian_messages_are_read():
    kind = "std_msgs/msg/Float64"
    payloads = [
        b"\0\0\0\0" + np.array([1.5], ">f8").tobytes(),
        b"\0\1\0\0" + np.array([2.5], "<f8").tobytes(),
    ]
    assert column(Columns(kind, ["data"]), "data", payloads) == [1.5, 2.5]


def test_the_schema_in_the_recording_wins():
    text = "float64 offset\nfloat64 value\n"
    payload = b"\0\1\0\0" + np.array([7.0, 8.0]).tobytes()
    columns = Columns("lab_msgs/msg/Reading", ["value"], text)
    assert column(columns, "value", [payload]) == [8.0]


def test_cut_messages_are_left_out():
    kind = "std_msgs/msg/Float64"
    good = serialise(new(kind, data=1.0), kind)
    assert column(Columns(kind, ["data"]), "data", [good, good[:7], b"", b"\7\7\7\7", good]) == [1.0, 1.0]


def test_unknown_types_and_fields_are_named():
    with pytest.raises(LayoutError, match=r"lab_msgs/msg/Unknown"):
        Columns("lab_msgs/msg/Unknown", ["value"])
    with pytest.raises(LayoutError, match=r"no field 'nope'"):
        Columns("std_msgs/msg/Float64", ["nope"])
    with pytest.raises(LayoutError, match="schema of"):
        Columns("lab_msgs/msg/Broken", ["value"], "float64[ value")
