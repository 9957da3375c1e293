# SPDX-License-Identifier: Apache-2.0
"""Node's side of the search for flapping cycles, which runs in a process of its own."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from typing import Any

from cwmav_common.errors import CancelledError
from cwmav_common.mcap_reader import Message, Topic
from cwmav_common.workers import Job, WorkerPool
from cwmav_rig.live import CycleEvent
from cwmav_rig.ros.work import follow_cycles
from cwmav_rig.topic_map import TopicMap


class CycleFollower:
    """Hands force messages to the search and its findings back.

    Parameters
    ----------
    on_cycle : called with every cycle, from a thread of the pool
    """

    def __init__(self, on_cycle: Callable[[CycleEvent], None]) -> None:
        self._on_cycle = on_cycle
        self._pool = WorkerPool(1, "cwmav_rig cycles")
        self._job: Job | None = None
        self._topic = ""
        self._lock = threading.Lock()
        self._waiting: Future[Any] | None = None
        self._buffer: list[Message] = []
        self._anew = False

    def begin(self, topic_map: TopicMap, topics: Mapping[str, Topic], source: str) -> None:
        """Follow another recording."""
        self._end()
        self._topic = topic_map.force.topic
        if self._topic:
            self._job = self._pool.submit(
                follow_cycles,
                topic_map,
                dict(topics),
                source,
                on_report=self._on_cycle,
                on_question=self._take_question,
            )

    def add(self, messages: list[Message]) -> None:
        """Take replayed messages; those of the force go to the search when it is ready for more."""
        with self._lock:
            self._buffer += [message for message in messages if message.topic == self._topic]
        self._answer()

    def restart(self) -> None:
        """Begin anew, as after a jump in the recording."""
        with self._lock:
            self._buffer, self._anew = [], True

    def close(self) -> None:
        """End the search."""
        self._end()
        self._pool.close()

    def _take_question(self, _: Any) -> Future[Any]:
        answer: Future[Any] = Future()
        with self._lock:
            self._waiting = answer
        self._answer()
        return answer

    def _answer(self) -> None:
        """Hand over what piled up, if it is waited for."""
        with self._lock:
            if self._waiting is None or not self._buffer:
                return
            waiting, self._waiting = self._waiting, None
            content = (self._anew, self._buffer)
            self._buffer, self._anew = [], False
        waiting.set_result(content)

    def _end(self) -> None:
        with self._lock:
            waiting, self._waiting = self._waiting, None
            self._buffer, self._anew = [], False
        if waiting is not None:
            waiting.set_exception(CancelledError("the replay ended"))
        if self._job is not None:
            self._job.cancel()
            self._job = None
