# SPDX-License-Identifier: Apache-2.0
"""Work of the node's process: analysis of a recording, and the power model."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Any

from cwmav_common.errors import InputError
from cwmav_rig.analysis import RigReport, analyse
from cwmav_rig.power_model import PowerModel
from cwmav_rig.topic_map import TopicMap, load_topic_map

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
