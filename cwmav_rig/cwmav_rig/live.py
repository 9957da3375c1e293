# SPDX-License-Identifier: Apache-2.0
"""The rig as it happens: messages in, what a node publishes out, and at any time the report so far.

The same reader and analysis serve a replayed recording, a live one and a file read at full speed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cwmav_common.errors import InputError
from cwmav_common.mcap_reader import Batch, Message, Topic
from cwmav_rig.analysis import RigReport, analyse_data
from cwmav_rig.blocks import Block
from cwmav_rig.cycles import find_cycles
from cwmav_rig.replay import Player
from cwmav_rig.sources.reader import RigReader
from cwmav_rig.topic_map import TopicMap

Array = NDArray[np.float64]
WINDOW = 4.0  # s of force in which new cycles are looked for
EVERY = 0.5  # s of force between looks
PART = 250_000_000  # ns of messages that are pushed together in lock step


@dataclass(frozen=True)
class CycleEvent:
    """One completed flapping cycle: when it ended [ns, force clock] and its frequency [Hz]."""

    stamp_ns: int
    frequency: float


class LiveRig:
    """Collects messages of the mapped topics.

    Parameters
    ----------
    topic_map
        Roles of the topics.
    topics
        Topics by name, for their types and schemas.
    source
        Name used in reports and messages.
    """

    def __init__(self, topic_map: TopicMap, topics: Mapping[str, Topic], source: str) -> None:
        self.map = topic_map
        self.source = source
        self._topics = dict(topics)
        self._wanted = set(topic_map.topics().values())
        self._reader: RigReader | None = None
        self._reported = -np.inf  # time up to which cycles were given out
        self._looked = -np.inf

    def push(self, messages: Sequence[Message]) -> list[CycleEvent]:
        """Take messages in the order they came and give the flapping cycles that are complete now."""
        if not messages:
            return []
        if self._reader is None:
            self._reader = RigReader(self.map, messages[0].log_time_ns, self.source)
        for batch in batches(messages, self._topics, self._wanted):
            self._reader.take(batch)
        return self._new_cycles()

    def reset(self) -> None:
        """Forget everything, as at the begin of a recording."""
        self._reader = None
        self._reported = self._looked = -np.inf

    def report(self, *, window: tuple[float, float] | None = None) -> RigReport:
        """Analyse what came in so far.

        Raises
        ------
        InputError
            Nothing came in yet, or what came in cannot be used.
        """
        if self._reader is None:
            raise InputError(f"{self.source}: no messages yet")
        return analyse_data(self._reader.data(), self.map, source=self.source, window=window)

    def _new_cycles(self) -> list[CycleEvent]:
        reader = self._reader
        if reader is None or not reader.force.latest > self._looked + EVERY:
            return []
        block = reader.force.tail(WINDOW)
        if block is None or len(block.values) * block.step < 0.9 * WINDOW:
            return []
        self._looked = reader.force.latest
        return self._cycles_of(block, reader.origin)

    def _cycles_of(self, block: Block, origin_ns: int) -> list[CycleEvent]:
        try:
            cycles = find_cycles(block)
        except InputError:
            return []  # the wings stand still
        events = []
        for begin, finish, good in zip(cycles.bounds[:-1], cycles.bounds[1:], cycles.good, strict=True):
            if good and 0.5 * (begin + finish) > self._reported:
                events.append(
                    CycleEvent(origin_ns + round(float(finish) * 1e9), float(1.0 / (finish - begin)))
                )
        if len(cycles.bounds):
            self._reported = max(self._reported, float(cycles.bounds[-1]))
        return events


def run_in_lock_step(
    player: Player, topic_map: TopicMap, on_cycle: Callable[[CycleEvent], None] = lambda event: None
) -> LiveRig:
    """Push a whole recording through the live path as fast as it goes, the same way every time.

    What a node would have said live comes out of this without a clock, so that the load of the machine
    changes nothing.

    Parameters
    ----------
    on_cycle
        Called with every flapping cycle, in order.

    Returns
    -------
    LiveRig
        Ready to report on everything that came in.
    """
    live = LiveRig(topic_map, player.recording.topics, str(player.recording.path))
    part: list[Message] = []
    for message in player.lock_step():
        if part and message.log_time_ns - part[0].log_time_ns > PART:
            for event in live.push(part):
                on_cycle(event)
            part = []
        part.append(message)
    for event in live.push(part):
        on_cycle(event)
    return live


def batches(messages: Iterable[Message], topics: Mapping[str, Topic], wanted: set[str]) -> list[Batch]:
    """Lay messages of the wanted topics side by side in memory, one batch per topic."""
    collected: dict[str, list[Message]] = {}
    for message in messages:
        if message.topic in wanted:
            collected.setdefault(message.topic, []).append(message)
    return [_batch(topics.get(name) or _topic(group[0]), group) for name, group in collected.items()]


def _topic(message: Message) -> Topic:
    return Topic(message.topic, message.type_name, "", "cdr", 0)


def _batch(topic: Topic, messages: list[Message]) -> Batch:
    lengths = np.array([len(message.data) for message in messages], np.int64)
    buffer = np.frombuffer(b"".join(message.data for message in messages), np.uint8)
    starts = np.concatenate(([0], np.cumsum(lengths)[:-1])).astype(np.int64)
    times = np.array([message.log_time_ns for message in messages], np.int64)
    return Batch(topic, times, buffer, starts, lengths)
