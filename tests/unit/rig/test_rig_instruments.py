# SPDX-License-Identifier: Apache-2.0
"""Live instruments against simulated devices that speak their protocols."""

import json
import threading
import time
from importlib import resources
from itertools import pairwise

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from cwmav_common import interfaces
from cwmav_common.errors import InputError, WorkError
from cwmav_common.mcap_reader import open_recording
from cwmav_common.mcap_writer import BagWriter
from cwmav_rig import cli
from cwmav_rig.info import describe
from cwmav_rig.instruments import BenchSettings, InstrumentError, Session, load_bench
from cwmav_rig.instruments.bench import instruments
from cwmav_rig.instruments.camera import FolderCamera, StreamCamera
from cwmav_rig.instruments.net_ft import SampleClock
from cwmav_rig.instruments.oscilloscope import read_scaling
from cwmav_rig.instruments.settings import (
    CameraSettings,
    NetFtSettings,
    OscilloscopeSettings,
    TunnelSettings,
)
from cwmav_rig.record import LiveRecorder, record_bench
from cwmav_rig.simulated.net_box import SimulatedNetBox
from cwmav_rig.simulated.scpi_server import TUNNEL, SimulatedScpi

VISA = f"{resources.files('cwmav_rig') / 'simulated' / 'visa.yaml'}@sim"
pytest.importorskip("pyvisa")


def force(box, rate=2000.0, **more):
    ports = {"rdt_port": box.rdt_port, "http_port": box.http_port}
    return NetFtSettings(host="127.0.0.1", rate=rate, **{"stall": 20.0, **ports, **more})


def until(condition, what, seconds=20.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, what
        time.sleep(0.02)


def gather(session, count, seconds=20.0):
    """Take messages until there are `count`."""
    found = []
    until(lambda: len(found.extend(session.take()) or found) >= count, f"{count} messages", seconds)
    return found


def decoded(messages):
    return [interfaces.deserialise(message.data, message.type_name) for message in messages]


# --- force sensor ------------------------------------------------------------------------------------------


@pytest.fixture
def netft():
    return pytest.importorskip("pynetft")


def test_net_box_gives_blocks_in_si_units_and_counts_what_is_lost(netft):
    def wrench(n):
        return (0.001 * n, 0.2, -1.5, 0.003, 0.0, -0.002)

    with SimulatedNetBox(wrench, 2000.0, lose=lambda n: n in (350, 351), first=100) as box:
        session = Session(instruments(BenchSettings(force=force(box, block=50))))
        identity = session.open()["force"]
        assert identity.name == "Simulated Net F/T"
        assert identity.details["torque_unit"] == "N-mm"
        session.start()
        blocks = decoded(gather(session, 8))
        (health,) = session.health()
        session.close()
    rows = [block.data.reshape(-1, 6) for block in blocks]
    for column, value in enumerate((0.2, -1.5, 0.003, 0.0, -0.002), start=1):
        np.testing.assert_allclose(np.concatenate(rows)[:, column], value, rtol=1e-5)
    for before, after, row in zip(blocks, blocks[1:], rows, strict=False):
        assert after.sequence == before.sequence + len(row) + after.lost
        moved = (after.data[0] - before.data[0]) * 1000.0
        assert moved == pytest.approx(after.sequence - before.sequence, abs=0.01)
    assert sum(block.lost for block in blocks) <= 2
    stamps = np.array([interfaces_ns(block) for block in blocks])
    steps = np.diff(stamps) * 1e-9 * 2000.0 - np.diff([block.sequence for block in blocks])
    assert np.abs(steps).max() < 40  # samples: 20 ms of a busy machine
    assert health.state == "streaming"
    assert health.received >= sum(map(len, rows))


def interfaces_ns(block):
    return block.header.stamp.sec * 1_000_000_000 + block.header.stamp.nanosec


def test_lost_and_overloaded_samples_are_in_the_blocks(netft):
    with SimulatedNetBox(
        rate=1000.0, lose=lambda n: n % 100 == 60, status=lambda n: 0x80020000 * (n % 500 == 0)
    ) as box:
        session = Session(instruments(BenchSettings(force=force(box, 1000.0, block=50))))
        session.open()
        session.start()
        blocks = decoded(gather(session, 24))
        health = session.health()[0]
        session.close()
    lost, received = sum(b.lost for b in blocks[1:]), sum(len(b.data) // 6 for b in blocks[1:])
    assert lost / (lost + received) > 0.008  # one in a hundred, and those around an overload
    flagged = [b for b in blocks if b.overload]
    assert 1 <= len(flagged) <= 6
    calm = [b for b in blocks if not b.overload]
    assert max(b.lost for b in calm[1:]) <= 1  # the time decides only after a restart
    assert health.lost >= lost
    assert health.state == "streaming"
    ends = [b.sequence + len(b.data) // 6 for b in blocks]
    assert all(after.sequence == end + after.lost for end, after in zip(ends, blocks[1:], strict=False))
    late = [interfaces_ns(b) * 1e-6 - b.sequence for b in blocks]
    assert np.ptp(late) < 200  # ms, on a busy machine; the time goes on through the restarts


def test_the_count_of_the_net_box_may_wrap(netft):
    with SimulatedNetBox(rate=1000.0, first=(1 << 32) - 400) as box:
        session = Session(instruments(BenchSettings(force=force(box, 1000.0, block=100))))
        session.open()
        session.start()
        blocks = decoded(gather(session, 7))
        session.close()
    sequences = [block.sequence for block in blocks]
    assert sequences == sorted(sequences)
    assert sequences[-1] < 5000
    assert sum(block.lost for block in blocks) == 0


def test_unplugging_is_an_error_that_names_the_sensor(netft):
    with SimulatedNetBox(rate=1000.0) as box:
        session = Session(instruments(BenchSettings(force=force(box, 1000.0, stall=0.4))))
        session.open()
        session.start()
        gather(session, 2)
        box.unplug()
        until(lambda: session.failed, "the error")
        assert session.failed.startswith("force: ")
        assert session.health()[0].level == "error"
        session.close()
        box.plug()
        session.open()  # plugged in again
        session.start()
        gather(session, 2)
        assert not session.failed
        session.close()


def test_nobody_at_the_address_is_an_error(netft):
    settings = NetFtSettings(host="127.0.0.1", rdt_port=1, http_port=1)
    with pytest.raises(InstrumentError, match=r"force: 127\.0\.0\.1 (is not reached|sends no samples)"):
        Session(instruments(BenchSettings(force=settings))).open()


def test_late_datagrams_do_not_move_the_clock_of_the_samples():
    rng = np.random.default_rng(0)
    clock, worst = SampleClock(1000.0), []
    for n in range(20_000):
        true = 5e12 + n * 1e6 * (1.0 + 20e-6)  # a crystal that is 20 ppm slow
        late = rng.exponential(1e6) + (50e6 if rng.random() < 0.01 else 0.0)
        worst.append(clock.at(n, round(true + late)) - true)
    assert np.abs(worst[5000:]).max() < 2e6


# --- oscilloscope and tunnel -------------------------------------------------------------------------------


def test_oscilloscope_over_a_socket_with_binary_waveforms():
    with SimulatedScpi() as scope:
        settings = OscilloscopeSettings(resource=scope.resource, identify="Scope")
        session = Session(instruments(BenchSettings(oscilloscope=settings)))
        assert session.open()["oscilloscope"].name == "Simulated,Scope,0,1.0"
        session.start()
        blocks = decoded(gather(session, 3))
        health = session.health()[0]
        session.close()
    voltage, current = (np.concatenate([getattr(b, name) for b in blocks]) for name in ("voltage", "current"))
    assert voltage.mean() == pytest.approx(4.0, abs=0.05)
    assert current.mean() == pytest.approx(0.33, abs=0.05)
    assert np.corrcoef(voltage, current)[0, 1] < -0.8  # the supply gives way under load
    assert blocks[0].sample_rate_hz == pytest.approx(10_000.0)
    for before, after in pairwise(blocks):
        assert after.sequence == before.sequence + 1000 + after.lost
    assert health.received >= 3000


def test_oscilloscope_and_tunnel_of_the_simulated_visa_library():
    scope = OscilloscopeSettings(
        resource="TCPIP::192.0.2.5::INSTR", backend=VISA, setup=(":WAV:FORM ASC",), source="", arm="",
        waveform=":WAV:DATA? CHAN{channel}", data_format="ascii",
    )  # fmt: skip
    tunnel = TunnelSettings(resource="ASRL1::INSTR", backend=VISA, rate=50.0, identify="Tunnel", gain=2.0)
    session = Session(instruments(BenchSettings(oscilloscope=scope, tunnel=tunnel)))
    identities = session.open()
    assert identities["tunnel"].name == "Simulated,Tunnel,0,1.0"
    session.start()
    messages = []
    until(
        lambda: len({m.topic for m in (messages.extend(session.take()) or messages)}) == 2, "both instruments"
    )
    session.close()
    by_topic = {
        message.topic: interfaces.deserialise(message.data, message.type_name) for message in messages
    }
    assert by_topic["/rig/airspeed"].twist.twist.linear.x == pytest.approx(7.024)
    assert by_topic["/rig/airspeed"].twist.covariance[0] == pytest.approx(0.01)
    np.testing.assert_allclose(by_topic["/rig/power_block"].voltage[:4], [4.0, 3.9, 4.0, 4.1], rtol=1e-6)
    np.testing.assert_allclose(by_topic["/rig/power_block"].current[:4], [0.3, 0.4, 0.3, 0.2], rtol=1e-6)
    assert by_topic["/rig/power_block"].sample_rate_hz == pytest.approx(200.0)


def test_another_instrument_at_the_address_is_refused():
    settings = TunnelSettings(resource="ASRL1::INSTR", backend=VISA, identify="Pitot")
    with pytest.raises(
        InstrumentError, match="tunnel: ASRL1::INSTR is 'Simulated,Tunnel,0,1.0', expected 'Pitot'"
    ):
        Session(instruments(BenchSettings(tunnel=settings))).open()
    nobody = TunnelSettings(resource="TCPIP::127.0.0.1::1::SOCKET")
    with pytest.raises(InstrumentError, match=r"tunnel: TCPIP::127\.0\.0\.1::1::SOCKET"):
        Session(instruments(BenchSettings(tunnel=nobody))).open()


def test_a_tunnel_that_stutters_and_one_that_is_cut():
    answers = iter(["3.4", "nonsense", "", "3.6 m/s", "nan"] + ["3.5"] * 1000)
    with SimulatedScpi(speed=lambda t: next(answers), identity=TUNNEL) as sensor:
        settings = TunnelSettings(resource=sensor.resource, rate=100.0)
        session = Session(instruments(BenchSettings(tunnel=settings)))
        session.open()
        session.start()
        speeds = [m.twist.twist.linear.x for m in decoded(gather(session, 4))]
        assert speeds[:2] == [3.4, 3.6]
        sensor.unplug()
        until(lambda: session.failed, "the error")
        assert session.failed.startswith("tunnel: TCPIP")
        session.close()


def test_preambles_that_are_none_are_refused():
    scaling = read_scaling("0,0,1000,1,1e-4,0,0,0.02,2,100", "oscilloscope")
    assert scaling.volts(np.array([150.0])) == pytest.approx(0.96)
    for text in ("", "1,2,3", "a,b,c,d,e,f,g,h,i,j", "0,0,1,1,0,0,0,1,0,0"):
        with pytest.raises(InstrumentError, match="expected ten numbers"):
            read_scaling(text, "oscilloscope")


# --- camera ------------------------------------------------------------------------------------------------


def picture(value):
    return np.full((20, 30), value, np.uint8)


def look(camera):
    return [reading for _ in range(3) for reading in camera.read()]


def test_pictures_that_appear_in_a_folder(tmp_path):
    cv2.imwrite(str(tmp_path / "frame_0000.png"), picture(1))
    camera = FolderCamera(CameraSettings(folder=str(tmp_path), rate=500.0))
    camera.open()
    camera.start()
    assert look(camera) == []  # was there before
    for number in (10, 11, 14):
        cv2.imwrite(str(tmp_path / f"frame_{number:04d}.png"), picture(number))
    (tmp_path / "notes.txt").write_text("no picture")
    found = look(camera)
    stamps = [interfaces_ns(reading.message) for reading in found]
    np.testing.assert_allclose(np.diff(stamps), [2_000_000, 6_000_000])
    assert [reading.lost for reading in found] == [0, 0, 2]
    assert found[0].message.format == "png"
    shown = cv2.imdecode(np.asarray(found[2].message.data), cv2.IMREAD_GRAYSCALE)
    np.testing.assert_array_equal(shown, picture(14))
    cv2.imwrite(str(tmp_path / "frame_0015.bmp"), picture(15))
    (tmp_path / "frame_0016.bmp").write_bytes(b"broken")
    cv2.imwrite(str(tmp_path / "frame_0017.bmp"), picture(17))
    grey = look(camera)
    assert [reading.message.encoding for reading in grey] == ["mono8", "mono8"]
    assert [reading.lost for reading in grey] == [0, 1]
    for path in tmp_path.iterdir():
        path.unlink()
    tmp_path.rmdir()
    with pytest.raises(InstrumentError, match="is gone"):
        camera.read()


def test_a_video_stream_and_its_end(tmp_path):
    for number in range(5):
        cv2.imwrite(str(tmp_path / f"v_{number:03d}.png"), picture(10 * number))
    camera = StreamCamera(CameraSettings(stream=str(tmp_path / "v_%03d.png")))
    camera.open()
    camera.start()
    first = camera.read()[0].message
    assert (first.height, first.width, first.encoding) == (20, 30, "mono8")
    for _ in range(3):
        camera.read()
    with pytest.raises(InstrumentError, match="ended"):
        camera.read()
    camera.close()
    with pytest.raises(InstrumentError, match="gives no frames"):
        StreamCamera(CameraSettings(stream=str(tmp_path / "none.avi"))).open()


# --- bench and recording -----------------------------------------------------------------------------------


def test_a_bench_is_read_from_yaml_and_wrong_ones_say_what_is_allowed(tmp_path):
    path = tmp_path / "bench.yaml"
    path.write_text("force: {host: 192.168.1.1, rate: 5000}\ntunnel: {resource: ASRL1::INSTR}\n")
    assert load_bench(path).force.rate == 5000.0
    path.write_text("force: {host: 192.168.1.1, speed: 3}\n")
    with pytest.raises(InputError, match=r"bench\.yaml: unknown key 'force\.speed'"):
        load_bench(path)
    with pytest.raises(InputError, match="no instrument on the bench"):
        instruments(BenchSettings())
    both = BenchSettings(camera=CameraSettings(folder="a", stream="0"))
    with pytest.raises(InputError, match="folder and stream"):
        instruments(both)


def test_everything_is_recorded_with_its_identity_and_read_again(tmp_path):
    with SimulatedScpi() as scope, SimulatedScpi(identity=TUNNEL) as sensor:
        bench = BenchSettings(
            oscilloscope=OscilloscopeSettings(resource=scope.resource),
            tunnel=TunnelSettings(resource=sensor.resource, rate=50.0),
        )
        health, count = record_bench(bench, tmp_path / "run", 1.0)
        with pytest.raises(InputError, match="exists; recordings are never written over"):
            LiveRecorder(tmp_path / "run", bench, {})
    assert [h.state for h in health] == ["open", "open"]
    with open_recording(tmp_path / "run") as recording:
        assert sum(topic.count for topic in recording.topics.values()) == count
        marks = recording.metadata["cwmav"]
        assert recording.topics["/rig/airspeed"].count >= 20
        assert not recording.problems
    assert "synthetic" not in marks
    assert describe(tmp_path / "run").instruments["tunnel"] == TUNNEL
    assert json.loads(marks["instruments"])["oscilloscope"]["name"] == "Simulated,Scope,0,1.0"
    assert json.loads(marks["topic_map"])["power"]["topic"] == "/rig/power_block"


def test_a_cut_instrument_ends_the_recording_and_what_came_is_kept(tmp_path):
    path = tmp_path / "bench.yaml"
    with SimulatedScpi(identity=TUNNEL) as sensor:
        path.write_text(f"tunnel: {{resource: '{sensor.resource}', rate: 50}}\n")
        sensor_thread = threading.Timer(1.0, sensor.unplug)
        sensor_thread.start()
        result = CliRunner().invoke(
            cli.cli, ["record", str(path), "--out", str(tmp_path / "a.mcap"), "--json"]
        )
        sensor_thread.join()
    assert result.exit_code != 0
    assert "tunnel: TCPIP" in str(result.exception)
    assert json.loads(result.stdout)["instruments"][0]["samples"] > 5
    with open_recording(tmp_path / "a.mcap") as recording:
        assert recording.topics["/rig/airspeed"].count > 5


def test_a_full_disk_ends_the_recording_with_what_it_holds(tmp_path, monkeypatch):
    with SimulatedScpi(identity=TUNNEL) as sensor:
        bench = BenchSettings(tunnel=TunnelSettings(resource=sensor.resource, rate=50.0))
        written, write = [], BagWriter.write_raw

        def full(self, *message):
            if len(written) == 20:
                raise OSError(28, "No space left on device")
            written.append(message)
            write(self, *message)

        monkeypatch.setattr(BagWriter, "write_raw", full)
        with pytest.raises(WorkError, match=r"run: cannot be written \(No space left on device\)"):
            record_bench(bench, tmp_path / "run", 5.0)
    with open_recording(tmp_path / "run") as recording:
        assert recording.topics["/rig/airspeed"].count == 20
