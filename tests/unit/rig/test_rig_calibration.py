# SPDX-License-Identifier: Apache-2.0
"""Zero, weight, pitch and drift from wind-off runs; what they must not be used for."""

from dataclasses import replace

import numpy as np
import pytest

from cwmav_rig.analysis import analyse
from cwmav_rig.calibration import TareError, TareRun, zero_for
from cwmav_rig.synthesis_settings import Artefacts, Instruments, Synthesis
from cwmav_rig.synthesise import synthesise
from cwmav_rig.topic_map import from_plain, load_topic_map

WEIGHT, PITCH, ZERO = 0.167, np.radians(0.8), np.array([0.03, -0.02, 0.05])


def hanging(degrees, time=0.0, drift=0.0, noise=0.0, rng=None, known=True):
    a = np.radians(degrees) + PITCH
    force = ZERO + np.array([-WEIGHT * np.sin(a), 0.0, -WEIGHT * np.cos(a)]) + drift * time
    if noise:
        force = force + noise * rng.standard_normal(3)
    return TareRun(time, np.concatenate((force, np.zeros(3))), np.radians(degrees) if known else None)


def test_two_attitudes_tell_zero_weight_and_pitch():
    zero = zero_for([hanging(0.0), hanging(40.0)], np.radians(15.0), (0.0, 30.0))
    expected = hanging(15.0).wrench
    np.testing.assert_allclose(zero.at(np.array([0.0, 30.0])), np.tile(expected, (2, 1)), atol=1e-12)
    assert zero.weight == pytest.approx(WEIGHT, rel=1e-9)
    assert zero.pitch == pytest.approx(PITCH, rel=1e-9)
    assert zero.attitudes == 2


def test_drift_is_told_from_the_weight_when_an_attitude_is_repeated():
    runs = [hanging(d, t, 1e-4) for d, t in ((0.0, -60.0), (20.0, -40.0), (40.0, -20.0), (0.0, 60.0))]
    zero = zero_for(runs, np.radians(15.0), (0.0, 30.0))
    found, expected = zero.at(np.array([12.0]))[0], hanging(15.0, 12.0, 1e-4).wrench
    np.testing.assert_allclose(found[[0, 2]], expected[[0, 2]], atol=1e-12)
    np.testing.assert_allclose(zero.drift[[0, 2]], 30.0 * 1e-4, rtol=1e-9)
    assert zero.weight == pytest.approx(WEIGHT, rel=1e-9)


def test_the_pitch_lies_within_what_is_said_of_it():
    held = 0
    for seed in range(200):
        rng = np.random.default_rng(seed)
        runs = [hanging(d, noise=5e-4, rng=rng) for d in (-10.0, 0.0, 15.0, 30.0, 45.0, 60.0)]
        zero = zero_for(runs, np.radians(15.0), (0.0, 30.0))
        held += abs(zero.pitch - PITCH) <= 2.0 * zero.pitch_std
    assert 0.86 <= held / 200 <= 0.99  # 8 degrees of freedom: 92 % within two standard uncertainties


def test_a_missing_attitude_is_refused_and_one_at_the_attitude_is_enough():
    run = hanging(15.3)
    zero = zero_for([run], np.radians(15.0), (0.0, 30.0))
    np.testing.assert_allclose(zero.at(np.array([3.0]))[0], run.wrench, atol=1e-15)
    assert zero.pitch is None
    assert np.isnan(zero.drift).all()
    with pytest.raises(TareError, match=r"stand at 40\.0 deg and the wings beat at 15\.0 deg; needed"):
        zero_for([hanging(40.0)], np.radians(15.0), (0.0, 30.0))


def test_runs_that_contradict_each_other_are_refused():
    runs = [hanging(15.0, t, known=False) for t in (-10.0, 0.0, 40.0)]
    moved = replace(runs[1], wrench=runs[1].wrench + 0.02)
    with pytest.raises(TareError, match=r"scatter by .* mN about a straight drift; at most 3 mN"):
        zero_for([runs[0], moved, runs[2]], np.radians(15.0), (0.0, 30.0))
    turned = [hanging(d) for d in (0.0, 15.0, 30.0, 45.0)]
    wrong = [*turned[:3], replace(turned[3], wrench=turned[3].wrench * 1.5)]
    with pytest.raises(TareError, match="about a weight that turns"):
        zero_for(wrong, np.radians(15.0), (0.0, 30.0))


RATES = Instruments(force_rate=1000.0, power_rate=1000.0, camera_rate=200.0, tare_seconds=0.5)
SENSOR = Artefacts(misalignment_deg=1.5, gain_error=0.0, thermal=0.0, bias_drift=0.0)
BASE = Synthesis(seconds=8.0, seed=5, sensor_seed=77, artefacts=SENSOR, instruments=RATES)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Give a flapping run at 15 deg and wind-off runs at 0, 30 and 50 deg with the same sensor."""
    place = tmp_path_factory.mktemp("tares")
    synthesise(place / "run.mcap", BASE)
    for angle in (0.0, 30.0, 50.0):
        still = replace(BASE, run="wind_off", angle_of_attack_deg=angle, seconds=3.0, seed=100 + int(angle))
        synthesise(place / f"off_{angle:.0f}.mcap", still)
    return place


def mapped(folder, tare, **force):
    topics = {
        "force": {"topic": "/rig/wrench_block", **force},
        "angle_of_attack": {"topic": "/rig/angle_of_attack"},
        "wind": {"topic": "/rig/airspeed"},
        "trigger": {"topic": "/rig/trigger"},
    }
    return from_plain({**topics, "tare": tare}, "map")


def test_wind_off_recordings_at_other_angles_serve_by_the_turned_weight(folder):
    truth = synthesise(folder / "again.mcap", BASE)
    tares = [str(folder / f"off_{angle}.mcap") for angle in (0, 30, 50)]
    report = analyse(folder / "run.mcap", mapped(folder, tares, alignment="tare"))
    assert report.lift.mean == pytest.approx(truth.lift_n, abs=1e-3)
    assert report.drag.mean == pytest.approx(truth.drag_n, abs=1e-3)
    given = analyse(folder / "run.mcap", mapped(folder, tares))
    assert abs(given.drag.mean - truth.drag_n) > 3e-3  # the pitch of the sensor was not told


def test_one_wind_off_recording_at_another_angle_is_refused(folder):
    report = analyse(folder / "run.mcap", mapped(folder, str(folder / "off_50.mcap")))
    assert report.lift is None
    assert any("wind-off runs stand at 50." in p or "stand at 49." in p for p in report.problems)
    report = analyse(folder / "run.mcap", mapped(folder, {"topic": "/rig/tare_block"}, alignment="tare"))
    assert any("alignment: tare needs wind-off runs at two angles" in problem for problem in report.problems)


def test_names_of_tare_recordings_are_relative_to_the_map(folder):
    path = folder / "map.yaml"
    path.write_text("force: {topic: /rig/wrench_block}\ntare: [off_0.mcap, off_30.mcap]\n")
    assert load_topic_map(path).tare_recordings == (str(folder / "off_0.mcap"), str(folder / "off_30.mcap"))
    report = analyse(folder / "run.mcap", load_topic_map(path))
    assert report.lift is None  # no angle mapped


def test_a_warm_sensor_is_corrected_by_its_temperature(tmp_path):
    """A cold wind-off recording serves a run in which the sensor warms by 2.8 K."""
    hot = replace(SENSOR, thermal=0.004, misalignment_deg=0.0)
    truth = synthesise(tmp_path / "run.mcap", replace(BASE, artefacts=hot, seconds=40.0))
    still = replace(BASE, artefacts=hot, run="wind_off", seconds=3.0, seed=9)
    synthesise(tmp_path / "off.mcap", still)
    force = {"temperature": "/rig/sensor_temperature", "temperature_coefficient": [0.004] * 3}
    warm = analyse(tmp_path / "run.mcap", mapped(tmp_path, str(tmp_path / "off.mcap"), **force))
    assert warm.lift.mean == pytest.approx(truth.lift_n, abs=1e-3)
    ignored = analyse(tmp_path / "run.mcap", mapped(tmp_path, str(tmp_path / "off.mcap")))
    assert abs(ignored.lift.mean - truth.lift_n) > 3e-3


def test_a_zero_that_runs_away_is_refused(tmp_path):
    synthesise(tmp_path / "a.mcap", replace(BASE, artefacts=replace(SENSOR, bias_drift=0.2)))
    report = analyse(tmp_path / "a.mcap")
    assert report.lift is None
    assert any("the zero drifts by" in problem and "at most 50 mN" in problem for problem in report.problems)
