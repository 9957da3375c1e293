# SPDX-License-Identifier: Apache-2.0
"""Oscilloscope by SCPI: voltage and current of every capture as one block."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cwmav_rig.instruments.messages import power_block
from cwmav_rig.instruments.protocol import Identity, InstrumentError, Reading
from cwmav_rig.instruments.scpi import Scpi
from cwmav_rig.instruments.settings import OscilloscopeSettings

Array = NDArray[np.float64]
WAIT = 0.1  # s
PAUSE = 0.005  # s between looks whether a capture is complete


@dataclass(frozen=True)
class Scaling:
    """How raw codes become volts and times: ``(code - reference - origin) increment``."""

    step: float
    increment: float
    origin: float
    reference: float

    def volts(self, codes: Array) -> Array:
        """Turn codes into volts."""
        return np.asarray((codes - self.reference - self.origin) * self.increment)


def read_scaling(text: str, name: str) -> Scaling:
    """Read the ten numbers of a waveform preamble.

    They are format, type, points, count, x increment, x origin, x reference, y increment, y origin,
    y reference, as Keysight and Rigol send them.

    Raises
    ------
    InstrumentError
        They are fewer, no numbers, or give no time step.
    """
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != 10 or not numbers[4] > 0.0:
        raise InstrumentError(f"{name}: preamble {text[:80]!r}; expected ten numbers, the fifth above 0")
    return Scaling(numbers[4], numbers[7], numbers[8], numbers[9])


class Oscilloscope:
    """Voltage and current from two channels."""

    def __init__(self, settings: OscilloscopeSettings) -> None:
        self.name, self.stall, self.rate = "oscilloscope", settings.stall, 0.0
        self._settings = settings
        self._scpi = Scpi(self.name, settings.resource, settings.backend)
        self._armed_ns = 0
        self._zero_ns: int | None = None
        self._next = 0

    def open(self) -> Identity:
        """Connect, identify, set up."""
        self._scpi.open()
        answer = self._scpi.identify("*IDN?", self._settings.identify)
        for command in self._settings.setup:
            self._scpi.tell(command)
        return Identity(answer, {"resource": self._settings.resource})

    def start(self) -> None:
        """Arm the first capture; sample numbers begin at zero."""
        self._zero_ns, self._next = None, 0
        self._arm()

    def read(self) -> list[Reading]:
        """Give the capture if it is complete, and arm the next one."""
        s = self._settings
        end = time.monotonic() + WAIT
        while s.ready and s.ready_answer not in self._scpi.ask(s.ready):
            if time.monotonic() > end:
                return []
            time.sleep(PAUSE)
        done_ns = time.time_ns()
        voltage, step = self._channel(s.voltage_channel)
        current, other = self._channel(s.current_channel)
        if len(voltage) != len(current) or step != other:
            raise InstrumentError(
                f"{self.name}: channels {s.voltage_channel} and {s.current_channel} gave {len(voltage)} and"
                f" {len(current)} points, {step:g} and {other:g} s apart; they must agree"
            )
        begin_ns = max(self._armed_ns, done_ns - round(len(voltage) * step * 1e9))
        self._arm()
        return [self._block(begin_ns, step, s.voltage_gain * voltage, s.current_gain * current)]

    def _block(self, begin_ns: int, step: float, voltage: Array, current: Array) -> Reading:
        self.rate = 1.0 / step
        if self._zero_ns is None:
            self._zero_ns = begin_ns
        first = max(self._next, round((begin_ns - self._zero_ns) * 1e-9 / step))
        lost, self._next = first - self._next, first + len(voltage)
        return power_block(begin_ns, self.rate, first, voltage, current, lost=lost)

    def _channel(self, channel: int) -> tuple[Array, float]:
        s = self._settings
        if s.source:
            self._scpi.tell(s.source.format(channel=channel))
        scaling = read_scaling(self._scpi.ask(s.preamble.format(channel=channel)), self.name)
        values = np.array(self._scpi.numbers(s.waveform.format(channel=channel), s.data_format))
        return (values if s.data_format == "ascii" else scaling.volts(values)), scaling.step

    def _arm(self) -> None:
        self._armed_ns = time.time_ns()
        if self._settings.arm:
            self._scpi.tell(self._settings.arm)

    def stop(self) -> None:
        """Nothing streams by itself."""

    def close(self) -> None:
        """Disconnect."""
        self._scpi.close()
