# SPDX-License-Identifier: Apache-2.0
"""Replay on a clock that the test turns, in lock step, and the live view of it."""

import contextlib
import json

import numpy as np
import pytest

from cwmav_common.errors import InputError
from cwmav_common.mcap_reader import open_recording
from cwmav_rig.analysis import analyse
from cwmav_rig.cli import main
from cwmav_rig.live import LiveRig
from cwmav_rig.replay import Player
from cwmav_rig.topic_map import resolve


class Hand:
    """A clock turned by hand."""

    def __init__(self):
        self.now = 1000.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Hand()


@pytest.fixture
def player(small_bag, clock):
    with Player(small_bag, clock=clock) as made:
        yield made


def everything(path):
    with open_recording(path) as recording:
        return [(m.topic, m.log_time_ns, m.data) for m in recording.messages()]


def run(player, clock, step=0.01, until=100.0, **poll):
    found = []
    end = clock.now + until
    while not player.finished and clock.now < end:
        clock.now += step
        found += [(m.topic, m.log_time_ns, m.data) for m in player.poll(**poll)]
    return found


@pytest.mark.parametrize("step", [0.001, 0.037, 3.0])
def test_the_clock_gives_everything_in_order_whatever_its_steps(small_bag, player, clock, step):
    player.start()
    assert run(player, clock, step) == everything(small_bag)
    assert player.finished
    assert not player.running


def test_messages_come_when_they_are_due(player, clock):
    player.start()
    begin = player.recorded_time_ns
    clock.now += 1.0
    due = player.poll()
    assert max(m.log_time_ns for m in due) <= begin + 1_000_000_000
    assert player.position == pytest.approx(1.0)
    wait = player.seconds_to_next()
    clock.now += 0.9 * wait
    assert player.poll() == []
    clock.now += 0.2 * wait
    assert player.poll()


def test_a_limit_spreads_a_burst_over_polls(small_bag, player, clock):
    player.start()
    clock.now += 100.0
    first = player.poll(limit=10)
    assert len(first) == 10
    rest = run(player, clock, limit=1000)
    assert len(rest) + 10 == len(everything(small_bag))


def test_pause_resume_rate_and_seek(player, clock):
    player.start()
    clock.now += 1.0
    player.pause()
    clock.now += 50.0
    assert player.position == pytest.approx(1.0)
    assert player.poll() == []
    assert player.seconds_to_next() is None
    player.resume()
    player.set_rate(2.0)
    clock.now += 0.5
    assert player.position == pytest.approx(2.0)
    player.seek(4.0)
    clock.now += 0.1
    times = [m.log_time_ns for m in player.poll()]
    begin = player.recording.span_ns[0]
    assert begin + 4_000_000_000 <= min(times)
    assert max(times) <= begin + 4_200_000_000
    player.seek(0.5)
    assert player.position == pytest.approx(0.5)


def test_a_loop_begins_at_the_offset_again(small_bag, clock):
    with Player(small_bag, clock=clock, loop=True, start_offset=5.0, rate=10.0) as player:
        player.start()
        found = run(player, clock, step=0.01, until=0.5)
        assert player.loops >= 2
        tail = [m for m in everything(small_bag) if m[1] >= player.recording.span_ns[0] + 5_000_000_000]
        assert found[: len(tail)] == tail
        assert found[len(tail) : len(tail) + 20] == tail[:20]


def test_start_after_the_end_plays_again(small_bag, player, clock):
    player.start()
    first = run(player, clock, 0.5)
    player.start()
    assert run(player, clock, 0.5) == first


def test_lock_step_gives_the_same_bytes_every_time(small_bag, player):
    runs = [[(m.topic, m.log_time_ns, m.data) for m in player.lock_step()] for _ in range(2)]
    assert runs[0] == runs[1] == everything(small_bag)


def test_only_chosen_topics_are_played(small_bag, clock):
    with Player(small_bag, topics=["/rig/airspeed"], clock=clock) as player:
        assert {m.topic for m in player.lock_step()} == {"/rig/airspeed"}


def test_wrong_positions_and_rates_are_refused(small_bag, player):
    with pytest.raises(InputError, match=r"position 99(\.0)? s; allowed: 0 to 6\.\d+ s"):
        player.seek(99.0)
    with pytest.raises(InputError, match=r"replay rate 0(\.0)?; allowed: 0\.01 to 1000"):
        player.set_rate(0.0)
    with pytest.raises(InputError, match="position -1"):
        Player(small_bag, start_offset=-1.0)


def test_a_live_rig_ends_with_the_report_of_the_file(small_bag, player, clock):
    rig = LiveRig(resolve(player.recording, None), player.recording.topics, "live")
    with pytest.raises(InputError, match="no messages yet"):
        rig.report()
    player.start()
    cycles = []
    while not player.finished:
        clock.now += 0.02
        cycles += rig.push(player.poll())
    live, file = rig.report(), analyse(small_bag)
    assert live.flapping_frequency == file.flapping_frequency
    assert live.lift == file.lift
    assert live.power == file.power
    assert live.clocks == file.clocks
    stamps = np.array([cycle.stamp_ns for cycle in cycles])
    assert (np.diff(stamps) > 0).all()
    assert len(cycles) >= file.cycles - 8
    frequencies = [cycle.frequency for cycle in cycles]
    assert np.mean(frequencies) == pytest.approx(file.flapping_frequency.mean, rel=0.01)
    rig.reset()
    with pytest.raises(InputError, match="no messages yet"):
        rig.report()


def test_a_live_rig_without_beat_gives_no_cycles(small_bag):
    with open_recording(small_bag) as recording:
        rig = LiveRig(resolve(recording, None), recording.topics, "live")
        still = [m for m in recording.messages() if m.topic != "/rig/wrench_block"]
        assert rig.push(still) == []
        with pytest.raises(InputError, match="no force samples"):
            rig.report()


def test_lock_step_says_every_time_what_the_live_view_says(small_bag, capsys, monkeypatch):
    outputs = []
    for _ in range(2):
        monkeypatch.setattr("sys.argv", ["cwmav-rig", "replay", str(small_bag), "--json"])
        with contextlib.suppress(SystemExit):
            main()
        outputs.append(capsys.readouterr().out)
    assert outputs[0] == outputs[1]
    content = json.loads(outputs[0])
    expected = analyse(small_bag)
    assert content["report"]["flapping_frequency_hz"]["std"] == pytest.approx(
        expected.flapping_frequency.std, rel=1e-9
    )
    stamps = [cycle["stamp_ns"] for cycle in content["cycles"]]
    assert stamps == sorted(stamps)
    assert len(stamps) > 0.8 * expected.cycles
