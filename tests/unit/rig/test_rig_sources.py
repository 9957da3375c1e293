# SPDX-License-Identifier: Apache-2.0
"""Recordings in the types that other people use give what our own give."""

import numpy as np
import pytest

from cwmav_common import interfaces
from cwmav_common.errors import InputError
from cwmav_rig.airspeed import density, from_pitot
from cwmav_rig.analysis import analyse
from cwmav_rig.topic_map import from_plain
from support.rig_recordings import scalars, stamp_ns, translate

FORCE, POWER = "/rig/wrench_block", "/rig/power_block"
ANGLE, WIND, TARE, TRIGGER = "/rig/angle_of_attack", "/rig/airspeed", "/rig/tare_block", "/rig/trigger"
MAP = {
    "force": {"topic": FORCE},
    "power": {"topic": POWER},
    "angle_of_attack": {"topic": ANGLE},
    "wind": {"topic": WIND},
    "trigger": {"topic": TRIGGER},
    "tare": {"topic": TARE},
}


def keep(message, decoded):
    return [(message.topic, message.type_name, decoded)]


def block_stamps(decoded, n):
    return stamp_ns(decoded) + np.rint(np.arange(n) * 1e9 / decoded.sample_rate_hz).astype(np.int64)


def wrench_stamped(message, decoded):
    if message.topic != FORCE:
        return keep(message, decoded)
    kind = "geometry_msgs/msg/WrenchStamped"
    rows = decoded.data.reshape(-1, 6).astype(float).tolist()
    return [
        (
            "/ft",
            kind,
            interfaces.new(
                kind,
                header=interfaces.header(stamp, "sensor"),
                wrench={
                    "force": dict(zip("xyz", row[:3], strict=True)),
                    "torque": dict(zip("xyz", row[3:], strict=True)),
                },
            ),
        )
        for stamp, row in zip(block_stamps(decoded, len(rows)).tolist(), rows, strict=True)
    ]


def two_scalars(message, decoded):
    if message.topic != POWER:
        return keep(message, decoded)
    stamps = block_stamps(decoded, len(decoded.voltage))
    voltage = scalars("/v", decoded.voltage.astype(float), stamps)
    return [*voltage, *scalars("/i", 1000.0 * decoded.current.astype(float), stamps)]


def battery(message, decoded):
    if message.topic != POWER:
        return keep(message, decoded)
    kind = "sensor_msgs/msg/BatteryState"
    pairs = zip(
        block_stamps(decoded, len(decoded.voltage)).tolist(),
        decoded.voltage.tolist(),
        decoded.current.tolist(),
        strict=True,
    )
    return [
        ("/battery", kind, interfaces.new(kind, header=interfaces.header(t), voltage=v, current=-i))
        for t, v, i in pairs
    ]


def angle_float(message, decoded):
    if message.topic != ANGLE:
        return keep(message, decoded)
    return [("/aoa", "std_msgs/msg/Float64", interfaces.new("std_msgs/msg/Float64", data=decoded.value))]


def angle_quaternion(message, decoded):
    if message.topic != ANGLE:
        return keep(message, decoded)
    kind = "geometry_msgs/msg/QuaternionStamped"
    half = -0.5 * decoded.value  # nose up is a negative turn about y, which points left
    quaternion = {"y": float(np.sin(half)), "w": float(np.cos(half))}
    return [("/pose", kind, interfaces.new(kind, header=decoded.header, quaternion=quaternion))]


def wind_twist(message, decoded):
    if message.topic != WIND:
        return keep(message, decoded)
    kind = "geometry_msgs/msg/TwistStamped"
    linear = {"x": -decoded.twist.twist.linear.x}
    return [("/wind", kind, interfaces.new(kind, header=decoded.header, twist={"linear": linear}))]


def wind_pitot(message, decoded):
    if message.topic != WIND:
        return keep(message, decoded)
    speed = decoded.twist.twist.linear.x
    pressure = 0.5 * float(density(18.0, 99_000.0)) * speed**2
    return [
        (
            "/pitot",
            "sensor_msgs/msg/FluidPressure",
            interfaces.new("sensor_msgs/msg/FluidPressure", header=decoded.header, fluid_pressure=pressure),
        ),
        (
            "/air",
            "sensor_msgs/msg/Temperature",
            interfaces.new("sensor_msgs/msg/Temperature", header=decoded.header, temperature=18.0),
        ),
    ]


def header_trigger(message, decoded):
    if message.topic != TRIGGER:
        return keep(message, decoded)
    return [("/edges", "std_msgs/msg/Header", decoded.header)]


CASES = {
    "one sample per message": (wrench_stamped, {"force": {"topic": "/ft"}}, 1e-4),
    "voltage and current apart": (
        two_scalars,
        {"power": None, "voltage": {"topic": "/v"}, "current": {"topic": "/i", "gain": 1e-3}},
        1e-4,
    ),
    "battery state": (battery, {"power": {"topic": "/battery"}}, 1e-4),
    "plain float with log time": (angle_float, {"angle_of_attack": {"topic": "/aoa"}}, 2e-2),
    "attitude": (angle_quaternion, {"angle_of_attack": {"topic": "/pose"}}, 1e-6),
    "wind pointing downstream": (wind_twist, {"wind": {"topic": "/wind", "gain": -1.0}}, 1e-6),
    "pitot": (
        wind_pitot,
        {"wind": {"topic": "/pitot", "temperature": "/air", "ambient_pressure": 99_000.0}},
        1e-6,
    ),
    "edges as headers": (header_trigger, {"trigger": {"topic": "/edges"}}, 1e-6),
}


@pytest.mark.parametrize("case", CASES)
def test_the_type_of_a_role_does_not_matter(small_bag, tmp_path, case):
    change, mapped, tolerance = CASES[case]
    copy = translate(small_bag, tmp_path / "copy.mcap", change)
    plain = {role: entry for role, entry in {**MAP, **mapped}.items() if entry is not None}
    found, expected = analyse(copy, from_plain(plain, "map")).to_json(), analyse(small_bag).to_json()
    for name in (
        "flapping_frequency_hz",
        "angle_of_attack_deg",
        "forward_velocity_m_s",
        "lift_n",
        "drag_n",
        "power_w",
    ):
        assert found[name]["mean"] == pytest.approx(expected[name]["mean"], rel=tolerance), name
        assert found[name]["std"] == pytest.approx(expected[name]["std"], rel=100 * tolerance), name
    assert found["clock_offsets_s"] == pytest.approx(expected["clock_offsets_s"])


def test_camera_frames_that_show_nothing_are_refused(small_bag, tmp_path):
    def frames(message, decoded):
        if message.topic != ANGLE:
            return keep(message, decoded)
        return [("/camera", "sensor_msgs/msg/Image", interfaces.new("sensor_msgs/msg/Image"))]

    copy = translate(small_bag, tmp_path / "copy.mcap", frames)
    report = analyse(copy, from_plain({**MAP, "angle_of_attack": {"topic": "/camera"}}, "map"))
    assert report.angle_of_attack is None
    assert report.lift is None  # it needs the angle
    (said,) = [problem for problem in report.problems if "angle_of_attack is refused" in problem]
    assert "100% of the angle_of_attack samples" in said
    assert "unreadable" in said


def test_pitot_speed():
    """0.5 rho U^2 at 15 C and standard pressure: rho = 1.225 kg/m3 (ISA)."""
    assert density(15.0, 101_325.0) == pytest.approx(1.225, rel=1e-3)
    assert from_pitot(np.array([7.503]), 15.0, 101_325.0)[0] == pytest.approx(3.5, rel=1e-3)
    assert from_pitot(np.array([-7.503]), 15.0, 101_325.0)[0] == pytest.approx(-3.5, rel=1e-3)
    with pytest.raises(InputError, match="map its air temperature"):
        raise_for_missing_temperature()


def raise_for_missing_temperature():
    from cwmav_common.mcap_reader import Batch, Topic
    from cwmav_rig.sources.reader import RigReader

    kind = "sensor_msgs/msg/FluidPressure"
    data = interfaces.serialise(interfaces.new(kind, fluid_pressure=7.5), kind)
    reader = RigReader(from_plain({"wind": {"topic": "/p"}}, "map"), 0, "x")
    reader.take(
        Batch(
            Topic("/p", kind, "", "cdr", 1),
            np.array([1]),
            np.frombuffer(data, np.uint8),
            np.array([0]),
            np.array([len(data)]),
        )
    )
    reader.data()
