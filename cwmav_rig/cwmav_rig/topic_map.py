# SPDX-License-Identifier: Apache-2.0
"""Which topic of a recording plays which role on the rig.

A map is a YAML file, or stands in the recording's metadata, or is guessed from the message types when each
role has exactly one candidate.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from cwmav_common.errors import InputError
from cwmav_common.mcap_reader import Recording
from cwmav_common.settings import from_mapping, read_yaml, setting
from cwmav_rig.angle.settings import AngleSettings

AXES = ("x", "y", "z", "-x", "-y", "-z")
FORCE_TYPES = ("cwmav_msgs/msg/WrenchBlock", "geometry_msgs/msg/WrenchStamped")
POWER_TYPES = ("cwmav_msgs/msg/PowerBlock", "sensor_msgs/msg/BatteryState")
SCALAR_TYPES = ("cwmav_msgs/msg/ScalarStamped",)
ANGLE_TYPES = (
    "cwmav_msgs/msg/ScalarStamped",
    "std_msgs/msg/Float64",
    "geometry_msgs/msg/QuaternionStamped",
)
CAMERA_TYPES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
CAMERA_INFO_TYPES = ("sensor_msgs/msg/CameraInfo",)
WIND_TYPES = (
    "geometry_msgs/msg/TwistWithCovarianceStamped",
    "geometry_msgs/msg/TwistStamped",
    "sensor_msgs/msg/FluidPressure",
)
TEMPERATURE_TYPES = ("sensor_msgs/msg/Temperature",)
TRIGGER_TYPES = ("cwmav_msgs/msg/ScalarStamped", "std_msgs/msg/Header")
METADATA = "cwmav"


@dataclass(frozen=True)
class ForceRole:
    """Force sensor."""

    topic: str = setting("", "topic of the force; empty when not recorded")
    axis_lift: str = setting("z", "sensor axis that points up at zero angle of attack", choices=AXES)
    axis_thrust: str = setting("x", "sensor axis that points forward", choices=AXES)
    frame: str = setting(
        "body",
        "axes of the sensor: they pitch with the vehicle, or stay in the wind",
        choices=("body", "wind"),
    )
    pitch_deg: float = setting(
        0.0, "pitch of the sensor to the vehicle, nose up positive", unit="deg", ge=-180, le=180
    )
    pitch_std_deg: float = setting(0.5, "standard uncertainty of that pitch", unit="deg", ge=0, le=30)
    alignment: str = setting(
        "given",
        "where the pitch comes from: pitch_deg, or the weight in wind-off runs at several angles",
        choices=("given", "tare"),
    )
    gain: float = setting(1.0, "factor from the recorded to the true force", gt=0)
    gain_std: float = setting(0.01, "standard uncertainty of the gain, relative", ge=0, le=1)
    range_xy: float = setting(0.0, "range of the transverse force; 0: not known", unit="N", ge=0)
    range_z: float = setting(0.0, "range of the axial force; 0: not known", unit="N", ge=0)
    resolution: float = setting(0.00625, "least count of the force", unit="N", ge=0)
    zero_walk: float = setting(
        0.001, "random walk of the zero, for what it did between wind-off runs", unit="N/sqrt(s)", ge=0
    )
    temperature: str = setting("", "topic of the temperature of the sensor")
    temperature_coefficient: tuple[float, float, float] = setting(
        (0.0, 0.0, 0.0), "change of the zero of x, y, z with temperature", unit="N/K"
    )
    clock: str = setting("force", "name of the instrument's clock among the trigger edges")


@dataclass(frozen=True)
class PowerRole:
    """Electrical power in one topic."""

    topic: str = setting("", "topic that carries voltage and current; empty when not recorded")
    intermittent: bool = setting(
        False, "gaps are pauses between captures: the cycles that lie within captures are used"
    )
    current_delay: float = setting(
        0.0, "time by which the current channel lags the voltage channel", unit="s", ge=-0.01, le=0.01
    )
    voltage_gain_std: float = setting(0.01, "standard uncertainty of the voltage gain, relative", ge=0, le=1)
    current_gain_std: float = setting(0.01, "standard uncertainty of the current gain, relative", ge=0, le=1)
    current_zero_std: float = setting(0.002, "standard uncertainty of the current zero", unit="A", ge=0)
    phase_lag_deg: float | None = setting(
        None,
        "phase lag to the force, from a recording with trigger; aligns one without",
        unit="deg",
        ge=-180,
        le=180,
    )
    clock: str = setting("power", "name of the instrument's clock among the trigger edges")


@dataclass(frozen=True)
class ScalarRole:
    """One electrical quantity."""

    topic: str = setting("", "topic of the quantity; empty when not recorded")
    gain: float = setting(1.0, "factor from the recorded to the true value")


@dataclass(frozen=True)
class AngleRole:
    """Angle of attack."""

    topic: str = setting("", "topic of the angle; empty when not recorded")
    gain: float = setting(1.0, "factor from the recorded to the true angle; -1 when nose down is positive")
    offset_deg: float = setting(0.0, "added to the angle", unit="deg", ge=-180, le=180)
    zero_std_deg: float = setting(
        0.1, "standard uncertainty of the zero of the angle", unit="deg", ge=0, le=30
    )
    phase_lag_deg: float | None = setting(
        None,
        "phase lag to the force, from a recording with trigger; aligns one without",
        unit="deg",
        ge=-180,
        le=180,
    )
    clock: str = setting("camera", "name of the instrument's clock among the trigger edges")
    camera_info: str = setting("", "CameraInfo topic of camera frames; the one beside them when empty")
    camera: AngleSettings = field(default_factory=AngleSettings)


@dataclass(frozen=True)
class WindRole:
    """Airspeed, or a pitot pressure with the temperature beside it."""

    topic: str = setting("", "topic of the wind; empty when not recorded")
    gain: float = setting(1.0, "factor from the recorded to the true airspeed; -1 when it points downstream")
    gain_std: float = setting(
        0.01, "standard uncertainty of the gain with the blockage of the tunnel, relative", ge=0, le=1
    )
    temperature: str = setting("", "topic of the air temperature, for a pitot pressure and the air density")
    pressure: str = setting("", "topic of the static pressure (FluidPressure); ambient_pressure when empty")
    ambient_pressure: float = setting(101_325.0, "static pressure where it is not recorded", unit="Pa", gt=0)
    clock: str = setting("tunnel", "name of the instrument's clock among the trigger edges")


@dataclass(frozen=True)
class TriggerRole:
    """Edges of the synchroniser."""

    topic: str = setting("", "topic of the edges; frame_id names the instrument whose clock stamped the edge")


@dataclass(frozen=True)
class TopicMap:
    """Roles and topics; a role without a topic is not recorded."""

    force: ForceRole = field(default_factory=ForceRole)
    power: PowerRole = field(default_factory=PowerRole)
    voltage: ScalarRole = field(default_factory=ScalarRole)
    current: ScalarRole = field(default_factory=ScalarRole)
    angle_of_attack: AngleRole = field(default_factory=AngleRole)
    wind: WindRole = field(default_factory=WindRole)
    trigger: TriggerRole = field(default_factory=TriggerRole)
    tare: str = setting("", "none, where the zero and the weight are to stay in the force")
    tare_recordings: tuple[str, ...] = setting((), "recordings of wind-off runs")
    tare_topic: str = setting("", "topic of wind-off blocks within the recording")

    @property
    def tare_said(self) -> bool:
        """True when the map says where the tare is, or that there is none."""
        return bool(self.tare or self.tare_topic or self.tare_recordings)

    def topics(self) -> dict[str, str]:
        """Role and topic of everything named."""
        named = {
            "force": self.force.topic,
            "power": self.power.topic,
            "voltage": self.voltage.topic,
            "current": self.current.topic,
            "angle_of_attack": self.angle_of_attack.topic,
            "camera_info": self.angle_of_attack.camera_info,
            "wind": self.wind.topic,
            "temperature": self.wind.temperature,
            "ambient_pressure": self.wind.pressure,
            "sensor_temperature": self.force.temperature,
            "trigger": self.trigger.topic,
            "tare": self.tare_topic,
        }
        return {role: topic for role, topic in named.items() if topic}


_TYPES: dict[str, tuple[str, ...]] = {
    "force": FORCE_TYPES,
    "power": POWER_TYPES,
    "voltage": SCALAR_TYPES,
    "current": SCALAR_TYPES,
    "angle_of_attack": ANGLE_TYPES + CAMERA_TYPES,
    "camera_info": CAMERA_INFO_TYPES,
    "wind": WIND_TYPES,
    "temperature": TEMPERATURE_TYPES,
    "ambient_pressure": ("sensor_msgs/msg/FluidPressure",),
    "sensor_temperature": TEMPERATURE_TYPES,
    "trigger": TRIGGER_TYPES,
    "tare": FORCE_TYPES,
}


def load_topic_map(path: str | Path) -> TopicMap:
    """Read a topic map from YAML.

    Raises
    ------
    InputError
        The file cannot be read, a key or value is not allowed, or ``tare`` is missing although force is
        mapped.
    """
    topic_map = from_plain(read_yaml(path), str(path))
    if topic_map.force.topic and not topic_map.tare_said:
        raise InputError(
            f"{path}: 'tare' is missing; give the recordings of wind-off runs, {{topic: ..}} of wind-off"
            " blocks, or say 'none' (the weight is then part of the lift)"
        )
    base = Path(path).parent  # an absolute name stays what it is
    return replace(topic_map, tare_recordings=tuple(str(base / name) for name in topic_map.tare_recordings))


def from_plain(content: Mapping[str, Any], source: str) -> TopicMap:
    """Build a topic map from nested plain values; see :func:`load_topic_map`."""
    values = {**content, **_tare_values(content["tare"], source)} if "tare" in content else dict(content)
    return from_mapping(TopicMap, values, source)


def _tare_values(tare: Any, source: str) -> dict[str, Any]:
    """Read what a map says of the tare: none, a recording, several, or {topic: .., recordings: ..}."""
    if tare is None or tare == "none":
        return {"tare": "none"}
    if tare == "":
        return {"tare": ""}
    if isinstance(tare, str):
        return {"tare": "", "tare_recordings": (tare,)}
    if isinstance(tare, list) and tare and all(isinstance(name, str) for name in tare):
        return {"tare": "", "tare_recordings": tuple(tare)}
    if isinstance(tare, Mapping) and tare and set(tare) <= {"topic", "recordings"}:
        found = _tare_values(tare["recordings"], source) if "recordings" in tare else {"tare": ""}
        return {**found, "tare_topic": str(tare.get("topic", ""))}
    raise InputError(
        f"{source}: 'tare' is {tare!r}; allowed: none, a recording, a list of recordings, or {{topic: ..}}"
    )


def resolve(recording: Recording, topic_map: TopicMap | None) -> TopicMap:
    """Give the map to use: the one handed over, the recording's own, or the one its types suggest.

    Raises
    ------
    InputError
        A mapped topic is not in the recording or has a type that its role does not accept.
    """
    if topic_map is None:
        stored = recording.metadata.get(METADATA, {}).get("topic_map")
        topic_map = from_plain(_json(stored, recording), str(recording.path)) if stored else guess(recording)
    check(recording, topic_map)
    return _with_camera_info(recording, topic_map)


def camera_info_beside(recording: Recording, image_topic: str) -> str:
    """Find the CameraInfo of an image topic in the same or the parent namespace; empty when there is none."""
    namespace = image_topic.rpartition("/")[0]
    names = {t.name for t in recording.topics.values() if t.type_name in CAMERA_INFO_TYPES}
    likely = (f"{namespace}/camera_info", f"{namespace.rpartition('/')[0]}/camera_info")
    return next((name for name in likely if name in names), "")


def _with_camera_info(recording: Recording, topic_map: TopicMap) -> TopicMap:
    role = topic_map.angle_of_attack
    if not role.topic or role.camera_info or recording.topics[role.topic].type_name not in CAMERA_TYPES:
        return topic_map
    role = replace(role, camera_info=camera_info_beside(recording, role.topic))
    return replace(topic_map, angle_of_attack=role)


def check(recording: Recording, topic_map: TopicMap) -> None:
    """Refuse a map that does not fit the recording; see :func:`resolve`."""
    available = recording.topics
    for role, topic in topic_map.topics().items():
        if topic not in available:
            present = ", ".join(available) or "none"
            raise InputError(f"{recording.path}: no topic {topic!r} for role {role}; topics are: {present}")
        found = available[topic].type_name
        if found not in _TYPES[role]:
            allowed = ", ".join(_TYPES[role])
            raise InputError(f"{recording.path}: topic {topic} is {found}, role {role} accepts: {allowed}")
    if bool(topic_map.voltage.topic) != bool(topic_map.current.topic):
        raise InputError(f"{recording.path}: voltage and current must be mapped together")


def guess(recording: Recording) -> TopicMap:
    """Take each role whose accepted types occur on exactly one topic; blocks win over single samples."""
    topics = recording.topics

    def only(types: tuple[str, ...], word: str = "") -> str:
        for type_name in types:
            names = [t.name for t in topics.values() if t.type_name == type_name and t.count]
            named = [name for name in names if word and word in name.lower()]
            names = [name for name in names if "tare" not in name.lower()]
            if len(named) == 1 or len(names) == 1:
                return named[0] if len(named) == 1 else names[0]
        return ""

    tare = [t.name for t in topics.values() if t.type_name in FORCE_TYPES and "tare" in t.name.lower()]
    return TopicMap(
        force=ForceRole(topic=only(FORCE_TYPES)),
        power=PowerRole(topic=only(POWER_TYPES)),
        angle_of_attack=AngleRole(topic=only(ANGLE_TYPES, "angle")),
        wind=WindRole(topic=only(WIND_TYPES[:2])),
        tare_topic=tare[0] if len(tare) == 1 else "",
    )


def _json(text: str, recording: Recording) -> dict[str, Any]:
    try:
        content = json.loads(text)
    except json.JSONDecodeError as error:
        raise InputError(f"{recording.path}: topic map in the metadata is no JSON ({error})") from None
    if not isinstance(content, dict):
        raise InputError(f"{recording.path}: topic map in the metadata is no object")
    return content
