# SPDX-License-Identifier: Apache-2.0
"""Samples of a recording, by role."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from cwmav_common.errors import InputError
from cwmav_common.mcap_reader import Recording, open_recording
from cwmav_rig.calibration import TareRun
from cwmav_rig.sources.reader import BIN_RATE, RigData, RigReader
from cwmav_rig.sources.tare import run_of_block
from cwmav_rig.topic_map import AngleRole, TopicMap

LONG, LONG_BIN_RATE = 900.0, 500.0  # s, Hz: a long recording is kept coarser


def load(recording: Recording, topic_map: TopicMap) -> RigData:
    """Read every mapped role of a recording in one pass.

    Raises
    ------
    InputError
        A role is recorded in a form that cannot be read.
    """
    begin, end = recording.span_ns
    rate = LONG_BIN_RATE if (end - begin) * 1e-9 > LONG else BIN_RATE
    reader = RigReader(topic_map, begin, str(recording.path), rate)
    for batch in recording.batches(set(topic_map.topics().values())):
        reader.take(batch)
    if reader.pictures is not None:
        reader.pictures.require_calibration()
    data = reader.data(last=True)
    others = [_tare_recording(path, topic_map, begin) for path in topic_map.tare_recordings]
    return replace(data, tares=(*data.tares, *others)) if others else data


def _tare_recording(path: str, topic_map: TopicMap, origin_ns: int) -> TareRun:
    """Read a wind-off run; its attitude comes from the same angle topic as that of the flapping run."""
    with open_recording(path) as recording:
        for name in {topic_map.force.topic, topic_map.force.temperature} - {""}:
            if name not in recording.topics:
                raise InputError(f"{path}: tare recording has no topic {name!r}")
        angle = topic_map.angle_of_attack
        if angle.topic not in recording.topics:
            angle = AngleRole()
        data = load(recording, TopicMap(force=topic_map.force, angle_of_attack=angle, tare="none"))
    if data.force is None or not data.force.good.any():
        raise InputError(f"{path}: tare recording has no force samples")
    run = run_of_block(data.force, data.angle, (data.origin_ns - origin_ns) * 1e-9, Path(path).name)
    warm = data.sensor_temperature
    known = warm is not None and len(warm.values) > 0
    return replace(run, temperature=float(warm.values.mean())) if known and warm is not None else run
