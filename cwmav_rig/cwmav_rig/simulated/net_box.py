# SPDX-License-Identifier: Apache-2.0
"""A Net box on the loopback: calibration page over HTTP, force records over UDP."""

from __future__ import annotations

import contextlib
import socket
import struct
import threading
import time
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import TracebackType
from typing import Any

HEADER, STOP, START, BIAS = 0x1234, 0, 2, 0x42
COUNTS_PER_NEWTON, COUNTS_PER_NEWTON_MILLIMETRE = 1_000_000, 1_000_000
Wrench = tuple[float, float, float, float, float, float]


class SimulatedNetBox:
    """Streams a wrench from a thread while it is entered.

    Parameters
    ----------
    wrench
        Force [N] and moment [N m] of sample number n.
    rate
        Records per second.
    lose
        Says whether record n is lost on the way.
    first
        Number of the first record; near 2^32 to see the wrap.
    """

    def __init__(
        self,
        wrench: Callable[[int], Wrench] = lambda n: (0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        rate: float = 1000.0,
        lose: Callable[[int], bool] = lambda n: False,
        status: Callable[[int], int] = lambda n: 0,
        first: int = 1,
    ) -> None:
        self._wrench, self._lose, self._status, self._rate = wrench, lose, status, rate
        self._next = first
        self._udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._udp.bind(("127.0.0.1", 0))
        self._udp.settimeout(0.002)
        self._http = ThreadingHTTPServer(("127.0.0.1", 0), _Page)
        self._stopped, self._unplugged = threading.Event(), threading.Event()
        self._threads = [
            threading.Thread(target=self._serve, daemon=True),
            threading.Thread(target=self._http.serve_forever, args=(0.05,), daemon=True),
        ]

    @property
    def rdt_port(self) -> int:
        """UDP port."""
        return int(self._udp.getsockname()[1])

    @property
    def http_port(self) -> int:
        """TCP port of the page."""
        return int(self._http.server_address[1])

    def unplug(self) -> None:
        """Send nothing any more."""
        self._unplugged.set()

    def plug(self) -> None:
        """Answer again."""
        self._unplugged.clear()

    def __enter__(self) -> SimulatedNetBox:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: Any, trace: TracebackType | None) -> None:
        self._stopped.set()
        self._http.shutdown()
        for thread in self._threads:
            thread.join(5.0)
        self._http.server_close()
        self._udp.close()

    def _serve(self) -> None:
        listener: Any = None
        begun, sent = 0.0, 0
        while not self._stopped.is_set():
            with contextlib.suppress(TimeoutError):
                request, sender = self._udp.recvfrom(64)
                header, command, _ = struct.unpack(">HHI", request[:8])
                if header == HEADER and command in (START, STOP):
                    listener = sender if command == START else None
                    begun, sent = time.monotonic(), 0
            if listener is None:
                continue
            due = int((time.monotonic() - begun) * self._rate)
            while sent < due:
                self._send(listener)
                sent += 1

    def _send(self, listener: Any) -> None:
        n = self._next
        self._next = (n + 1) % (1 << 32)
        if self._unplugged.is_set() or self._lose(n):
            return
        wrench = self._wrench(n)
        counts = [round(value * COUNTS_PER_NEWTON) for value in wrench[:3]]
        counts += [round(1e3 * value * COUNTS_PER_NEWTON_MILLIMETRE) for value in wrench[3:]]
        record = struct.pack(">IIIiiiiii", n, n, self._status(n), *counts)
        with contextlib.suppress(OSError):
            self._udp.sendto(record, listener)


class _Page(BaseHTTPRequestHandler):
    """The page that tells product and calibration."""

    def do_GET(self) -> None:
        page = (
            '<?xml version="1.0" encoding="UTF-8"?>\n<netft>'
            "<prodname>Simulated Net F/T</prodname>"
            f"<cfgcpf>{COUNTS_PER_NEWTON}</cfgcpf><cfgcpt>{COUNTS_PER_NEWTON_MILLIMETRE}</cfgcpt>"
            "<scfgfu>N</scfgfu><scfgtu>N-mm</scfgtu><cfgfu>2</cfgfu><cfgtu>3</cfgtu></netft>\n"
        ).encode()
        self.send_response(200)
        self.send_header("Content-Type", "text/xml")
        self.send_header("Content-Length", str(len(page)))
        self.end_headers()
        self.wfile.write(page)

    def log_message(self, *arguments: object) -> None:
        """Say nothing."""
