# SPDX-License-Identifier: Apache-2.0
"""Instruments that speak SCPI over VISA: opening, asking, and errors in words."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Any, TypeVar

from cwmav_common.errors import InputError
from cwmav_rig.instruments.protocol import InstrumentError

T = TypeVar("T")
TIMEOUT = 2000  # ms, of one answer


class Scpi:
    """One VISA resource.

    Parameters
    ----------
    name
        Of the instrument, for messages.
    resource, backend
        What to open and the VISA library to open it with.
    line_end
        End of a line, both ways.

    Raises
    ------
    InputError
        pyvisa is not installed.
    """

    def __init__(self, name: str, resource: str, backend: str, line_end: str = "\n") -> None:
        try:
            import pyvisa
        except ImportError:
            raise InputError(f"{name}: the package pyvisa is missing; pip install 'cwmav[visa]'") from None
        self._visa = pyvisa
        self._name, self._resource, self._backend, self._line_end = name, resource, backend, line_end
        self._manager: Any = None
        self._session: Any = None

    def open(self) -> None:
        """Connect; raises InstrumentError."""

        def connect() -> None:
            self._manager = self._visa.ResourceManager(self._backend)
            self._session = self._manager.open_resource(
                self._resource, read_termination=self._line_end, write_termination=self._line_end
            )
            self._session.timeout = TIMEOUT

        try:
            self._guarded(connect, "cannot be opened")
        except InstrumentError:
            self.close()
            raise

    def identify(self, query: str, expected: str) -> str:
        """Ask what it is; refuse another instrument than the expected one."""
        answer = self.ask(query)
        if expected and expected not in answer:
            self.close()
            raise InstrumentError(f"{self._name}: {self._resource} is {answer!r}, expected {expected!r}")
        return answer

    def ask(self, query: str) -> str:
        """Send a query and give the answer."""
        return str(self._guarded(lambda: self._session.query(query), f"does not answer {query!r}")).strip()

    def tell(self, command: str) -> None:
        """Send a command."""
        self._guarded(lambda: self._session.write(command), f"does not take {command!r}")

    def numbers(self, query: str, data_format: str) -> list[float]:
        """Ask for a waveform: bytes in a definite-length block, or numbers with commas."""

        def read() -> Any:
            if data_format == "byte":
                return self._session.query_binary_values(query, datatype="B")
            return self._session.query_ascii_values(query)

        return list(self._guarded(read, f"does not answer {query!r} in the format {data_format}"))

    def close(self) -> None:
        """Disconnect."""
        for part in (self._session, self._manager):
            if part is not None:
                with contextlib.suppress(Exception):
                    part.close()
        self._session = self._manager = None

    def _guarded(self, work: Callable[[], T], failure: str) -> T:
        try:
            return work()
        except (self._visa.Error, OSError, ValueError, AttributeError) as error:
            reason = " ".join(str(error).split()) or type(error).__name__
            raise InstrumentError(f"{self._name}: {self._resource} {failure} ({reason})") from None
