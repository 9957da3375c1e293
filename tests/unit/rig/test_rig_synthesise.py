# SPDX-License-Identifier: Apache-2.0
"""Synthetic recordings: repeatable, marked, with the physics they claim."""

import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from cwmav_common import interfaces
from cwmav_common.errors import InputError
from cwmav_common.mcap_reader import open_recording
from cwmav_rig.physics import aero, drive, sensor
from cwmav_rig.physics.scatter import frequency_process
from cwmav_rig.synthesis_settings import Artefacts, Instruments, Scatter, Synthesis
from cwmav_rig.synthesise import generate, synthesise
from support.rig_recordings import SMALL, stamp_ns

SHORT = replace(SMALL, seconds=1.5)


def test_the_same_seed_gives_the_same_bytes_and_another_does_not(tmp_path):
    paths = [tmp_path / f"{name}.mcap" for name in "abc"]
    for path, seed in zip(paths, (5, 5, 6), strict=True):
        synthesise(path, replace(SHORT, seed=seed))
    assert paths[0].read_bytes() == paths[1].read_bytes()
    assert paths[0].read_bytes() != paths[2].read_bytes()


def test_a_recording_is_marked_and_carries_its_truth(tmp_path):
    truth = synthesise(tmp_path / "bag", SHORT)
    assert (tmp_path / "bag" / "metadata.yaml").exists()
    with open_recording(tmp_path / "bag") as recording:
        marks = recording.metadata["cwmav"]
        (message,) = recording.messages(["/rig/truth"])
    assert marks["synthetic"] == "true"
    stored = json.loads(marks["truth"])
    assert stored == json.loads(json.dumps(vars(truth)))
    told = interfaces.deserialise(message.data, message.type_name).data
    assert told.startswith("SYNTHETIC ")
    assert json.loads(told.removeprefix("SYNTHETIC ")) == stored
    assert json.loads(marks["settings"])["seed"] == SHORT.seed


def test_stamps_are_acquisition_times_and_log_times_follow(tmp_path):
    synthesise(tmp_path / "a.mcap", replace(SHORT, artefacts=Artefacts(clock_offset=0.0, clock_skew=0.0)))
    with open_recording(tmp_path / "a.mcap") as recording:
        delays = {}
        for message in recording.messages():
            if message.type_name != "std_msgs/msg/String" and message.topic != "/rig/tare_block":
                decoded = interfaces.deserialise(message.data, message.type_name)
                delays.setdefault(message.topic, []).append(message.log_time_ns - stamp_ns(decoded))
    for topic, values in delays.items():
        assert 0.0 < min(values) * 1e-9 <= max(values) * 1e-9 < 0.06, topic


def test_the_view_is_the_mean_of_the_block(tmp_path):
    synthesise(tmp_path / "a.mcap", SHORT)
    with open_recording(tmp_path / "a.mcap") as recording:
        block, view = (
            [interfaces.deserialise(m.data, m.type_name) for m in recording.messages([topic])]
            for topic in ("/rig/wrench_block", "/rig/wrench")
        )
    data = np.concatenate([b.data.reshape(-1, 6) for b in block])
    assert len(view) == 150
    assert view[7].wrench.force.z == pytest.approx(data[140:160, 2].mean(), rel=1e-5)
    assert view[7].wrench.torque.y == pytest.approx(data[140:160, 4].mean(), rel=1e-4)


def test_an_artefact_alone_changes_only_its_stream():
    plain, quiet = generate(SHORT), generate(replace(SHORT, artefacts=Artefacts(mains=0.0)))
    assert not np.array_equal(plain.force, quiet.force)
    np.testing.assert_array_equal(plain.voltage, quiet.voltage)
    np.testing.assert_array_equal(plain.angle, quiet.angle)
    np.testing.assert_array_equal(plain.wind, quiet.wind)


def _lag(signals):
    """Correlate the current with the voltage turned over and give the samples by which it follows."""
    v, i = -signals.voltage + signals.voltage.mean(), signals.current - signals.current.mean()
    return int(np.argmax([np.dot(v[20:-60], i[20 + k : len(i) - 60 + k]) for k in range(-10, 40)])) - 10


@pytest.mark.parametrize(
    ("artefact", "seen"),
    [
        ({"saturation": 80.0}, lambda s, _: s.overload.any()),
        ({"frame_drop": 0.1}, lambda s, p: len(s.angle) < 0.95 * len(p.angle)),
        ({"frame_duplicate": 0.1}, lambda s, p: len(s.angle) > 1.05 * len(p.angle)),
        ({"weight": 0.0}, lambda s, p: abs(np.mean(s.force[:, 2] - p.force[:, 2]) - 0.161) < 0.01),
        ({"shunt_offset": 0.02}, lambda s, p: abs(np.mean(s.current - p.current) - 0.02) < 1e-3),
        ({"least_count": 0.5}, lambda s, _: len(np.unique(s.force[:, 2])) < 8),
        ({"inertia": 0.0}, lambda s, p: s.force[:, 2].std() < 0.5 * p.force[:, 2].std()),
        ({"resonance_frequency": 24.0}, lambda s, p: s.force[:, 2].std() > 2 * p.force[:, 2].std()),
        ({"scope_bits": 4}, lambda s, p: len(np.unique(s.current)) < 0.5 * len(np.unique(p.current))),
        ({"warm_up": 1.0}, lambda s, p: np.mean(s.force - p.force, axis=0)[1] > 0.9),
        ({"pwm": 0.5}, lambda s, p: s.force[:, 2].std() > p.force[:, 2].std() + 0.05),
        ({"misalignment_yaw_deg": 5.0}, lambda s, p: s.force[:, 1].std() > 1.15 * p.force[:, 1].std()),
        ({"misalignment_deg": 5.0}, lambda s, p: np.std(s.force[:, 0] - p.force[:, 0]) > 0.02),
        ({"blockage": 0.05}, lambda s, p: abs(np.mean(p.wind / s.wind) - 1.05) < 1e-3),
        ({"channel_skew": 2e-3}, lambda s, p: abs(_lag(s) - _lag(p) - 4) <= 1),
        (
            {"rolling_stamp": 5e-3},
            lambda s, p: np.ptp(s.angle_stamps - p.angle_stamps[: len(s.angle_stamps)]) > 4e-3,
        ),
        (
            {"gain_error": 0.5},
            lambda s, p: abs(s.truth.force_gain - 1.0) > 10 * abs(p.truth.force_gain - 1.0),
        ),
        ({"force_offset": 5.0}, lambda s, p: np.abs(np.mean(s.force - p.force, axis=0)[:3]).max() > 0.5),
        ({"bias_drift": 0.2}, lambda s, p: np.abs(np.mean(s.force - p.force, axis=0)[:3]).max() > 0.02),
        ({"thermal": 0.5}, lambda s, p: np.mean(s.force - p.force, axis=0)[1] > 0.05),
        ({"white_noise": 0.5}, lambda s, p: s.force[:, 1].std() > 0.4),
        ({"clock_offset": 0.5}, lambda s, _: max(abs(c.offset) for c in s.clocks.values()) > 0.06),
        ({"clock_skew": 5e-3}, lambda s, _: max(abs(c.skew) for c in s.clocks.values()) > 1e-4),
        ({"commutation": 0.5}, lambda s, p: np.diff(s.current).std() > 2 * np.diff(p.current).std()),
        ({"source_resistance": 0.0}, lambda s, p: s.voltage.std() < 0.5 * p.voltage.std()),
        ({"pixel_noise_deg": 0.0}, lambda s, p: np.diff(s.angle).std() < 0.7 * np.diff(p.angle).std()),
        ({"current_ripple": 0.0}, lambda s, p: s.current.std() < 0.5 * p.current.std()),
    ],
)
def test_every_artefact_shows(artefact, seen):
    settings = replace(SHORT, seconds=5.0)
    assert seen(generate(replace(settings, artefacts=Artefacts(**artefact))), generate(settings))


def test_faults_of_the_recorder_show_in_the_file(tmp_path):
    art = Artefacts(lost_blocks=0.3, nan_samples=0.3, stuck=0.3)
    synthesise(tmp_path / "a.mcap", replace(SHORT, seconds=5.0, artefacts=art))
    with open_recording(tmp_path / "a.mcap") as recording:
        blocks = [
            interfaces.deserialise(m.data, m.type_name) for m in recording.messages(["/rig/wrench_block"])
        ]
    assert 50 < len(blocks) < 90
    for before, after in pairwise(blocks):
        assert after.sequence - before.sequence == 100 + after.lost
    assert sum(np.isnan(b.data).any() for b in blocks) > 10
    stuck = [b for b in blocks if (np.diff(b.data.reshape(-1, 6)[:30], axis=0) == 0).all()]
    assert len(stuck) > 10


def test_power_of_the_physical_model_has_the_published_values():
    """Bench supply at 4 V: 1.01, 1.18, 1.33, 1.77, 2.34 W at 8, 10.4, 12, 16, 20 Hz."""
    expected = {8.0: 1.01, 10.4: 1.18, 12.0: 1.33, 16.0: 1.77, 20.0: 2.34}
    for frequency, power in expected.items():
        assert drive.physical_power(frequency) == pytest.approx(power, abs=0.01)


def test_power_of_the_law():
    """0.35 + 0.202 L F + 0.0435 U^2 sin^2(AoA) F at 10.36 Hz, 21.5 deg, 3 m/s and 0.157 N: 1.22 W."""
    point = aero.Point(10.36, float(np.radians(21.5)), 3.0)
    assert drive.paper_power(point, 0.157) == pytest.approx(1.2234, abs=1e-3)
    assert drive.electrical_power("paper_law", point) != drive.electrical_power("physical", point)
    with pytest.raises(InputError, match="allowed: physical, paper_law"):
        drive.electrical_power("solar", point)


@pytest.mark.parametrize("resistance", [0.0, 0.5, 2.0])
def test_supply_gives_the_power_asked_for(resistance):
    power = 1.3 * drive.current_shape(np.linspace(0, 20 * np.pi, 5000, endpoint=False), 0.5)
    voltage, current = drive.supply(power, resistance)
    np.testing.assert_allclose(voltage * current, power, rtol=1e-12)
    assert voltage.mean() == pytest.approx(4.0, rel=0.02)
    slope = np.polyfit(current, voltage, 1)[0]
    assert slope == pytest.approx(-min(resistance, 0.4 / (1.3 / 4.0)), abs=1e-9)


def test_lift_of_the_signal_model_is_near_the_published_table():
    rows = [(12, 3.5, 15, 0.1616), (16, 3.5, 15, 0.1639), (16, 4.5, 15, 0.2285), (16, 0.5, 15, 0.0372)]
    for frequency, airspeed, angle, lift in rows:
        assert aero.mean_lift(aero.Point(frequency, np.radians(angle), airspeed)) == pytest.approx(
            lift, rel=0.15
        )


def test_cycle_averages_scatter_as_asked():
    rng = np.random.default_rng(0)
    frequency = frequency_process(1_200_000, 1e-3, 12.0, 0.153, 0.8, rng)
    averages = frequency[: len(frequency) // 83 * 83].reshape(-1, 83).mean(axis=1)
    assert averages.std() == pytest.approx(0.153, rel=0.03)


def test_resonance_keeps_the_mean_and_lifts_its_frequency():
    time = np.arange(40_000) / 10_000
    constant = sensor.resonance(np.full(1000, 2.0), 1e4, 75.0, 0.02)
    np.testing.assert_allclose(constant, 2.0, rtol=1e-9)
    ringing = sensor.resonance(np.sin(2 * np.pi * 75.0 * time), 1e4, 75.0, 0.02)
    assert np.abs(ringing[20_000:]).max() == pytest.approx(25.0, rel=0.02)  # 1 / (2 zeta)


def test_the_angle_has_the_scatter_asked_for():
    settings = Synthesis(
        seconds=60.0,
        seed=1,
        scatter=Scatter(angle_deg=0.8),
        instruments=Instruments(force_rate=500.0, power_rate=500.0, camera_rate=500.0),
    )
    signals = generate(settings)
    assert np.degrees(signals.angle.std()) == pytest.approx(0.8, rel=0.08)
    assert signals.truth.angle_of_attack_deg["std"] == pytest.approx(0.8)


def test_a_place_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="file"):
        synthesise(tmp_path / "file" / "bag" / "a.mcap", SHORT)


def test_a_still_run_holds_weight_alone_or_weight_and_wind():
    quiet = Artefacts(bias_drift=0.0, gain_error=0.0, force_offset=0.0, misalignment_deg=0.0)
    base = replace(SHORT, seconds=3.0, artefacts=quiet, scatter=Scatter(angle_deg=0.0, angle_rocking_deg=0.0))
    off, wind = (generate(replace(base, run=run)) for run in ("wind_off", "wings_still"))
    angle, weight = np.radians(15.0), quiet.weight
    expected = (-weight * np.sin(angle), 0.0, -weight * np.cos(angle))
    np.testing.assert_allclose(off.force[:, :3].mean(axis=0), expected, atol=1e-3)
    assert off.tares == ()
    assert off.wind.max() == 0.0
    assert wind.force[:, 2].mean() > off.force[:, 2].mean() + 0.01
    assert wind.wind.mean() == pytest.approx(3.5, abs=0.1)
    assert off.truth.cycles == wind.truth.cycles == 0
    assert (off.voltage * off.current).mean() == pytest.approx(0.2, rel=0.1)  # electronics alone


def test_recordings_may_share_a_sensor():
    a, b, c = (
        generate(replace(SHORT, seed=seed, sensor_seed=sensor))
        for seed, sensor in ((1, 9), (2, 9), (2, None))
    )
    assert a.truth.force_gain == b.truth.force_gain != c.truth.force_gain


def test_lost_edges_and_jumps_show_in_the_file(tmp_path):
    synthesise(
        tmp_path / "a.mcap", replace(SHORT, seconds=6.0, artefacts=Artefacts(trigger_loss=0.5, time_jump=2.0))
    )
    with open_recording(tmp_path / "a.mcap") as recording:
        assert recording.topics["/rig/trigger"].count < 26
        blocks = [
            interfaces.deserialise(m.data, m.type_name) for m in recording.messages(["/rig/wrench_block"])
        ]
    steps = np.diff([stamp_ns(block) for block in blocks]) * 1e-9
    assert sum(steps > 1.5) == 1
    assert {block.lost for block in blocks} == {0}
