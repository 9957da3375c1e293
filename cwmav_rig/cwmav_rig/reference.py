# SPDX-License-Identifier: Apache-2.0
"""The reference page of all settings of the rig, from where they are declared."""

from __future__ import annotations

from cwmav_common.settings import markdown_table
from cwmav_rig.instruments.settings import BenchSettings
from cwmav_rig.ros.settings import RigSettings
from cwmav_rig.synthesis_settings import Synthesis
from cwmav_rig.topic_map import TopicMap

_PARTS = (
    (
        "Topic map",
        TopicMap,
        "YAML, `--topics`. A dotted key `force.topic` is `force: {topic: ..}`. `tare` may be `none`,"
        " a recording, a list of recordings, or `{topic: ..}`.",
    ),
    ("Bench", BenchSettings, "YAML, for `cwmav-rig record` and the parameter `bench` of the node."),
    ("Node", RigSettings, "ROS parameters of `/rig`."),
    (
        "Synthetic recording",
        Synthesis,
        "`cwmav-rig synthesise --set key=value`; `--artefact name=value` for those that begin with"
        " `artefacts.`.",
    ),
)


def page() -> str:
    """Give the page as Markdown."""
    parts = ["# Settings of the rig\n\nPrinted by `cwmav-rig settings`.\n"]
    parts += [f"## {title}\n\n{text}\n\n{markdown_table(cls)}\n" for title, cls, text in _PARTS]
    return "\n".join(parts)
