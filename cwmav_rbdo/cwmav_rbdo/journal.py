# SPDX-License-Identifier: Apache-2.0
"""The journal of a run: every request and every answer, a line of JSON each, appended and flushed to disk.

The loop is deterministic, so a resumed run is the same computation once more with the journal answering what
was answered before. A run may be killed at any moment: a last line without its end is what the kill
interrupted, and is dropped. Requested points are taken from the journal too, so that a resume on a machine
whose arithmetic differs in the last bit still asks for nothing twice.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from cwmav_common.cli import plain
from cwmav_common.errors import InputError
from cwmav_rbdo.evaluation import Answer, Outcome

FORMAT = 1
_SAME = 1e-6  # relative difference of a requested point beyond which the journal belongs to another run


class Journal:
    """Requests and answers of one run; without a path it lives in memory only.

    Parameters
    ----------
    path : file to append to, or None
    header : what identifies the run (problem, seed, noise); a resumed journal must carry the same
    outcome : class that restores an outcome from its plain values
    resume : read what the file holds instead of starting it
    """

    def __init__(
        self,
        path: Path | None,
        header: Mapping[str, Any],
        outcome: type[Outcome],
        *,
        resume: bool = False,
    ) -> None:
        self.path = path
        self._outcome = outcome
        self._points: dict[int, list[float]] = {}
        self._answers: dict[int, Answer] = {}
        self._file: IO[str] | None = None
        entry = {"kind": "header", "format": FORMAT, **plain(header)}
        if resume:
            self._read(entry)
        if path is not None:
            if not resume and path.exists():
                raise InputError(f"{path}: exists already; resume it or choose another run folder")
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = path.open("a", encoding="utf-8")
        if not resume:
            self._append(entry)

    @property
    def answered(self) -> int:
        """Number of requests with an answer."""
        return len(self._answers)

    def request(self, number: int, x: NDArray[np.float64], reason: str) -> NDArray[np.float64]:
        """Record that a point is asked for; gives the recorded point when it was asked for before.

        Raises
        ------
        InputError
            The journal holds a clearly different point under this number: it belongs to another run.
        """
        if number in self._points:
            recorded = np.array(self._points[number])
            if recorded.shape != x.shape or not np.allclose(recorded, x, rtol=_SAME, atol=_SAME):
                raise InputError(
                    f"{self.path}: request {number} is {recorded.tolist()} in the journal "
                    f"and {x.tolist()} now; "
                    "the journal was written by another version or with other settings"
                )
            return recorded
        self._points[number] = x.tolist()
        self._append({"kind": "request", "id": number, "x": x.tolist(), "reason": reason})
        return x

    def answer(self, number: int) -> Answer | None:
        """Give the recorded answer of a request, if there is one."""
        return self._answers.get(number)

    def record(self, number: int, answer: Answer) -> None:
        """Record an answer; the first one stands."""
        if number in self._answers:
            return
        self._answers[number] = answer
        outcome = None if answer.outcome is None else answer.outcome.to_json()
        entry = {"kind": "answer", "id": number, "outcome": outcome}
        self._append(entry | {"note": answer.note, "attempts": answer.attempts})

    def note(self, entry: Mapping[str, Any]) -> None:
        """Append something for readers of the file; a resume ignores it."""
        self._append(entry)

    def close(self) -> None:
        """Close the file; the journal can still be read."""
        if self._file is not None:
            self._file.close()
            self._file = None

    def _append(self, entry: Mapping[str, Any]) -> None:
        if self._file is None:
            return
        self._file.write(json.dumps(plain(entry), allow_nan=False) + "\n")
        self._file.flush()
        os.fsync(self._file.fileno())

    def _read(self, header: Mapping[str, Any]) -> None:
        if self.path is None or not self.path.is_file():
            raise InputError(f"{self.path}: there is no journal to resume")
        entries = _complete_lines(self.path)
        if not entries:
            raise InputError(f"{self.path}: the journal is empty; start the run anew")
        for key, value in header.items():
            if entries[0].get(key) != value:
                raise InputError(
                    f"{self.path}: the journal was written with {key} "
                    f"{entries[0].get(key)!r}, this run has {value!r}"
                )
        for entry in entries[1:]:
            if entry["kind"] == "request":
                self._points[entry["id"]] = entry["x"]
            elif entry["kind"] == "answer":
                outcome = None if entry["outcome"] is None else self._outcome.from_json(entry["outcome"])
                self._answers[entry["id"]] = Answer(outcome, entry["note"], entry["attempts"])


def _complete_lines(path: Path) -> list[dict[str, Any]]:
    """Read every whole entry and cut what a kill left of an unfinished last one."""
    content = path.read_bytes()
    end = content.rfind(b"\n") + 1
    if end < len(content):
        with path.open("r+b") as file:
            file.truncate(end)
    entries = []
    for number, line in enumerate(content[:end].splitlines(), 1):
        try:
            entries.append(json.loads(line))
        except ValueError as error:
            raise InputError(f"{path}: line {number} is damaged ({error}); start the run anew") from None
    return entries
