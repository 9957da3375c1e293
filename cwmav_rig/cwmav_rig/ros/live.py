# SPDX-License-Identifier: Apache-2.0
"""Node's side of live instruments: session, recording, health of each instrument."""

from __future__ import annotations

from pathlib import Path

from cwmav_common import interfaces
from cwmav_common.errors import InputError, WorkError
from cwmav_common.mcap_reader import Message, Topic
from cwmav_common.ros.diagnostics import Health
from cwmav_rig.instruments import BenchSettings, Identity, InstrumentHealth, Session, load_bench
from cwmav_rig.instruments.bench import instruments
from cwmav_rig.record import LiveRecorder, live_topic_map, new_name
from cwmav_rig.topic_map import TopicMap, from_plain


class LiveBench:
    """The instruments of one bench file, opened; they stream between :meth:`start` and :meth:`stop`.

    Parameters
    ----------
    path : bench file (YAML)

    Raises
    ------
    InputError
        The file or what it asks for is wrong.
    InstrumentError
        An instrument does not answer or is another one.
    """

    def __init__(self, path: str) -> None:
        self.path = path
        self.bench: BenchSettings = load_bench(path)
        self._session = Session(instruments(self.bench))
        self.identities: dict[str, Identity] = self._session.open()
        self._recorder: LiveRecorder | None = None
        self._trouble = ""
        self.streaming = False
        self.topic_map: TopicMap = from_plain(live_topic_map(self.bench), path)

    @property
    def topics(self) -> dict[str, Topic]:
        """The topics of the instruments with their types, as a recording would list them."""
        types = {
            self.topic_map.force.topic: "cwmav_msgs/msg/WrenchBlock",
            self.topic_map.power.topic: "cwmav_msgs/msg/PowerBlock",
            self.topic_map.wind.topic: "geometry_msgs/msg/TwistWithCovarianceStamped",
        }
        return {
            name: Topic(name, kind, interfaces.schema_text(kind), "cdr", 0)
            for name, kind in types.items()
            if name
        }

    @property
    def recording(self) -> Path | None:
        """The file that is being written."""
        return None if self._recorder is None else self._recorder.file

    def start(self, folder: str) -> None:
        """Begin to stream, and to record into `folder`; an empty name records nothing."""
        if folder:
            self._recorder = LiveRecorder(new_name(Path(folder)), self.bench, self.identities)
        try:
            self._session.start()
        except Exception:
            self._finish()
            raise
        self.streaming = True

    def take(self) -> list[Message]:
        """Give what came since the last call; it is in the recording already."""
        messages = self._session.take()
        if self._recorder is not None:
            try:
                self._recorder.write(messages)
            except WorkError as error:
                self._trouble, self._recorder = str(error), None
        return messages

    @property
    def failed(self) -> str:
        """Say which instruments failed, or why nothing is recorded; empty when all is well."""
        return "; ".join(what for what in (self._session.failed, self._trouble) if what)

    def stop(self) -> None:
        """Stop streaming; the recording is complete then."""
        self._session.stop()
        self.take()
        self._finish()
        self.streaming = False

    def close(self) -> None:
        """Stop and disconnect."""
        self.stop()
        self._session.close()

    def health_of(self, name: str) -> Health:
        """Give the health of one instrument."""
        return _health(next(found for found in self._session.health() if found.name == name))

    def _finish(self) -> None:
        recorder, self._recorder = self._recorder, None
        if recorder is not None:
            try:
                recorder.close()
            except WorkError as error:
                self._trouble = str(error)


def check_bench(path: str) -> None:
    """Refuse a bench file that cannot be read or names nothing; nothing is opened."""
    bench = load_bench(path)
    places = (bench.force.host, bench.oscilloscope.resource, bench.camera.folder, bench.camera.stream)
    if not any((*places, bench.tunnel.resource)):
        raise InputError(f"{path}: names no instrument")


def _health(found: InstrumentHealth) -> Health:
    values = {
        "instrument": found.identity,
        "received": found.received,
        "lost": found.lost,
        "dropped": found.dropped,
        "loss [%]": f"{100.0 * found.lost / max(found.received + found.lost, 1):.3f}",
        "rate [Hz]": f"{found.rate:.1f}",
        "expected rate [Hz]": f"{found.expected_rate:.1f}",
        "age [s]": f"{found.age:.3f}",
    }
    return Health(found.message or found.state, found.level, values)
