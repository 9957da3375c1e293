# SPDX-License-Identifier: Apache-2.0
"""One table of everything the benchmarks measured; ``--record-benchmarks FILE`` keeps it as a page."""

from __future__ import annotations

import os
import platform
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import pytest

_PAGE = """# Benchmarks: last results

Written by `make bench RECORD=docs/benchmarks.md`; do not edit. Ours and the peer's were measured in the same
run on the same machine; a ratio above 1 means that ours is better. Figures without a peer say how cost grows.

{date}, {machine}.

| what | ours | peer | ratio |
| --- | --- | --- | --- |
{rows}
"""


@dataclass(frozen=True)
class Row:
    """One measured figure."""

    what: str
    ours: str
    peer: str
    ratio: float | None

    def cells(self) -> tuple[str, str, str, str]:
        """Return the row as text."""
        return self.what, self.ours, self.peer, "" if self.ratio is None else f"{self.ratio:.3g}"


class Benchmarks:
    """Collects the figures of a run."""

    def __init__(self) -> None:
        self.rows: list[Row] = []

    def rate(self, what: str, ours: float, unit: str, peer: float | None = None, name: str = "") -> None:
        """Take a rate, of which more is better, and that of a named peer."""
        other = "" if peer is None else f"{name} {peer:.3g} {unit}"
        self._add(Row(what, f"{ours:.3g} {unit}", other, None if peer is None else ours / peer))

    def cost(self, what: str, ours: float, unit: str, peer: float | None = None, name: str = "") -> None:
        """Take a cost, of which less is better, and that of a named peer."""
        other = "" if peer is None else f"{name} {peer:.3g} {unit}"
        self._add(Row(what, f"{ours:.3g} {unit}", other, None if peer is None else peer / ours))

    def _add(self, row: Row) -> None:
        self.rows.append(row)

    def page(self) -> str:
        """Return the table as Markdown."""
        lines = "\n".join("| " + " | ".join(row.cells()) + " |" for row in self.rows)
        return _PAGE.format(date=datetime.now(UTC).date().isoformat(), machine=_machine(), rows=lines)


_KEY = pytest.StashKey[Benchmarks]()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--record-benchmarks", metavar="FILE", help="write the table of the benchmarks here")


def pytest_configure(config: pytest.Config) -> None:
    config.stash[_KEY] = Benchmarks()


@pytest.fixture(scope="session")
def benchmarks(request: pytest.FixtureRequest) -> Benchmarks:
    return request.config.stash[_KEY]


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    table = config.stash[_KEY]
    if not table.rows:
        return
    terminalreporter.section("benchmarks")
    cells = [("what", "ours", "peer", "ratio"), *(row.cells() for row in table.rows)]
    widths = [max(len(row[k]) for row in cells) for k in range(4)]
    for row in cells:
        terminalreporter.line("  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)))
    path = config.getoption("--record-benchmarks")
    if path:
        Path(path).write_text(table.page(), encoding="utf-8")


def _machine() -> str:
    name = platform.processor() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        models = [line for line in cpuinfo.read_text().splitlines() if line.startswith("model name")]
        name = models[0].partition(":")[2].strip() if models else name
    return f"{name}, {os.cpu_count()} cores, Python {platform.python_version()}"
