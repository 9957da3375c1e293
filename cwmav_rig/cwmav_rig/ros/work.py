# SPDX-License-Identifier: Apache-2.0
"""Work of the node's process: analysis of a recording, and the power model."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from cwmav_common.errors import InputError
from cwmav_common.mcap_reader import Message, Topic
from cwmav_rig.analysis import RigReport, analyse
from cwmav_rig.live import LiveRig
from cwmav_rig.power_model import PowerModel
from cwmav_rig.topic_map import TopicMap, load_topic_map

_PART = 500_000_000  # ns
BUNDLED = Path(str(resources.files("cwmav_rig") / "data" / "power_model.json"))


def read_map(path: str) -> TopicMap | None:
    """Read a topic map; None for an empty path, which leaves the choice to the recording."""
    return load_topic_map(path) if path else None


def analyse_recording(
    recording: str, topic_map: str, window: tuple[float, float] | None, channel: Any
) -> RigReport:
    """Estimate the scatter in a window of a recording."""
    del channel
    return analyse(recording, read_map(topic_map), window=window)


def load_power_model(path: str, topic_map: str, channel: Any) -> PowerModel:
    """Load a power model, or build one from a recording or a folder of them."""
    del channel
    source = Path(path) if path else BUNDLED
    if not source.exists():
        raise InputError(
            f"power_model {source}: no such file or folder; allowed: a power model or recordings"
        )
    if source.suffix == ".json":
        return PowerModel.load(source)
    return PowerModel.from_recordings([source], read_map(topic_map))


def follow_cycles(topic_map: TopicMap, topics: Mapping[str, Topic], source: str, channel: Any) -> None:
    """Find flapping cycles in force messages as they come; every cycle is reported once.

    The messages are asked for: the answer to each question is a pair of whether to begin anew, as after a
    jump in the recording, and the messages since the last answer.
    """
    live = LiveRig(TopicMap(force=topic_map.force), topics, source)
    while True:
        anew, messages = channel.ask(None).result()
        if anew:
            live.reset()
        for part in _in_parts(messages):
            for event in live.push(part):
                channel.report(event)


def _in_parts(messages: list[Message]) -> Iterator[list[Message]]:
    """Split what piled up, because the search only looks at the last seconds of what it is given."""
    part: list[Message] = []
    for message in messages:
        if part and message.log_time_ns - part[0].log_time_ns > _PART:
            yield part
            part = []
        part.append(message)
    if part:
        yield part
