# SPDX-License-Identifier: Apache-2.0
"""Which instruments are on the bench and how they are reached."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from cwmav_common.settings import load_yaml, setting


@dataclass(frozen=True)
class NetFtSettings:
    """Force sensor behind an ATI Net box."""

    host: str = setting("", "address of the Net box; empty: not on the bench")
    rate: float = setting(7000.0, "rate that the Net box is set to", unit="Hz", gt=0, le=10_000)
    block: int = setting(100, "samples per message", ge=1, le=10_000)
    rdt_port: int = setting(49152, "UDP port of the data", ge=1, le=65535)
    http_port: int = setting(80, "port of the web page with the calibration", ge=1, le=65535)
    stall: float = setting(
        1.0, "time without samples after which it counts as unplugged", unit="s", gt=0, le=60
    )


@dataclass(frozen=True)
class OscilloscopeSettings:
    """Oscilloscope that speaks SCPI; the defaults are the waveform commands of Keysight and Rigol.

    A capture is armed, waited for and read, again and again. What the scope does not see in between counts
    as lost; the analysis uses the flapping cycles that lie within captures, so they should last many.
    """

    resource: str = setting("", "VISA resource, such as TCPIP::192.168.1.5::INSTR; empty: not on the bench")
    backend: str = setting("@py", "VISA library; a file with @sim for a simulated one")
    identify: str = setting("", "text that the answer to *IDN? must hold; empty: any")
    voltage_channel: int = setting(1, "channel of the voltage", ge=1, le=8)
    current_channel: int = setting(2, "channel of the current or of its shunt", ge=1, le=8)
    voltage_gain: float = setting(1.0, "factor from the reading to volts")
    current_gain: float = setting(10.0, "factor from the reading to amperes; 10 for a shunt of 0.1 ohm")
    data_format: str = setting("byte", "how waveforms are sent", choices=("byte", "ascii"))
    setup: tuple[str, ...] = setting((), "commands sent once after opening")
    arm: str = setting(":SINGLE", "command that starts a capture; empty: none")
    ready: str = setting(":TRIG:STAT?", "query that tells whether the capture is complete; empty: do not ask")
    ready_answer: str = setting("STOP", "what it answers then")
    source: str = setting(":WAV:SOUR CHAN{channel}", "command that chooses the channel to read")
    preamble: str = setting(":WAV:PRE?", "query of the ten numbers that scale a waveform")
    waveform: str = setting(":WAV:DATA?", "query of the waveform")
    stall: float = setting(
        5.0, "time without a capture after which it counts as unplugged", unit="s", gt=0, le=600
    )


@dataclass(frozen=True)
class CameraSettings:
    """Camera that leaves pictures in a folder, or a video stream."""

    folder: str = setting("", "folder that pictures appear in; empty: none")
    stream: str = setting("", "number or address of a video stream; empty: none")
    rate: float = setting(
        0.0,
        "frames per second; with it the number in a picture's name gives its time",
        unit="Hz",
        ge=0,
        le=1e5,
    )
    stall: float = setting(
        5.0, "time without a frame after which it counts as unplugged", unit="s", gt=0, le=600
    )


@dataclass(frozen=True)
class TunnelSettings:
    """Speed sensor of the tunnel that is asked over VISA (serial line, network, USB)."""

    resource: str = setting("", "VISA resource, such as ASRL/dev/ttyUSB0::INSTR; empty: not on the bench")
    backend: str = setting("@py", "VISA library; a file with @sim for a simulated one")
    identify_query: str = setting("*IDN?", "query of what it is; empty: none")
    identify: str = setting("", "text that the answer must hold; empty: any")
    query: str = setting("MEAS:SPEED?", "query of the speed")
    gain: float = setting(1.0, "factor from the reading to m/s")
    std: float = setting(0.05, "standard uncertainty of one reading", unit="m/s", ge=0)
    rate: float = setting(10.0, "readings per second", unit="Hz", gt=0, le=200)
    line_end: str = setting("\n", "end of a line, both ways")
    stall: float = setting(
        2.0, "time without a reading after which it counts as unplugged", unit="s", gt=0, le=600
    )


@dataclass(frozen=True)
class BenchSettings:
    """Everything on the bench; what is not named is not there."""

    force: NetFtSettings = field(default_factory=NetFtSettings)
    oscilloscope: OscilloscopeSettings = field(default_factory=OscilloscopeSettings)
    camera: CameraSettings = field(default_factory=CameraSettings)
    tunnel: TunnelSettings = field(default_factory=TunnelSettings)
    topic_map: str = setting("", "topic map with calibration facts that is stored in recordings")


def load_bench(path: str | Path) -> BenchSettings:
    """Read the bench from YAML; see :func:`cwmav_common.settings.load_yaml` for the errors."""
    return load_yaml(BenchSettings, path)
