# SPDX-License-Identifier: Apache-2.0
"""Messages sorted into roles and decoded in whole columns, from a file or as they come."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cwmav_common.cdr import Columns, Group
from cwmav_common.errors import InputError
from cwmav_common.mcap_reader import Batch
from cwmav_rig import airspeed
from cwmav_rig.align import renumbered
from cwmav_rig.blocks import Assembler, Block, Series, series
from cwmav_rig.calibration import TareRun
from cwmav_rig.power import Deskew
from cwmav_rig.sources.tare import TareCollector
from cwmav_rig.topic_map import CAMERA_TYPES, TopicMap

if TYPE_CHECKING:
    from cwmav_rig.angle.reader import PictureReader

Array = NDArray[np.float64]
FORCE_NAMES = ("fx", "fy", "fz", "tx", "ty", "tz")
POWER_NAMES = ("voltage", "current", "power")
_STAMP = ("header.stamp.sec", "header.stamp.nanosec")
_WRENCH = tuple(f"wrench.{part}.{axis}" for part in ("force", "torque") for axis in "xyz")
_VALUE_PATHS: dict[str, tuple[str, ...]] = {
    "cwmav_msgs/msg/ScalarStamped": ("value",),
    "std_msgs/msg/Float64": ("data",),
    "geometry_msgs/msg/QuaternionStamped": tuple(f"quaternion.{axis}" for axis in "xyzw"),
    "geometry_msgs/msg/TwistStamped": ("twist.linear.x",),
    "geometry_msgs/msg/TwistWithCovarianceStamped": ("twist.twist.linear.x",),
    "sensor_msgs/msg/FluidPressure": ("fluid_pressure",),
    "sensor_msgs/msg/Temperature": ("temperature",),
    "sensor_msgs/msg/BatteryState": ("voltage", "current"),
}
BIN_RATE = 1000.0  # Hz, of force and power as kept
_SINGLE_SAMPLES = 4096  # single samples collected before they are assembled


@dataclass(frozen=True)
class RigData:
    """What was recorded, by role; times [s] from `origin_ns`. A role that was not recorded is None."""

    origin_ns: int
    force: Block | None = None
    power: Block | None = None
    angle: Series | None = None
    wind: Series | None = None
    edges: dict[str, dict[int, float]] = field(default_factory=dict)
    tares: tuple[TareRun, ...] = ()
    sensor_temperature: Series | None = None
    air_temperature: Series | None = None
    ambient_pressure: Series | None = None
    undecodable: int = 0


class RigReader:
    """Sorts batches of messages into roles; what was read so far can be had at any time.

    Parameters
    ----------
    origin_ns
        Time that counts as zero [ns].
    source
        Name of the recording, for messages.
    bin_rate
        Rate [Hz] at which force and power are kept.
    """

    def __init__(self, topic_map: TopicMap, origin_ns: int, source: str, bin_rate: float = BIN_RATE) -> None:
        self.map = topic_map
        self.origin = origin_ns
        self.path = source
        self.undecodable = 0
        self.bin_rate = bin_rate
        ranges = (*[topic_map.force.range_xy] * 2, topic_map.force.range_z, 0.0, 0.0, 0.0)
        self.force = Assembler(FORCE_NAMES, bin_rate, np.array(ranges))
        self.power = Assembler(POWER_NAMES, bin_rate)
        self._deskew = Deskew(topic_map.power.current_delay)
        self.singles: dict[str, list[tuple[Array, Array]]] = {}
        self.pending: dict[str, list[tuple[Array, Array]]] = {}
        self.edges: dict[str, dict[int, float]] = {}
        self.tares = TareCollector()
        self._unnumbered: set[str] = set()
        self.roles: dict[str, list[str]] = {}
        for role, topic in topic_map.topics().items():
            self.roles.setdefault(topic, []).append(role)
        self.pictures: PictureReader | None = None
        self._columns: dict[str, Columns] = {}

    def take(self, batch: Batch) -> None:
        """Decode one batch for every role of its topic."""
        type_name = batch.topic.type_name
        for role in self.roles[batch.topic.name]:
            if role == "force":
                self._force(batch)
            elif role == "power" and type_name == "cwmav_msgs/msg/PowerBlock":
                self._power_block(batch)
            elif role == "trigger":
                self._trigger(batch)
            elif role == "tare":
                self._tare(batch)
            elif role == "camera_info":
                self._picture_reader().take_calibration(batch)
            elif type_name in CAMERA_TYPES:
                self._picture_reader().take(batch)
            else:
                stamps, values = self._samples(batch, _VALUE_PATHS[type_name])
                self.singles.setdefault(role, []).append((stamps, values))

    def _picture_reader(self) -> PictureReader:
        if self.pictures is None:
            # OpenCV is large: it is loaded only where there are pictures.
            from cwmav_rig.angle.reader import PictureReader

            self.pictures = PictureReader(self.map.angle_of_attack, self.path)
        return self.pictures

    def data(self, *, last: bool = False) -> RigData:
        """Give what was read so far; after the `last` call no more can be read, and no copy is kept."""
        self._release("force", self.force, least=0)
        electrical = self._electrical()
        return RigData(
            origin_ns=self.origin,
            force=self.force.finish(last=last),
            power=self.power.finish(last=last) if electrical is None else electrical,
            angle=self._angle(),
            wind=self._wind(),
            edges=self._numbered_edges(),
            tares=self.tares.runs(),
            sensor_temperature=self._scalar("sensor_temperature", lambda values: values[:, 0]),
            air_temperature=self._scalar("temperature", lambda values: values[:, 0]),
            ambient_pressure=self._scalar("ambient_pressure", lambda values: values[:, 0]),
            undecodable=self.undecodable,
        )

    # --- decoding ----------------------------------------------------------------------------------------

    def _groups(self, batch: Batch, paths: tuple[str, ...]) -> Iterator[Group]:
        columns = self._columns.get(batch.topic.name)
        if columns is None or columns.paths != paths:
            columns = Columns(batch.topic.type_name, paths, batch.topic.schema or None)
            self._columns[batch.topic.name] = columns
        decoded = 0
        for group in columns.groups(batch.buffer, batch.starts, batch.lengths):
            decoded += len(group.rows)
            yield group
        self.undecodable += len(batch.starts) - decoded

    def _seconds(self, group: Group, batch: Batch) -> Array:
        """Header stamps from the origin [s]; log times for messages without a stamp."""
        logged = (batch.log_times[group.rows] - self.origin) * 1e-9
        if _STAMP[0] not in group.columns:
            return np.asarray(logged, np.float64)
        sec, nanosec = (group.columns[path].astype(np.int64) for path in _STAMP)
        stamps = sec * 1_000_000_000 + nanosec
        return np.asarray(np.where(stamps > 0, (stamps - self.origin) * 1e-9, logged), np.float64)

    def _samples(self, batch: Batch, paths: tuple[str, ...]) -> tuple[Array, Array]:
        stamped = batch.topic.type_name != "std_msgs/msg/Float64"
        wanted = (*_STAMP, *paths) if stamped else paths
        rows, stamps, values = [], [], []
        for group in self._groups(batch, wanted):
            rows.append(group.rows)
            stamps.append(self._seconds(group, batch))
            values.append(np.stack([group.columns[path] for path in paths], axis=1).astype(float))
        if not rows:
            return np.empty(0), np.empty((0, len(paths)))
        order = np.argsort(np.concatenate(rows), kind="stable")
        return np.concatenate(stamps)[order], np.concatenate(values)[order]

    def _force(self, batch: Batch) -> None:
        if batch.topic.type_name == "geometry_msgs/msg/WrenchStamped":
            self.pending.setdefault("force", []).append(self._samples(batch, _WRENCH))
            self._release("force", self.force, least=_SINGLE_SAMPLES)
            return
        paths = (*_STAMP, "sample_rate_hz", "sequence", "overload", "data")
        for group, rate, order in self._blocks(batch, paths):
            data = group.columns["data"][order].reshape(len(order), -1, 6)
            self.force.add_blocks(
                self._seconds(group, batch)[order],
                rate,
                group.columns["sequence"][order].astype(np.int64),
                group.columns["overload"][order].astype(np.int64),
                data,
            )

    def _power_block(self, batch: Batch) -> None:
        paths = (*_STAMP, "sample_rate_hz", "sequence", "voltage", "current")
        for group, rate, order in self._blocks(batch, paths):
            voltage = group.columns["voltage"][order].astype(float)
            current = group.columns["current"][order].astype(float)
            if voltage.shape != current.shape:
                raise InputError(f"{self.path}: {batch.topic.name} has blocks of unequal voltage and current")
            sequence = group.columns["sequence"][order].astype(np.int64)
            voltage, current = self._deskew.apply(voltage, current, sequence, rate)
            data = np.stack([voltage, current, voltage * current], axis=2)
            none = np.zeros(len(order), np.int64)
            self.power.add_blocks(self._seconds(group, batch)[order], rate, sequence, none, data)

    def _blocks(
        self, batch: Batch, paths: tuple[str, ...]
    ) -> Iterator[tuple[Group, float, NDArray[np.int64]]]:
        """Give runs of blocks with one layout and one rate, in the order they were recorded."""
        groups = list(self._groups(batch, paths))
        position = np.concatenate([group.rows for group in groups]) if groups else np.empty(0, np.int64)
        owner = np.repeat(np.arange(len(groups)), [len(group.rows) for group in groups])
        within = np.concatenate([np.arange(len(group.rows)) for group in groups]) if groups else position
        order = np.argsort(position, kind="stable")
        cuts = np.flatnonzero(np.diff(owner[order])) + 1
        for run in np.split(order, cuts):
            if not len(run):
                continue
            group = groups[int(owner[run[0]])]
            rows = within[run]
            rates = group.columns["sample_rate_hz"][rows]
            if not np.isfinite(rates).all() or (rates <= 0).any():
                raise InputError(
                    f"{self.path}: {batch.topic.name} has sample_rate_hz {rates.min():g}; it must be positive"
                )
            yield group, float(rates[0]), rows

    def _release(self, role: str, assembler: Assembler, least: int) -> None:
        held = self.pending.get(role, [])
        if held and sum(len(stamps) for stamps, _ in held) >= max(least, 1):
            stamps = np.concatenate([part for part, _ in held])
            values = np.concatenate([part for _, part in held])
            self.pending[role] = []
            assembler.add_samples(stamps, values)

    def _trigger(self, batch: Batch) -> None:
        header = batch.topic.type_name == "std_msgs/msg/Header"
        stamp = ("stamp.sec", "stamp.nanosec") if header else _STAMP
        frame = "frame_id" if header else "header.frame_id"
        paths = (*stamp, frame) if header else (*stamp, frame, "value")
        for group in self._groups(batch, paths):
            sec, nanosec = (group.columns[path].astype(np.int64) for path in stamp)
            seconds = (sec * 1_000_000_000 + nanosec - self.origin) * 1e-9
            for row, name in enumerate(group.columns[frame]):
                clock = name.tobytes().rstrip(b"\0").decode("utf-8", "replace")
                known = self.edges.setdefault(clock, {})
                number = len(known) if header else round(float(group.columns["value"][row]))
                known[number] = float(seconds[row])
                if header:
                    self._unnumbered.add(clock)

    def _numbered_edges(self) -> dict[str, dict[int, float]]:
        """Edges by clock; those that carry no number get that of the force sensor's edge they belong to."""
        reference = self.edges.get(self.map.force.clock, {})
        return {
            clock: renumbered(reference, edges) if clock in self._unnumbered else edges
            for clock, edges in self.edges.items()
        }

    def _tare(self, batch: Batch) -> None:
        if batch.topic.type_name == "geometry_msgs/msg/WrenchStamped":
            stamps, values = self._samples(batch, _WRENCH)
            for stamp, value in zip(stamps.tolist(), values, strict=True):
                self.tares.add(stamp, 0.0, value[None])
            return
        for group in self._groups(batch, (*_STAMP, "sample_rate_hz", "data")):
            rows = zip(
                self._seconds(group, batch).tolist(),
                group.columns["sample_rate_hz"].tolist(),
                group.columns["data"],
                strict=True,
            )
            for stamp, rate, data in rows:
                samples = data.reshape(-1, 6).astype(float)
                self.tares.add(stamp, len(samples) / rate if rate > 0 else 0.0, samples)

    # --- roles made of single samples ----------------------------------------------------------------------

    def _joined(self, role: str) -> tuple[Array, Array] | None:
        parts = [part for part in self.singles.get(role, []) if len(part[0])]
        if not parts:
            return None
        return np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])

    def _scalar(self, role: str, turn: Callable[[Array], Array]) -> Series | None:
        joined = self._joined(role)
        return None if joined is None else series(joined[0], turn(joined[1]))

    def _angle(self) -> Series | None:
        if self.pictures is not None:
            return self.pictures.series(self.origin)
        role = self.map.angle_of_attack

        def turn(values: Array) -> Array:
            angle = _pitch(values) if values.shape[1] == 4 else values[:, 0]
            return np.asarray(role.gain * angle + np.radians(role.offset_deg))

        return self._scalar("angle_of_attack", turn)

    def _wind(self) -> Series | None:
        role = self.map.wind
        temperature = self._scalar("temperature", lambda values: values[:, 0])
        joined = self._joined("wind")
        if joined is None:
            return None
        stamps, values = joined
        if role.temperature and temperature is None:
            raise InputError(f"{self.path}: topic {role.temperature} has no usable temperature")
        if self.types_pressure:
            if temperature is None:
                raise InputError(
                    f"{self.path}: wind is a pressure; map its air temperature as wind: {{temperature: ..}}"
                )
            celsius = np.interp(stamps, temperature.time, temperature.values)
            pressure = self._scalar("ambient_pressure", lambda found: found[:, 0])
            static = (
                np.interp(stamps, pressure.time, pressure.values)
                if pressure is not None
                else np.full(len(stamps), role.ambient_pressure)
            )
            speed = role.gain * airspeed.from_pitot(values[:, 0], celsius, static)
        else:
            speed = role.gain * values[:, 0]
        return series(stamps, speed)

    @property
    def types_pressure(self) -> bool:
        """True when the wind role is a pitot pressure."""
        return self.map.wind.topic in self._columns and (
            self._columns[self.map.wind.topic].type_name == "sensor_msgs/msg/FluidPressure"
        )

    def _electrical(self) -> Block | None:
        """Assemble voltage and current that came as single samples."""
        battery = self._joined("power")
        if battery is not None:
            stamps, values = battery
            # BatteryState counts current out of the battery as negative.
            voltage, current = values[:, 0], -values[:, 1]
        else:
            parts = self._joined("voltage"), self._joined("current")
            if parts[0] is None or parts[1] is None:
                return None
            stamps, voltage = parts[0][0], self.map.voltage.gain * parts[0][1][:, 0]
            behind = self.map.power.current_delay
            flow = series(parts[1][0] - behind, self.map.current.gain * parts[1][1][:, 0])
            current = np.interp(stamps, flow.time, flow.values)
        assembler = Assembler(POWER_NAMES, self.bin_rate)
        assembler.add_samples(stamps, np.stack([voltage, current, voltage * current], axis=1))
        return assembler.finish()


def _pitch(quaternion: Array) -> Array:
    """Pitch [rad], nose up positive, of quaternions (n, 4) x y z w in axes x forward, y left, z up."""
    x, y, z, w = quaternion.T / np.linalg.norm(quaternion, axis=1)
    # A turn about y (left) lowers the nose, hence the sign.
    return np.asarray(-np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0)))
