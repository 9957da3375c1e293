# SPDX-License-Identifier: Apache-2.0
"""Clocks by trigger edges and by the flapping itself: 0.2 ms on offsets of 50 ms and a skew of 50 ppm."""

import json
from dataclasses import replace

import numpy as np
import pytest

from cwmav_common.mcap_reader import open_recording
from cwmav_rig.align import renumbered
from cwmav_rig.align_phase import fit_phase
from cwmav_rig.analysis import analyse, study
from cwmav_rig.blocks import Series
from cwmav_rig.synthesis_settings import Artefacts, Instruments, Synthesis
from cwmav_rig.synthesise import generate, synthesise
from cwmav_rig.topic_map import resolve

RATES = Instruments(force_rate=2000.0, power_rate=2000.0, camera_rate=500.0, tare_seconds=0.2)
BASE = Synthesis(seconds=30.0, seed=1, instruments=RATES)
CLOCK = {"power": "power", "angle_of_attack": "camera"}


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Give a recording, its truth and its own topic map."""
    path = tmp_path_factory.mktemp("clocks") / "a.mcap"
    synthesise(path, BASE)
    with open_recording(path) as recording:
        return path, json.loads(recording.metadata["cwmav"]["truth"]), resolve(recording, None)


def without_trigger(topic_map, lags=None):
    changed = replace(topic_map, trigger=type(topic_map.trigger)())
    for role, lag in (lags or {}).items():
        changed = replace(changed, **{role: replace(getattr(changed, role), phase_lag_deg=lag)})
    return changed


def test_trigger_and_flapping_agree_and_say_the_lag(recorded):
    path, truth, topic_map = recorded
    report = analyse(path, topic_map)
    for role, clock in CLOCK.items():
        note = report.clock_notes[role]
        assert note["method"] == "trigger"
        assert abs(report.clocks[role].offset - truth["clock_offsets_s"][clock]) < 0.2e-3
        assert note["offset_std_s"] < 0.1e-3
        assert abs(note["by_flapping_s"]) < 3.0 * note["by_flapping_std_s"]
    assert "by_flapping_s" not in report.clock_notes["wind"]


def test_with_a_known_lag_the_flapping_aligns_as_well_as_the_trigger(recorded):
    """The lag is measured on one recording with trigger and used on another one without.

    The current shows the flapping clearly. The angle from the camera rocks by less than its noise: it is as
    good as it says, 0.35 ms, in both recordings.
    """
    path, _, topic_map = recorded
    notes = analyse(path, topic_map).clock_notes
    lags = {role: notes[role]["phase_lag_deg"] for role in CLOCK}
    other = path.parent / "other.mcap"
    truth = synthesise(other, replace(BASE, seed=2))
    report = analyse(other, without_trigger(topic_map, lags))
    for role, clock in CLOCK.items():
        offset, skew = truth.clock_offsets_s[clock], truth.clock_skews[clock]
        fit = report.clocks[role]
        middle = fit.offset - offset + (fit.skew - skew) * BASE.seconds / 2.0
        said = report.clock_notes[role]["offset_std_s"]
        assert abs(middle) < (0.2e-3 if role == "power" else 3.0 * np.sqrt(2.0) * said), role
        assert said < (0.05e-3 if role == "power" else 0.5e-3)
        assert fit.skew == pytest.approx(skew, abs=1e-5)
        assert report.clock_notes[role]["method"] == "flapping"
    assert max(abs(value) for value in truth.clock_offsets_s.values()) > 0.04


def test_without_a_lag_the_offset_is_found_within_what_is_said(recorded):
    path, truth, topic_map = recorded
    report = analyse(path, without_trigger(topic_map))
    note = report.clock_notes["power"]
    assert abs(report.clocks["power"].offset - truth["clock_offsets_s"]["power"]) < 3.0 * note["offset_std_s"]
    assert note["offset_std_s"] < 2e-3
    assert report.clock_notes["wind"] == {"method": "none"}
    assert any("clock of wind: no trigger edges" in problem for problem in report.problems)
    assert any("clock of power: aligned by the flapping" in problem for problem in report.problems)


def test_noise_is_never_taken_for_flapping(recorded):
    path, _, topic_map = recorded
    found = study(path, topic_map)
    rng = np.random.default_rng(0)
    time = np.arange(0.0, 30.0, 0.002)
    for _ in range(20):
        noise = Series(time, rng.standard_normal(len(time)))
        assert fit_phase(found.cycles.bounds, noise) is None


def test_edges_without_numbers_survive_a_missed_one():
    reference = {k: float(k) for k in range(20)}
    missed = [k for k in range(20) if k not in (3, 11)]
    stamps = {n: 0.048 + k * (1.0 + 5e-5) for n, k in enumerate(missed)}
    assert sorted(renumbered(reference, stamps)) == missed


def test_lost_edges_do_no_harm(tmp_path):
    settings = replace(BASE, seconds=10.0, artefacts=Artefacts(trigger_loss=0.3))
    truth = synthesise(tmp_path / "a.mcap", settings)
    report = analyse(tmp_path / "a.mcap")
    assert report.clocks["power"].edges < 11
    assert report.clocks["power"].offset == pytest.approx(truth.clock_offsets_s["power"], abs=0.2e-3)


def test_a_clock_that_is_set_during_the_run_is_counted_and_does_not_bend_the_time(tmp_path):
    settings = replace(BASE, seconds=10.0, artefacts=Artefacts(time_jump=3.0))
    synthesise(tmp_path / "a.mcap", settings)
    report = analyse(tmp_path / "a.mcap")
    assert report.rejected["samples"]["force"] == {"time_jump": 1}
    assert report.flapping_frequency.mean == pytest.approx(
        generate(settings).truth.flapping_frequency_hz["realised_mean"], rel=2e-3
    )
