# SPDX-License-Identifier: Apache-2.0
"""What a person wants to know about an unknown recording, mostly without reading it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cwmav_common.mcap_reader import Recording, open_recording
from cwmav_rig.topic_map import METADATA, guess

NANO = 1e-9
LONGEST_PAUSE = 1_000_000_000  # ns


@dataclass(frozen=True)
class BagInfo:
    """Summary of a recording.

    Attributes
    ----------
    topics
        Type, count, rate [Hz] and suggested role per topic.
    gaps
        Pauses without any message, longer than a second: begin [s] and length [s].
    instruments
        What the instruments of a live recording said they are.
    """

    path: str
    files: tuple[str, ...]
    size: int
    synthetic: bool
    topics: dict[str, dict[str, Any]]
    gaps: tuple[dict[str, float], ...]
    duration: float
    start_ns: int
    problems: tuple[str, ...]
    instruments: dict[str, str] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """Give the keys of the public contract and some more."""
        return {
            "bag": self.path,
            "files": list(self.files),
            "size_bytes": self.size,
            "synthetic": self.synthetic,
            "topics": self.topics,
            "rates_hz": {name: topic["rate_hz"] for name, topic in self.topics.items()},
            "gaps": list(self.gaps),
            "duration_s": self.duration,
            "start_time_ns": self.start_ns,
            "problems": list(self.problems),
            "instruments": self.instruments,
        }

    def lines(self) -> Iterator[str]:
        """Give the summary for a person."""
        mark = "   SYNTHETIC" if self.synthetic else ""
        yield f"{self.path}: {self.duration:.2f} s, {self.size / 1e6:.2f} MB, {len(self.files)} file(s){mark}"
        for name, topic in self.topics.items():
            role = f"   -> {topic['role']}" if topic["role"] else ""
            yield f"  {name:32s} {topic['type']:48s} {topic['count']:9d}  {topic['rate_hz']:10.2f} Hz{role}"
        for name, identity in self.instruments.items():
            yield f"  {name} was {identity}"
        for gap in self.gaps:
            yield f"  nothing recorded from {gap['begin_s']:.2f} s for {gap['length_s']:.2f} s"
        for problem in self.problems:
            yield f"  problem: {problem}"


def describe(path: str | Path) -> BagInfo:
    """Summarise a recording from its index; one without an index is read once.

    Raises
    ------
    InputError
        It is no recording.
    """
    with open_recording(path) as recording:
        start, end = recording.span_ns
        duration = (end - start) * NANO
        topics = _topics(recording, duration)
        problems = list(recording.problems)
        if not any(topic["count"] for topic in topics.values()):
            problems.append(f"{path}: holds no messages")
        return BagInfo(
            path=str(path),
            files=tuple(str(file) for file in recording.files),
            size=sum(file.stat().st_size for file in recording.files),
            synthetic=recording.metadata.get(METADATA, {}).get("synthetic") == "true",
            topics=topics,
            gaps=tuple(_gaps(recording, start)),
            duration=duration,
            start_ns=start,
            problems=tuple(problems),
            instruments=_instruments(recording),
        )


def _topics(recording: Recording, duration: float) -> dict[str, dict[str, Any]]:
    roles = {topic: role for role, topic in guess(recording).topics().items()}
    return {
        name: {
            "type": topic.type_name,
            "count": topic.count,
            "rate_hz": (topic.count - 1) / duration if duration > 0 and topic.count > 1 else 0.0,
            "role": roles.get(name, ""),
        }
        for name, topic in recording.topics.items()
    }


def _instruments(recording: Recording) -> dict[str, str]:
    try:
        told = json.loads(recording.metadata.get(METADATA, {}).get("instruments", "{}"))
        return {str(name): str(about["name"]) for name, about in told.items()}
    except (ValueError, AttributeError, TypeError, KeyError):
        return {}  # somebody else's metadata of the same name


def _gaps(recording: Recording, start: int) -> Iterator[dict[str, float]]:
    for begin, end in recording.pauses(LONGEST_PAUSE):
        yield {"begin_s": (begin - start) * NANO, "length_s": (end - begin) * NANO}
