# SPDX-License-Identifier: Apache-2.0
"""Nano17 or another ATI sensor behind a Net box: UDP stream by pynetft, blocks of samples out."""

from __future__ import annotations

import contextlib
import time
from collections import deque
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cwmav_common.errors import InputError
from cwmav_rig.instruments.messages import wrench_block
from cwmav_rig.instruments.protocol import Identity, InstrumentError, Reading
from cwmav_rig.instruments.settings import NetFtSettings

Array = NDArray[np.float64]

WAIT = 0.1  # s
QUEUE = 1 << 16  # samples that may wait for this program
WRAP = 1 << 32
MOST_RESTARTS, RESTART_SPAN = 20, 10.0  # more restarts within so many seconds are a defect
LATE = 1e-3  # share of a late arrival that is taken for a drift of the sensor's clock
_FORCE = {"N": 1.0, "kN": 1e3, "lbf": 4.4482216152605, "klbf": 4448.2216152605, "kgf": 9.80665}
_TORQUE = {
    "N-m": 1.0,
    "N-mm": 1e-3,
    "kN-m": 1e3,
    "lbf-in": 0.1129848290276,
    "lbf-ft": 1.3558179483314,
    "kgf-cm": 0.0980665,
}


class SampleClock:
    """Times of equally spaced samples from their numbers and the times they arrived at.

    A datagram may come late but never early, so the line is the lower edge of the arrivals: an early one
    moves it at once, late ones only by a thousandth, which follows the drift of the sensor's clock.
    """

    def __init__(self, rate: float) -> None:
        self._step = 1e9 / rate
        self._zero: float | None = None

    def at(self, number: int, arrived_ns: int) -> int:
        """Time [ns] of a sample."""
        zero = arrived_ns - number * self._step
        if self._zero is None or zero < self._zero:
            self._zero = zero
        else:
            self._zero += LATE * (zero - self._zero)
        return round(self._zero + number * self._step)

    def number(self, arrived_ns: int) -> int:
        """Give the number of the sample that arrives now, by the time alone."""
        return 0 if self._zero is None else round((arrived_ns - self._zero) / self._step)


class NetFt:
    """Force sensor behind a Net box.

    Parameters
    ----------
    settings
        Address, rate and block length.

    Raises
    ------
    InputError
        pynetft is not installed.
    """

    def __init__(self, settings: NetFtSettings) -> None:
        self.name, self.stall, self.rate = "force", settings.stall, settings.rate
        self._settings = settings
        try:
            import pynetft
        except ImportError:
            raise InputError("force: the package pynetft is missing; pip install 'cwmav[nano17]'") from None
        self._library = pynetft
        self._client: Any = None
        self._samples: Iterator[Any] | None = None
        self._clock = SampleClock(settings.rate)
        self._rows: list[tuple[float, ...]] = []
        self._first = self._next = 0
        self._origin: int | None = None
        self._stamp = self._overload = self._lost = self._wraps = self._last = 0
        self._resume = False
        self._restarts: deque[float] = deque(maxlen=MOST_RESTARTS)

    def open(self) -> Identity:
        """Connect, read the calibration and wait for a first sample."""
        s, library = self._settings, self._library
        config = library.Config(
            sensor_host=s.host,
            rdt_port=s.rdt_port,
            http_port=s.http_port,
            receive_timeout=0.5 * s.stall,
            recovery_policy=library.RecoveryPolicy.FAIL_STOP,
            deliver_samples_with_error_status=True,
        )
        try:
            self._client = library.Client(config, queue_size=QUEUE)
            self._client.start()
            if not self._client.wait_for_first_sample(max(2.0, s.stall)):
                raise InstrumentError(f"force: {s.host} sends no samples")
        except library.NetFTError as error:
            self.close()
            raise InstrumentError(f"force: {s.host} is not reached ({error})") from None
        except InstrumentError:
            self.close()
            raise
        found = self._client.health().sensor_configuration
        self._client.stop()
        if found is None:
            self.close()
            raise InstrumentError(f"force: {s.host} does not tell its calibration")
        calibration = found.calibration
        details = {
            "host": s.host,
            "counts_per_force_unit": str(calibration.counts_per_force_unit),
            "counts_per_torque_unit": str(calibration.counts_per_torque_unit),
            "force_unit": calibration.force_unit.value,
            "torque_unit": calibration.torque_unit.value,
        }
        if calibration.force_unit.value not in _FORCE or calibration.torque_unit.value not in _TORQUE:
            self.close()
            raise InstrumentError(
                f"force: units {details['force_unit']}, {details['torque_unit']} are not known"
            )
        self._scale = np.array(
            [_FORCE[calibration.force_unit.value]] * 3 + [_TORQUE[calibration.torque_unit.value]] * 3
        )
        return Identity(found.product_name, details)

    def start(self) -> None:
        """Begin to stream; sample numbers begin at zero."""
        self._clock, self._origin, self._wraps = SampleClock(self._settings.rate), None, 0
        self._rows.clear()
        self._lost = self._overload = 0
        self._resume = False
        self._restarts.clear()
        try:
            self._client.start()
        except self._library.NetFTError as error:
            raise InstrumentError(f"force: {self._settings.host} does not stream ({error})") from None
        self._samples = self._client.samples(WAIT)

    def read(self) -> list[Reading]:
        """Give the blocks that are full by now."""
        found: list[Reading] = []
        end = time.monotonic() + WAIT
        try:
            while time.monotonic() < end and self._samples is not None:
                sample = next(self._samples, None)
                if sample is None:
                    raise InstrumentError(f"force: {self._settings.host} closed the stream")
                found += self._take(sample)
        except TimeoutError:
            self._samples = self._client.samples(WAIT)  # the iterator ended with the error
        except self._library.SensorFaultError as error:
            found += self._after_fault(error)
        except self._library.NetFTError as error:
            raise InstrumentError(f"force: {self._settings.host} stopped sending ({error})") from None
        return found

    def _after_fault(self, error: Any) -> list[Reading]:
        """Go on after a sample that the sensor flagged, such as an overload at the clap.

        The library ends the stream at such a sample. What is missing until it runs again is counted by time.
        """
        now = time.monotonic()
        often = len(self._restarts) == MOST_RESTARTS and now - self._restarts[0] < RESTART_SPAN
        if error.fault_code is not self._library.FaultCode.SERIOUS_STATUS or often:
            raise InstrumentError(f"force: {self._settings.host} stopped sending ({error})") from None
        self._restarts.append(now)
        held = [self._block()] if self._rows else []
        self.stop()
        try:
            self._client.start()
        except self._library.NetFTError as failure:
            raise InstrumentError(f"force: {self._settings.host} does not stream ({failure})") from None
        self._samples, self._resume = self._client.samples(WAIT), True
        return held

    def _take(self, sample: Any) -> Iterator[Reading]:
        arrived = time.time_ns() - (time.monotonic_ns() - sample.received_at_ns)
        number = self._number(sample.rdt_sequence, arrived)
        if self._rows and number != self._next:
            yield self._block()
        if not self._rows:
            self._lost = max(0, number - self._next)
            self._first, self._overload = number, int(self._resume)
            self._resume = False
            self._stamp = self._clock.at(number, arrived)
        self._rows.append(sample.wrench)
        self._overload += sample.status != 0
        self._next = number + 1
        if len(self._rows) >= self._settings.block:
            yield self._block()

    def _block(self) -> Reading:
        data = np.array(self._rows) * self._scale
        self._rows.clear()
        return wrench_block(
            self._stamp, self._settings.rate, self._first, data, lost=self._lost, overload=self._overload
        )

    def _number(self, sequence: int, arrived_ns: int) -> int:
        """Sample number from the start, the wrap of 32 bits undone."""
        if self._origin is None:
            self._origin, self._last, self._next = sequence, sequence, 0
        elif self._resume and not self._rows:
            # The box counts anew, or on; the time tells how far the samples are.
            self._wraps, self._last = 0, sequence
            self._origin = sequence - max(self._next, self._clock.number(arrived_ns))
        if sequence < self._last - WRAP // 2:
            self._wraps += 1
        self._last = sequence
        return sequence + self._wraps * WRAP - self._origin

    def stop(self) -> None:
        """Stop the stream."""
        self._samples = None
        if self._client is not None:
            with contextlib.suppress(Exception):
                self._client.stop()

    def close(self) -> None:
        """Disconnect."""
        self.stop()
        self._client = None
