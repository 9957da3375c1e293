# SPDX-License-Identifier: Apache-2.0
"""Progress of long work: a bar on a terminal, silence in a pipe."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from tqdm import tqdm


@dataclass
class Progress:
    """Handle of one running bar."""

    _bar: Any

    def update(self, n: float = 1.0, note: str = "") -> None:
        """Advance by `n` units and show `note` behind the bar."""
        if note:
            self._bar.set_postfix_str(note, refresh=False)
        self._bar.update(n)

    def advance_to(self, done: float, note: str = "") -> None:
        """Set the bar to `done` units in all; going backwards is ignored."""
        self.update(max(done - self._bar.n, 0.0), note)


@contextmanager
def progress(total: float, description: str, unit: str = "") -> Iterator[Progress]:
    """Open a bar of `total` units on standard error; nothing is shown unless that is a terminal."""
    bar_format = "{desc}  [{bar:24}] {percentage:3.0f} %, {remaining} left  {postfix}"
    with tqdm(
        total=total,
        desc=description,
        unit=unit,
        file=sys.stderr,
        disable=not sys.stderr.isatty(),
        bar_format=bar_format,
        ascii=" =>",
    ) as bar:
        yield Progress(bar)
