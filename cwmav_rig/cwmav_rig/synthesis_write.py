# SPDX-License-Identifier: Apache-2.0
"""Put synthetic signals into a recording as the laboratory's recorder would, marked synthetic."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cwmav_common import interfaces
from cwmav_common.errors import InputError
from cwmav_common.mcap_reader import open_recording
from cwmav_common.mcap_writer import BagWriter
from cwmav_common.rosbag2 import write_rosbag2_metadata
from cwmav_common.settings import to_mapping
from cwmav_rig.airspeed import GAS_CONSTANT, ZERO_CELSIUS
from cwmav_rig.physics import sensor
from cwmav_rig.synthesis_settings import Synthesis

FORCE, TARE, VIEW = "/rig/wrench_block", "/rig/tare_block", "/rig/wrench"
POWER, ANGLE, WIND = "/rig/power_block", "/rig/angle_of_attack", "/rig/airspeed"
TRIGGER, TRUTH = "/rig/trigger", "/rig/truth"
AIR_TEMPERATURE, AIR_PRESSURE = "/rig/air_temperature", "/rig/air_pressure"
SENSOR_TEMPERATURE = "/rig/sensor_temperature"
METADATA = "cwmav"
LATENCY = 2e-3  # s from acquisition to receipt
WRENCH_BLOCK, POWER_BLOCK = "cwmav_msgs/msg/WrenchBlock", "cwmav_msgs/msg/PowerBlock"
WRENCH, SCALAR = "geometry_msgs/msg/WrenchStamped", "cwmav_msgs/msg/ScalarStamped"
TWIST, STRING = "geometry_msgs/msg/TwistWithCovarianceStamped", "std_msgs/msg/String"
TEMPERATURE, PRESSURE = "sensor_msgs/msg/Temperature", "sensor_msgs/msg/FluidPressure"
STATIC_PRESSURE = 101_325.0  # Pa
ROOM = 22.0  # deg C, of the sensor before the motor warms it


def topic_map_of(settings: Synthesis) -> dict[str, Any]:
    """Give the topic map that is stored in the recording, with what is known of the instruments."""
    ins, art = settings.instruments, settings.artefacts
    return {
        "force": {
            "topic": FORCE,
            "axis_lift": "z",
            "axis_thrust": "x",
            "frame": "body",
            "range_xy": ins.range_xy,
            "range_z": ins.range_z,
            "resolution": art.least_count,
            "gain_std": min(art.gain_error, 1.0),
            "zero_walk": art.bias_drift,
            "temperature": SENSOR_TEMPERATURE,
            "temperature_coefficient": [art.thermal] * 3,
        },
        "power": {"topic": POWER},
        "angle_of_attack": {"topic": ANGLE},
        "wind": {"topic": WIND, "temperature": AIR_TEMPERATURE, "pressure": AIR_PRESSURE},
        "trigger": {"topic": TRIGGER},
        "tare": "none" if settings.run == "wind_off" else {"topic": TARE},
    }


Entry = tuple[float, int, str, str, bytes]  # log time [s], order, topic, type, CDR


def write_recording(path: Path, settings: Synthesis, signals: Any) -> None:
    """Write all streams in order of log time.

    Raises
    ------
    InputError
        The place cannot be written to.
    """
    folder = not path.suffix
    target = path / f"{path.name}_0.mcap" if folder else path
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{target.parent}: cannot be made ({error.strerror or error})") from None
    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence(settings.seed).spawn(9)[8]))
    entries = sorted(_entries(settings, signals, rng), key=lambda entry: entry[:2])
    origin = round(settings.start_time * interfaces.NANOSECONDS)
    custom = {
        "synthetic": "true",
        "topic_map": json.dumps(topic_map_of(settings)),
        "settings": json.dumps(to_mapping(settings)),
        "truth": json.dumps(dataclasses.asdict(signals.truth)),
    }
    with BagWriter(target) as bag:
        for topic, type_name in _declared(settings):
            bag.add_topic(topic, type_name, latched=topic in (TARE, TRUTH))
        bag.add_metadata(METADATA, custom)
        for log_time, _, topic, type_name, cdr in entries:
            bag.write_raw(topic, type_name, cdr, origin + round(log_time * interfaces.NANOSECONDS))
    if folder:
        with open_recording(target) as recording:
            write_rosbag2_metadata(path, recording, {"cwmav.synthetic": "true"})


def _declared(settings: Synthesis) -> list[tuple[str, str]]:
    topics = [(TRUTH, STRING), (FORCE, WRENCH_BLOCK), (POWER, POWER_BLOCK)]
    topics += [] if settings.run == "wind_off" else [(TARE, WRENCH_BLOCK)]
    topics += [(ANGLE, SCALAR), (WIND, TWIST), (TRIGGER, SCALAR)]
    topics += [(AIR_TEMPERATURE, TEMPERATURE), (AIR_PRESSURE, PRESSURE), (SENSOR_TEMPERATURE, TEMPERATURE)]
    return topics + ([(VIEW, WRENCH)] if settings.instruments.view_rate else [])


def _entries(settings: Synthesis, signals: Any, rng: np.random.Generator) -> Iterator[Entry]:
    stamp = _Stamper(settings, signals, rng)
    truth = interfaces.new(STRING, data="SYNTHETIC " + json.dumps(dataclasses.asdict(signals.truth)))
    yield 0.0, 0, TRUTH, STRING, interfaces.serialise(truth, STRING)
    yield from _tares(settings, signals, stamp)
    yield from _force(settings, signals, stamp, rng)
    yield from _power(settings, signals, stamp)
    yield from _scalars(signals, stamp)
    yield from _wind(signals, stamp)
    yield from _trigger(settings, signals, stamp)
    yield from _surroundings(settings, stamp)


class _Stamper:
    """Header stamps in the instrument's clock with jitter, log times in true time."""

    def __init__(self, settings: Synthesis, signals: Any, rng: np.random.Generator) -> None:
        self.origin = round(settings.start_time * interfaces.NANOSECONDS)
        self.jitter = settings.artefacts.stamp_jitter
        self.clocks = signals.clocks
        self.rng = rng

    def header(self, reading: float, frame: str, *, exact: bool = False) -> Any:
        """Header for the reading [s] of an instrument's clock."""
        late = 0.0 if exact else self.jitter * float(self.rng.standard_normal())
        return interfaces.header(self.origin + round((reading + late) * interfaces.NANOSECONDS), frame)

    def received(self, clock: str, reading: float) -> float:
        """Log time [s]: when a reading of that clock arrived at the recorder."""
        return max(0.0, float(self.clocks[clock].true(np.float64(reading))) + LATENCY)


def _tares(settings: Synthesis, signals: Any, stamp: _Stamper) -> Iterator[Entry]:
    for order, (start, data) in enumerate(signals.tares):
        message = interfaces.new(
            WRENCH_BLOCK,
            header=stamp.header(start, "sensor", exact=True),
            sample_rate_hz=settings.instruments.force_rate,
            data=data.astype(np.float32).ravel(),
        )
        # A wind-off record is made apart from the run and put into its recording as a whole.
        log_time = 0.0 if start < 0.0 else settings.seconds
        yield log_time, 1 + order, TARE, WRENCH_BLOCK, interfaces.serialise(message, WRENCH_BLOCK)


def _force(settings: Synthesis, signals: Any, stamp: _Stamper, rng: np.random.Generator) -> Iterator[Entry]:
    art, ins = settings.artefacts, settings.instruments
    blocks = range(0, len(signals.force), ins.block)
    chance = rng.random((3, len(blocks)))
    every = max(1, round(ins.force_rate / ins.view_rate)) if ins.view_rate else 0
    lost = 0
    for k, first in enumerate(blocks):
        data = signals.force[first : first + ins.block].astype(np.float32)
        if chance[0, k] < art.lost_blocks:
            lost += len(data)
            continue
        data = _damaged(data, bool(chance[1, k] < art.nan_samples), bool(chance[2, k] < art.stuck))
        start = first / ins.force_rate
        late = art.time_jump if 2 * k >= len(blocks) else 0.0
        head = stamp.header(start + late, "sensor")
        message = interfaces.new(
            WRENCH_BLOCK,
            header=head,
            sample_rate_hz=ins.force_rate,
            sequence=first,
            lost=lost,
            overload=int(signals.overload[first : first + ins.block].sum()),
            data=data.ravel(),
        )
        lost = 0
        received = stamp.received("force", start + len(data) / ins.force_rate)
        yield received, 2, FORCE, WRENCH_BLOCK, interfaces.serialise(message, WRENCH_BLOCK)
        if every:
            yield from _view(first, data, every, ins.force_rate, stamp)


def _damaged(data: NDArray[np.float32], nan: bool, stuck: bool) -> NDArray[np.float32]:
    if stuck:
        data = np.repeat(data[:1], len(data), axis=0)
    if nan:
        data = data.copy()
        data[len(data) // 3 : len(data) // 3 + 5] = np.nan
    return data


def _view(first: int, data: NDArray[np.float32], every: int, rate: float, stamp: _Stamper) -> Iterator[Entry]:
    """Mean of every `every` samples, stamped in their middle."""
    for begin in range(0, len(data) - every + 1, every):
        f = data[begin : begin + every].mean(axis=0).astype(float)
        middle = (first + begin + 0.5 * (every - 1)) / rate
        message = interfaces.new(
            WRENCH,
            header=stamp.header(middle, "sensor", exact=True),
            wrench={
                "force": {"x": f[0], "y": f[1], "z": f[2]},
                "torque": {"x": f[3], "y": f[4], "z": f[5]},
            },
        )
        received = stamp.received("force", (first + len(data)) / rate)
        yield received, 3, VIEW, WRENCH, interfaces.serialise(message, WRENCH)


def _power(settings: Synthesis, signals: Any, stamp: _Stamper) -> Iterator[Entry]:
    ins = settings.instruments
    for first in range(0, len(signals.voltage), ins.block):
        part = slice(first, first + ins.block)
        message = interfaces.new(
            POWER_BLOCK,
            header=stamp.header(first / ins.power_rate, "scope"),
            sample_rate_hz=ins.power_rate,
            sequence=first,
            voltage=signals.voltage[part],
            current=signals.current[part],
        )
        received = stamp.received("power", (first + ins.block) / ins.power_rate)
        yield received, 4, POWER, POWER_BLOCK, interfaces.serialise(message, POWER_BLOCK)


def _scalars(signals: Any, stamp: _Stamper) -> Iterator[Entry]:
    message = interfaces.new(SCALAR, std=float("nan"))
    for reading, value in zip(signals.angle_stamps.tolist(), signals.angle.tolist(), strict=True):
        message.header = stamp.header(reading, "camera")
        message.value = value
        yield stamp.received("camera", reading), 5, ANGLE, SCALAR, interfaces.serialise(message, SCALAR)


def _wind(signals: Any, stamp: _Stamper) -> Iterator[Entry]:
    message = interfaces.new(TWIST)
    for reading, value in zip(signals.wind_stamps.tolist(), signals.wind.tolist(), strict=True):
        message.header = stamp.header(reading, "tunnel")
        message.twist.twist.linear.x = value
        yield stamp.received("tunnel", reading), 6, WIND, TWIST, interfaces.serialise(message, TWIST)


def _trigger(settings: Synthesis, signals: Any, stamp: _Stamper) -> Iterator[Entry]:
    """Give one edge per second of true time, stamped by every instrument; frame_id names its clock."""
    for edge in range(int(np.floor(settings.seconds)) + 1):
        for name, clock in signals.clocks.items():
            if settings.artefacts.trigger_loss and stamp.rng.random() < settings.artefacts.trigger_loss:
                continue
            reading = float(clock.shows(np.float64(edge)))
            message = interfaces.new(
                SCALAR, header=stamp.header(reading, name), value=float(edge), std=float("nan")
            )
            yield edge + LATENCY, 7, TRIGGER, SCALAR, interfaces.serialise(message, SCALAR)


def _surroundings(settings: Synthesis, stamp: _Stamper) -> Iterator[Entry]:
    """Give temperature and static pressure of the air, and the temperature of the sensor, once a second."""
    air = STATIC_PRESSURE / (GAS_CONSTANT * settings.air_density) - ZERO_CELSIUS
    for second in range(int(np.floor(settings.seconds)) + 1):
        heated = sensor.MOTOR_HEATING * (1.0 - np.exp(-second / sensor.HEATING_TIME))
        warm = ROOM + (heated if settings.run == "flapping" else 0.0)
        for topic, type_name, frame, values in (
            (AIR_TEMPERATURE, TEMPERATURE, "tunnel", {"temperature": air}),
            (AIR_PRESSURE, PRESSURE, "tunnel", {"fluid_pressure": STATIC_PRESSURE}),
            (SENSOR_TEMPERATURE, TEMPERATURE, "sensor", {"temperature": warm}),
        ):
            message = interfaces.new(
                type_name, header=stamp.header(float(second), frame, exact=True), **values
            )
            yield second + LATENCY, 8, topic, type_name, interfaces.serialise(message, type_name)
