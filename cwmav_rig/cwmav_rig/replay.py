# SPDX-License-Identifier: Apache-2.0
"""Play a recording again: on a clock, or in lock step as fast as the consumer takes it.

The player never sleeps and starts no thread. On a clock, whoever owns the loop (a timer of a node) calls
:meth:`Player.poll` and gets what is due; :meth:`Player.seconds_to_next` says when to come back. In lock step
the messages come in the order of their log times whatever the load, so a recording always gives the same
bytes.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from types import TracebackType
from typing import Any

from cwmav_common.errors import InputError
from cwmav_common.mcap_reader import Message, Recording, open_recording

NANO = 1e-9
SLOWEST, FASTEST = 0.01, 1000.0


class Player:
    """Replay of one recording.

    Parameters
    ----------
    bag
        ``.mcap`` file or rosbag2 folder, or an opened recording.
    topics
        Topics to play; all when not given.
    rate
        Recorded seconds per second of the clock.
    loop
        Begin again at the end.
    start_offset
        Where to begin [s] from the start of the recording, also when looping.
    clock
        Seconds that never go back; injected by tests and by nodes that follow simulated time.

    Attributes
    ----------
    loops
        How often the recording was begun again.
    finished
        True when everything was played and it does not loop.
    """

    def __init__(
        self,
        bag: str | Path | Recording,
        *,
        topics: Iterable[str] | None = None,
        rate: float = 1.0,
        loop: bool = False,
        start_offset: float = 0.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        _checked_rate(rate)
        self.recording = bag if isinstance(bag, Recording) else open_recording(bag)
        self._topics = None if topics is None else tuple(topics)
        self._clock = clock
        self._begin, self._end = self.recording.span_ns
        self.loop = loop
        self.loops = 0
        self.finished = False
        try:
            self._offset = self._checked_position(start_offset)
        except InputError:
            self.recording.close()
            raise
        self._rate = float(rate)
        self._running = False
        self._position = self._offset  # recorded seconds at self._since
        self._since = clock()
        self._messages: Iterator[Message] = iter(())
        self._next: Message | None = None
        self._rewind(self._offset)

    def __enter__(self) -> Player:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: Any, trace: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Close the recording."""
        self.recording.close()

    @property
    def duration(self) -> float:
        """Length of the recording [s]."""
        return (self._end - self._begin) * NANO

    @property
    def rate(self) -> float:
        """Recorded seconds per second."""
        return self._rate

    @property
    def running(self) -> bool:
        """True while the clock of the recording advances."""
        return self._running

    @property
    def position(self) -> float:
        """Where the replay stands [s] from the start of the recording."""
        if not self._running:
            return self._position
        return min(self._position + (self._clock() - self._since) * self._rate, self.duration)

    @property
    def recorded_time_ns(self) -> int:
        """The recorded time at :attr:`position` [ns], for a ``/clock`` topic."""
        return self._begin + round(self.position / NANO)

    def start(self) -> None:
        """Begin to play, from the start offset when everything was played."""
        if self.finished:
            self.seek(self._offset)
        self.resume()

    def pause(self) -> None:
        """Stop the clock of the recording."""
        self._position = self.position
        self._running = False

    def resume(self) -> None:
        """Let the clock of the recording run on."""
        if not self._running:
            self._since = self._clock()
            self._running = True

    def set_rate(self, rate: float) -> None:
        """Change the speed from here on.

        Raises
        ------
        InputError
            The rate is outside of 0.01 to 1000.
        """
        checked = _checked_rate(rate)
        self._position, self._since = self.position, self._clock()
        self._rate = checked

    def seek(self, seconds: float) -> None:
        """Go to a place [s] from the start of the recording; the next message is the first one not before it.

        Raises
        ------
        InputError
            The place is outside of the recording.
        """
        self._position = self._checked_position(seconds)
        self._since = self._clock()
        self.finished = False
        self._rewind(self._position)

    def poll(self, limit: int = 1000) -> list[Message]:
        """Take at most `limit` messages that are due by now, in order."""
        if not self._running:
            return []
        due: list[Message] = []
        while len(due) < limit:
            until = self._begin + round(self.position / NANO)
            while self._next is not None and self._next.log_time_ns <= until and len(due) < limit:
                due.append(self._next)
                self._next = next(self._messages, None)
            if self._next is not None or len(due) >= limit or not self._at_end():
                break
        return due

    def seconds_to_next(self) -> float | None:
        """Time until the next message is due [s of the clock]; None when paused or at the end."""
        if not self._running or self._next is None:
            return None
        wait = (self._next.log_time_ns - self._begin) * NANO - self.position
        return max(0.0, wait / self._rate)

    def lock_step(self) -> Iterator[Message]:
        """Give every message from the start offset on, in order, without any clock; does not loop."""
        yield from self.recording.messages(self._topics, start_ns=self._begin + round(self._offset / NANO))

    def _at_end(self) -> bool:
        """Handle the end; say whether the recording was begun again and something may be due."""
        if not self.loop or self.duration <= self._offset:
            self.finished = True
            self._position = self.duration
            self._running = False
            return False
        self.loops += 1
        self._position, self._since = self._offset, self._clock()
        self._rewind(self._offset)
        return self._next is not None

    def _rewind(self, seconds: float) -> None:
        self._messages = self.recording.messages(self._topics, start_ns=self._begin + round(seconds / NANO))
        self._next = next(self._messages, None)

    def _checked_position(self, seconds: float) -> float:
        if not 0.0 <= seconds <= self.duration:
            raise InputError(
                f"{self.recording.path}: position {seconds} s; allowed: 0 to {self.duration:.3f} s"
            )
        return float(seconds)


def _checked_rate(rate: float) -> float:
    if not SLOWEST <= rate <= FASTEST:
        raise InputError(f"replay rate {rate}; allowed: {SLOWEST:g} to {FASTEST:g}")
    return float(rate)
