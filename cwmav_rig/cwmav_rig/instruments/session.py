# SPDX-License-Identifier: Apache-2.0
"""Several instruments at once: a thread each, one queue of messages, health of every one."""

from __future__ import annotations

import contextlib
import threading
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from cwmav_common import interfaces
from cwmav_common.errors import CwmavError
from cwmav_common.mcap_reader import Message
from cwmav_rig.instruments.protocol import Identity, Instrument, InstrumentError, Reading

JOIN = 5.0  # s
RATE_SPAN = 2.0  # s over which a rate is measured
RATE_OFF = 0.02  # relative difference to the expected rate that is remarked
MOST_WAITING = 20_000  # messages; when nobody takes them the oldest are dropped and counted


@dataclass(frozen=True)
class InstrumentHealth:
    """State of one instrument.

    Attributes
    ----------
    state
        ``closed``, ``open``, ``streaming`` or ``error``.
    message
        What is wrong, empty otherwise.
    received, lost, dropped
        Samples received, samples known to be missing, messages that nobody took in time.
    rate, expected_rate
        Samples per second of late and as it should be; 0 where not known.
    age
        Seconds since the last reading; NaN before the first.
    """

    name: str
    state: str
    message: str
    identity: str
    received: int
    lost: int
    dropped: int
    rate: float
    expected_rate: float
    age: float

    @property
    def level(self) -> str:
        """Give ``ok``, ``warn`` or ``error``."""
        if self.state == "error":
            return "error"
        share = self.lost / max(self.received + self.lost, 1)
        off = self.expected_rate > 0.0 < self.rate and abs(self.rate / self.expected_rate - 1.0) > RATE_OFF
        return "warn" if self.dropped or share > 0.01 or off else "ok"


class _Runner:
    """One instrument in its thread."""

    def __init__(self, instrument: Instrument, session: Session) -> None:
        self.instrument, self._session = instrument, session
        self.identity: Identity | None = None
        self.state, self.error = "closed", ""
        self.received = self.lost = self.dropped = 0
        self._recent: deque[tuple[float, int]] = deque()
        self._latest = float("nan")
        self._begun = 0.0
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    def open(self) -> Identity:
        self.identity = self.instrument.open()
        self.state, self.error = "open", ""
        return self.identity

    def start(self) -> None:
        self._stop.clear()
        self._recent.clear()
        self._latest, self._begun = float("nan"), time.monotonic()
        self.instrument.start()
        self.state = "streaming"
        name = f"instrument {self.instrument.name}"
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        self._stop.set()
        if self._thread is not None:
            self._thread.join(JOIN)
            self._thread = None
        with contextlib.suppress(Exception):
            self.instrument.stop()
        if self.state == "streaming":
            self.state = "open"

    def close(self) -> None:
        self.stop()
        with contextlib.suppress(Exception):
            self.instrument.close()
        if self.state != "error":
            self.state = "closed"

    def _run(self) -> None:
        try:
            while not self._stop.is_set():
                readings = self.instrument.read()
                if readings:
                    self._take(readings)
                elif self._silence() > self.instrument.stall:
                    raise InstrumentError(f"{self.instrument.name}: nothing for {self.instrument.stall:g} s")
        except CwmavError as error:
            self._fail(str(error))
        except Exception as error:  # a defect of a driver must not take the others down
            self._fail(f"{self.instrument.name}: {type(error).__name__}: {error}")

    def _take(self, readings: Sequence[Reading]) -> None:
        now = time.monotonic()
        for reading in readings:
            data = interfaces.serialise(reading.message, reading.type_name)
            self.received += reading.samples
            self.lost += reading.lost
            self._recent.append((now, reading.samples))
            message = Message(reading.topic, reading.type_name, time.time_ns(), data)
            self.dropped += self._session.put(message)
        self._latest = now
        while self._recent and self._recent[0][0] < now - RATE_SPAN:
            self._recent.popleft()

    def _fail(self, message: str) -> None:
        if not self._stop.is_set():
            self.state, self.error = "error", message

    def _silence(self) -> float:
        return time.monotonic() - (self._begun if self._latest != self._latest else self._latest)

    def health(self) -> InstrumentHealth:
        recent = list(self._recent)
        span = recent[-1][0] - recent[0][0] if len(recent) > 1 else 0.0
        rate = sum(samples for _, samples in recent[1:]) / span if span > 0.2 * RATE_SPAN else 0.0
        return InstrumentHealth(
            name=self.instrument.name,
            state=self.state,
            message=self.error,
            identity=self.identity.name if self.identity is not None else "",
            received=self.received,
            lost=self.lost,
            dropped=self.dropped,
            rate=rate,
            expected_rate=self.instrument.rate,
            age=time.monotonic() - self._latest,
        )


class Session:
    """Instruments that are opened, started and stopped together.

    Parameters
    ----------
    instruments
        At least one; their names must differ.
    """

    def __init__(self, instruments: Sequence[Instrument]) -> None:
        self._queue: deque[Message] = deque()
        self._lock = threading.Lock()
        self._runners = [_Runner(instrument, self) for instrument in instruments]

    def open(self) -> dict[str, Identity]:
        """Open and identify all, by name; when one fails, all are closed again.

        Raises
        ------
        InstrumentError
            The first that failed.
        """
        try:
            return {runner.instrument.name: runner.open() for runner in self._runners}
        except CwmavError:
            self.close()
            raise

    def start(self) -> None:
        """Begin to stream; when one fails, all are stopped again; raises InstrumentError."""
        try:
            for runner in self._runners:
                runner.start()
        except CwmavError:
            self.stop()
            raise

    def take(self) -> list[Message]:
        """Give what came since the last call, in the order of arrival."""
        with self._lock:
            found = list(self._queue)
            self._queue.clear()
        return found

    def put(self, message: Message) -> int:
        """Queue a message; give how many old ones had to be dropped for it."""
        with self._lock:
            self._queue.append(message)
            if len(self._queue) <= MOST_WAITING:
                return 0
            self._queue.popleft()
            return 1

    def health(self) -> list[InstrumentHealth]:
        """Give the state of every instrument."""
        return [runner.health() for runner in self._runners]

    @property
    def failed(self) -> str:
        """What went wrong with those that are in error; empty when all are well."""
        return "; ".join(runner.error for runner in self._runners if runner.state == "error")

    def stop(self) -> None:
        """Stop streaming; what was queued can still be taken."""
        for runner in self._runners:
            runner.stop()

    def close(self) -> None:
        """Stop and disconnect."""
        for runner in self._runners:
            runner.close()
