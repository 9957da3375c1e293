# SPDX-License-Identifier: Apache-2.0
"""An oscilloscope and a tunnel sensor on the loopback: SCPI over a plain TCP socket."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SCOPE, TUNNEL = "Simulated,Scope,0,1.0", "Simulated,Tunnel,0,1.0"
RANGES = {1: 5.12, 2: 0.1024}  # V full scale, at 8 bits
RATE, POINTS = 10_000.0, 1000
SHUNT = 0.1  # ohm


class SimulatedScpi:
    """Answers the default queries of oscilloscope and tunnel sensor while it is entered.

    Parameters
    ----------
    signals
        Voltage [V] and current [A] at times (n,) [s] since the start.
    speed
        Airspeed [m/s] at a time [s], as text so that it can also answer nonsense.
    identity
        Answer to ``*IDN?``.
    """

    def __init__(
        self,
        signals: Callable[[Array], tuple[Array, Array]] | None = None,
        speed: Callable[[float], str] = lambda t: "3.500",
        identity: str = SCOPE,
    ) -> None:
        self._signals = signals or _flapping
        self._speed, self._identity = speed, identity
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.settimeout(0.05)
        self._begun, self._armed, self._channel = time.monotonic(), 0.0, 1
        self._stopped = threading.Event()
        self._connection: socket.socket | None = None
        self._thread = threading.Thread(target=self._serve, daemon=True)

    @property
    def resource(self) -> str:
        """VISA name of the socket."""
        return f"TCPIP::127.0.0.1::{self._listener.getsockname()[1]}::SOCKET"

    def unplug(self) -> None:
        """Cut the connection and answer nobody any more."""
        self._stopped.set()
        if self._connection is not None:
            with contextlib.suppress(OSError):
                self._connection.shutdown(socket.SHUT_RDWR)

    def __enter__(self) -> SimulatedScpi:
        self._thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: Any, trace: TracebackType | None) -> None:
        self.unplug()
        self._thread.join(5.0)
        self._listener.close()

    def _serve(self) -> None:
        while not self._stopped.is_set():
            with contextlib.suppress(TimeoutError):
                self._connection, _ = self._listener.accept()
                with contextlib.suppress(OSError), self._connection:
                    self._talk(self._connection)

    def _talk(self, connection: socket.socket) -> None:
        connection.settimeout(0.05)
        held = b""
        while not self._stopped.is_set():
            try:
                part = connection.recv(4096)
            except TimeoutError:
                continue
            if not part:
                return
            *lines, held = (held + part).split(b"\n")
            for line in lines:
                answer = self._answer(line.decode().strip())
                if answer is not None:
                    connection.sendall(answer + b"\n")

    def _answer(self, command: str) -> bytes | None:
        if command.startswith(":WAV:SOUR CHAN"):
            self._channel = int(command[14:])
            return None
        if command == ":SINGLE":
            self._armed = time.monotonic()
            return None
        answers: dict[str, Callable[[], bytes]] = {
            "*IDN?": lambda: self._identity.encode(),
            ":TRIG:STAT?": lambda: b"STOP" if time.monotonic() > self._armed + POINTS / RATE else b"RUN",
            ":WAV:PRE?": self._preamble,
            ":WAV:DATA?": self._waveform,
            "MEAS:SPEED?": lambda: self._speed(time.monotonic() - self._begun).encode(),
        }
        return answers[command]() if command in answers else None

    def _preamble(self) -> bytes:
        return f"0,0,{POINTS},1,{1.0 / RATE},0,0,{RANGES[self._channel] / 256.0},0,0".encode()

    def _waveform(self) -> bytes:
        time_axis = self._armed - self._begun + np.arange(POINTS) / RATE
        voltage, current = self._signals(time_axis)
        values = voltage if self._channel == 1 else SHUNT * current
        codes = np.clip(np.round(values / RANGES[self._channel] * 256.0), 0, 255).astype(np.uint8)
        return b"#9%09d" % len(codes) + codes.tobytes()


def _flapping(time_axis: Array) -> tuple[Array, Array]:
    """Four volts less what half an ohm takes, and a current that pulses twice per wing beat of 12 Hz."""
    current = 0.33 * (1.0 - 0.5 * np.cos(2.0 * np.pi * 24.0 * time_axis))
    return 4.0 - 0.5 * (current - 0.33), current
