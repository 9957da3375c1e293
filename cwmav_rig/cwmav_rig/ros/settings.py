# SPDX-License-Identifier: Apache-2.0
"""Parameters of the rig node."""

from __future__ import annotations

from dataclasses import dataclass

from cwmav_common.settings import setting


@dataclass(frozen=True)
class RigSettings:
    """What `ros2 param list /rig` shows."""

    recording: str = setting("", "recording to replay and analyse: rosbag2 folder or .mcap file; empty: none")
    bench: str = setting(
        "", "live instruments (YAML) in place of a recording; taken at the next configure; empty: none"
    )
    record_folder: str = setting("", "folder that live streams are recorded into; empty: not recorded")
    autostart: bool = setting(True, "configure and activate at the start, without a life-cycle manager")
    topic_map: str = setting("", "topic map (YAML) of the recording; empty: the recording's own, or by types")
    power_model: str = setting(
        "",
        "power model (.json) or recordings behind ~/evaluate_power; empty: the bundled one",
    )
    rate: float = setting(1.0, "recorded seconds per second", ge=0.01, le=1000)
    start_offset: float = setting(0.0, "where the replay begins, from the start", unit="s", ge=0)
    loop: bool = setting(False, "begin again at the end of the recording")
    start_paused: bool = setting(False, "wait for ~/resume")
    publish_clock: bool = setting(False, "publish the time of the recording on /clock")
    wrench_rate: float = setting(
        200.0, "messages on ~/wrench, the view of the force", unit="Hz", gt=0, le=2000
    )
    tare_seconds: float = setting(
        1.0, "recorded time whose mean force ~/tare takes as zero", unit="s", gt=0, le=60
    )
