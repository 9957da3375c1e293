# SPDX-License-Identifier: Apache-2.0
"""Everything that instruments give, into a recording, while it streams."""

from __future__ import annotations

import contextlib
import json
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from types import TracebackType
from typing import Any

from cwmav_common.errors import InputError, WorkError
from cwmav_common.mcap_reader import Message, open_recording
from cwmav_common.mcap_writer import BagWriter
from cwmav_common.rosbag2 import write_rosbag2_metadata
from cwmav_common.settings import to_mapping
from cwmav_rig.instruments import messages as topics
from cwmav_rig.instruments.bench import instruments
from cwmav_rig.instruments.protocol import Identity
from cwmav_rig.instruments.session import InstrumentHealth, Session
from cwmav_rig.instruments.settings import BenchSettings
from cwmav_rig.topic_map import METADATA, TopicMap, load_topic_map

STEP = 0.1  # s
CHUNK = 1 << 16  # bytes; what a lost power supply can cost


class LiveRecorder:
    """A rosbag2 folder (or one ``.mcap`` file) that grows.

    The file is complete after :meth:`close`; what a crash leaves is read up to the last whole chunk.

    Parameters
    ----------
    path
        File to write, or a name without suffix for a folder; must not exist.
    bench, identities
        Facts about the instruments that are kept in the recording.

    Raises
    ------
    InputError
        It exists already or cannot be written.
    """

    def __init__(self, path: Path, bench: BenchSettings, identities: Mapping[str, Identity]) -> None:
        self.path, self.messages = path, 0
        folder = not path.suffix
        if path.exists():
            raise InputError(f"{path}: exists; recordings are never written over")
        self.file = path / f"{path.name}_0.mcap" if folder else path
        try:
            self.file.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{self.file.parent}: cannot be made ({error.strerror or error})") from None
        self._folder = folder
        self._writer: BagWriter | None = BagWriter(self.file, chunk_size=CHUNK)
        about = {name: {"name": identity.name, **identity.details} for name, identity in identities.items()}
        self._writer.add_metadata(
            METADATA,
            {
                "topic_map": json.dumps(live_topic_map(bench)),
                "instruments": json.dumps(about),
                "bench": json.dumps(to_mapping(bench)),
            },
        )

    def __enter__(self) -> LiveRecorder:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: Any, trace: TracebackType | None) -> None:
        self.close()

    def write(self, messages: Iterable[Message]) -> None:
        """Write messages as they came.

        Raises
        ------
        WorkError
            The disk takes no more; the recording is closed with what it holds.
        """
        if self._writer is None:
            raise InputError(f"{self.path}: is closed")
        try:
            for message in messages:
                self._writer.write_raw(message.topic, message.type_name, message.data, message.log_time_ns)
                self.messages += 1
        except OSError as error:
            with contextlib.suppress(WorkError):
                self.close()
            raise WorkError(f"{self.path}: cannot be written ({error.strerror or error})") from None

    def close(self) -> None:
        """Finish the recording; raises WorkError when the disk does not take the rest."""
        writer, self._writer = self._writer, None
        if writer is None:
            return
        try:
            writer.close()
            if self._folder:
                with open_recording(self.file) as recording:
                    write_rosbag2_metadata(self.path, recording, {})
        except OSError as error:
            raise WorkError(f"{self.path}: cannot be finished ({error.strerror or error})") from None


def live_topic_map(bench: BenchSettings) -> dict[str, Any]:
    """Give the topic map of what the bench records, with the calibration facts of its own map."""
    known = load_topic_map(bench.topic_map) if bench.topic_map else TopicMap()
    kept = topics.COMPRESSED if bench.camera.folder else topics.IMAGE
    camera = bool(bench.camera.folder or bench.camera.stream)
    mapped = replace(
        known,
        force=replace(known.force, topic=topics.FORCE if bench.force.host else ""),
        # An oscilloscope is blind between its captures.
        power=replace(
            known.power, topic=topics.POWER if bench.oscilloscope.resource else "", intermittent=True
        ),
        angle_of_attack=replace(known.angle_of_attack, topic=kept if camera else ""),
        wind=replace(known.wind, topic=topics.WIND if bench.tunnel.resource else ""),
    )
    plain = to_mapping(mapped)
    return {key: value for key, value in plain.items() if value != to_mapping(TopicMap())[key]}


def record_bench(
    bench: BenchSettings, path: Path, seconds: float, on_step: Callable[[], None] = lambda: None
) -> tuple[list[InstrumentHealth], int]:
    """Record until the time is up, an instrument fails, or the program is interrupted.

    Parameters
    ----------
    seconds
        How long; 0 for without end.
    on_step
        Called ten times a second.

    Returns
    -------
    list of InstrumentHealth, int
        The last state of every instrument and the number of messages recorded.

    Raises
    ------
    InputError, InstrumentError
        An instrument cannot be opened, or the recording not be written.
    """
    session = Session(instruments(bench))
    identities = session.open()
    try:
        with LiveRecorder(path, bench, identities) as recorder:
            session.start()
            end = time.monotonic() + (seconds or float("inf"))
            with contextlib.suppress(KeyboardInterrupt):
                while time.monotonic() < end and not session.failed:
                    time.sleep(min(STEP, max(end - time.monotonic(), 0.0)))
                    recorder.write(session.take())
                    on_step()
            session.stop()
            recorder.write(session.take())
            return session.health(), recorder.messages
    finally:
        session.close()


def new_name(folder: Path, now: datetime | None = None) -> Path:
    """Give the name of a recording that begins now, in `folder`."""
    stamp = (now or datetime.now().astimezone()).strftime("%Y-%m-%dT%H-%M-%S")
    return folder / f"{stamp}-rig"
