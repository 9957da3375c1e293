# SPDX-License-Identifier: Apache-2.0
"""Speed sensor of the wind tunnel that is asked at a steady rate."""

from __future__ import annotations

import math
import time

from cwmav_rig.instruments.messages import airspeed
from cwmav_rig.instruments.protocol import Identity, InstrumentError, Reading
from cwmav_rig.instruments.scpi import Scpi
from cwmav_rig.instruments.settings import TunnelSettings

WAIT = 0.1  # s
MOST_BAD = 10  # answers in a row that are no numbers


class Tunnel:
    """Airspeed by query."""

    def __init__(self, settings: TunnelSettings) -> None:
        self.name, self.stall, self.rate = "tunnel", settings.stall, settings.rate
        self._settings = settings
        self._scpi = Scpi(self.name, settings.resource, settings.backend, settings.line_end)
        self._due = 0.0
        self._bad = 0

    def open(self) -> Identity:
        """Connect and identify."""
        self._scpi.open()
        s = self._settings
        answer = self._scpi.identify(s.identify_query, s.identify) if s.identify_query else s.resource
        return Identity(answer, {"resource": s.resource})

    def start(self) -> None:
        """Begin to ask."""
        self._due, self._bad = time.monotonic(), 0

    def read(self) -> list[Reading]:
        """Ask when it is time; an answer that is no number is a lost reading."""
        wait = self._due - time.monotonic()
        if wait > 0.0:
            time.sleep(min(wait, WAIT))
            if wait > WAIT:
                return []
        self._due = max(self._due + 1.0 / self.rate, time.monotonic() - 1.0 / self.rate)
        asked = time.time_ns()
        answer = self._scpi.ask(self._settings.query)
        stamp = (asked + time.time_ns()) // 2
        value = _number(answer)
        if value is None:
            self._bad += 1
            if self._bad >= MOST_BAD:
                raise InstrumentError(
                    f"tunnel: {MOST_BAD} answers without a number, the last {answer[:40]!r}"
                )
            return []
        self._bad = 0
        return [airspeed(stamp, self._settings.gain * value, abs(self._settings.gain) * self._settings.std)]

    def stop(self) -> None:
        """Nothing streams by itself."""

    def close(self) -> None:
        """Disconnect."""
        self._scpi.close()


def _number(answer: str) -> float | None:
    """Read the first word of an answer, such as ``3.512 m/s``."""
    try:
        value = float(answer.split(",")[0].split()[0])
    except (ValueError, IndexError):
        return None
    return value if math.isfinite(value) else None
