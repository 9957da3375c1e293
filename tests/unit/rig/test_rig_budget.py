# SPDX-License-Identifier: Apache-2.0
"""Uncertainty budgets, correlations, spectra, phase averages, pictures: right numbers and honest ones."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest

from cwmav_rig.analysis import analyse, study, study_data
from cwmav_rig.blocks import Block
from cwmav_rig.budget import Budget, Row
from cwmav_rig.correlation import correlations
from cwmav_rig.cycles import Cycles
from cwmav_rig.phase_average import phase_average
from cwmav_rig.physics.scatter import memory_process
from cwmav_rig.plots import write_all
from cwmav_rig.power import Deskew, channel_delay
from cwmav_rig.raw_spectrum import SpectrumCollector, remarks
from cwmav_rig.spectra import power_spectrum, probability_density
from cwmav_rig.synthesis_settings import Artefacts, Instruments, Synthesis
from cwmav_rig.synthesise import synthesise
from support.rig_recordings import SMALL

RATES = Instruments(force_rate=1000.0, power_rate=1000.0, camera_rate=100.0, view_rate=0.0, tare_seconds=0.5)


def test_the_arithmetic_is_that_of_the_guide():
    """JCGM 100 example H.2-like: 3 and 4 give 5; Welch-Satterthwaite 5^4 / (3^4/4 + 4^4/9)."""
    budget = Budget("x", "N", 1.0, (Row("a", "A", 3.0, "N", 1.0, 4.0), Row("b", "A", 2.0, "V", -2.0, 9.0)))
    assert budget.combined == pytest.approx(5.0)
    assert budget.dof == pytest.approx(625.0 / (81.0 / 4.0 + 256.0 / 9.0))
    assert budget.coverage_factor == pytest.approx(2.17, abs=0.02)  # Student's t at 12.8 degrees of freedom
    assert budget.expanded == pytest.approx(5.0 * budget.coverage_factor)
    lines = list(budget.lines())
    assert "expanded (95 %" in lines[0]
    assert lines[1].split()[0] == "b"  # the largest first


def test_the_expanded_uncertainty_covers_the_true_lift_and_power(tmp_path):
    """Gain, drift, noise and pitch drawn anew 18 times: 95 % intervals hold the truth, and are not idle."""
    held, ratios = 0, []
    for seed in range(18):
        pitch = float(np.random.default_rng(seed).normal(0.0, 0.5))
        settings = Synthesis(
            seconds=8.0, seed=seed, artefacts=Artefacts(misalignment_deg=pitch), instruments=RATES
        )
        truth = synthesise(tmp_path / "a.mcap", settings)
        lift = analyse(tmp_path / "a.mcap").budgets["lift_n"]
        held += abs(lift.mean - truth.lift_n) <= lift.expanded
        ratios.append((lift.mean - truth.lift_n) / lift.combined)
    assert held >= 15
    assert 0.5 < np.std(ratios) < 1.4


def test_every_mean_has_a_budget_with_its_sources(small_bag):
    budgets = analyse(small_bag).to_json()["budget"]
    assert set(budgets) == {
        "flapping_frequency_hz", "angle_of_attack_deg", "forward_velocity_m_s", "lift_n", "drag_n", "power_w",
    }  # fmt: skip
    sources = {row["source"] for row in budgets["lift_n"]["rows"]}
    assert {"gain of the sensor", "resolution", "wind-off runs", "alignment of the sensor"} <= sources
    for budget in budgets.values():
        squares = sum(row["contribution"] ** 2 for row in budget["rows"])
        assert budget["combined_std"] == pytest.approx(np.sqrt(squares))


def test_correlations_of_known_records_and_how_well_they_are_known():
    rng = np.random.default_rng(0)
    inside = []
    for _ in range(100):
        a, b = (memory_process(350, 1.0, 4.5, 1.0, rng) for _ in range(2))
        found = correlations({"a": a, "b": b, "c": 0.6 * a + 0.8 * b})
        inside.append(abs(found.matrix[0, 1]) < 2.0 * found.std[0, 1])
        assert found.matrix[0, 2] == pytest.approx(0.6, abs=0.35)
    assert np.mean(inside) > 0.88  # about 95 %
    assert found.std[0, 1] > 1.5 / np.sqrt(350)  # memory leaves fewer independent cycles
    assert correlations({"a": a[:5]}) is None
    holes = a.copy()
    holes[::3] = np.nan
    assert correlations({"a": a, "b": holes}).matrix[0, 1] == pytest.approx(1.0)


def test_controls_are_uncorrelated_and_lift_follows_them(tmp_path):
    synthesise(tmp_path / "a.mcap", replace(SMALL, seconds=30.0))
    found = analyse(tmp_path / "a.mcap").correlations
    at = {name: k for k, name in enumerate(found.names)}
    for a, b in (("F", "AoA"), ("F", "U"), ("AoA", "U")):
        assert abs(found.matrix[at[a], at[b]]) < 3.5 * found.std[at[a], at[b]]
    assert found.matrix[at["U"], at["lift"]] > 0.5
    assert found.matrix[at["F"], at["power"]] > 0.9


def test_phase_average_of_a_known_wave():
    rng = np.random.default_rng(1)
    time = np.arange(20_000) * 1e-3
    bounds = 0.05 + np.cumsum(np.full(200, 0.09137))
    turns = np.interp(time, bounds, np.arange(200))
    wave = 2.0 + np.sin(2 * np.pi * turns) + 0.1 * rng.standard_normal(len(time))
    good = np.ones(199, bool)
    good[50] = False
    wave[(time > bounds[50]) & (time < bounds[51])] = 99.0
    block = Block(0.0, 1e-3, ("x",), wave[:, None])
    found = phase_average(block, Cycles(bounds, good, {}), "x", bins=36)
    assert found.cycles == 198
    expected = 2.0 + np.sin(2 * np.pi * found.phase)
    np.testing.assert_allclose(found.mean, expected, atol=0.03)
    assert np.median(found.std) == pytest.approx(0.11, abs=0.03)
    assert np.mean(np.abs(found.mean - expected) < 3.0 * found.mean_std) > 0.9


def test_spectra_have_the_power_of_the_signal():
    rng = np.random.default_rng(2)
    values = 3.0 * np.sin(2 * np.pi * 20.0 * np.arange(60_000) * 1e-3) + rng.standard_normal(60_000)
    found = power_spectrum(Block(0.0, 1e-3, ("x",), values[:, None]), "x")
    step = found.frequency[1]
    near = np.abs(found.frequency - 20.0) < 1.0
    assert (found.density[near].sum() * step) == pytest.approx(4.5, rel=0.03)
    assert np.median(found.density[~near]) == pytest.approx(2e-3, rel=0.1)  # white: s^2 / (rate / 2)


def test_probability_densities_have_unit_area():
    values = np.random.default_rng(3).normal(5.0, 2.0, 3000)
    found = probability_density(values)
    assert (found.histogram * np.diff(found.edges)).sum() == pytest.approx(1.0)
    for density in (found.kernel, *found.fitted.values()):
        assert np.trapezoid(density, found.value) == pytest.approx(1.0, abs=0.01)
    assert probability_density(np.full(100, 2.0)) is None


def test_folded_lines_are_seen_and_quiet_records_are_not_accused(tmp_path):
    instruments = replace(RATES, force_rate=10_000.0)
    for pwm, said in ((0.01, True), (0.0, False)):
        settings = Synthesis(seconds=10.0, artefacts=Artefacts(pwm=pwm), instruments=instruments)
        synthesise(tmp_path / "a.mcap", settings)
        report = analyse(tmp_path / "a.mcap")
        # 16.1 kHz sampled at 10 kHz shows at 3.9 kHz.
        assert any("a line at 39" in problem for problem in report.problems) == said
        assert report.mount_resonance == pytest.approx(75.0, abs=4.0)


@pytest.mark.parametrize(
    ("frequency", "mains", "said"), [(12.5, 50.0, True), (12.0, 60.0, True), (12.0, 50.0, False)]
)
def test_mains_on_a_harmonic_is_said(tmp_path, frequency, mains, said):
    artefacts = Artefacts(mains_frequency=mains)
    settings = replace(SMALL, seconds=10.0, flapping_frequency=frequency, artefacts=artefacts)
    synthesise(tmp_path / "a.mcap", settings)
    problems = analyse(tmp_path / "a.mcap").problems
    assert any(f"{mains:g} Hz of the mains is" in problem for problem in problems) == said


def test_the_raw_spectrum_does_not_depend_on_how_samples_come():
    data = np.random.default_rng(4).standard_normal((20_000, 2))
    index = np.arange(20_000)
    results = []
    for cuts in ([], [1], [2047, 2048, 2049, 9000], list(range(100, 20_000, 100))):
        collector = SpectrumCollector(2)
        for part, number in zip(np.split(data, cuts), np.split(index, cuts), strict=True):
            collector.add(number, part)
        results.append(collector.result(1000.0))
    for found in results[1:]:
        np.testing.assert_array_equal(found.density, results[0].density)
    assert np.mean(results[0].density) == pytest.approx(2e-3, rel=0.1)
    assert remarks(results[0], ("a", "b")) == []


@pytest.mark.parametrize("delay", [0.0, 3.7e-4, -2.0e-4])
def test_voltage_and_current_are_brought_together(delay):
    rate, n = 10_000.0, 100
    time = np.arange(40 * n) / rate
    voltage, current = np.sin(400.0 * time), np.cos(400.0 * (time - delay))
    blocks = (voltage.reshape(-1, n), current.reshape(-1, n))
    deskew = Deskew(delay)
    parts = [
        deskew.apply(v[None], i[None], np.array([k * n]), rate)
        for k, (v, i) in enumerate(zip(*blocks, strict=True))
    ]
    v, i = (np.concatenate([part[k] for part in parts]).ravel() for k in (0, 1))
    late = time - max(delay, 0.0)
    good = np.isfinite(v) & np.isfinite(i)
    assert good.sum() >= len(v) - 4
    np.testing.assert_allclose(v[good], np.sin(400.0 * late)[good], atol=1e-3)
    np.testing.assert_allclose(i[good], np.cos(400.0 * late)[good], atol=1e-3)


def test_the_delay_of_the_current_channel_is_told(tmp_path):
    for delay in (0.0, 4e-4):
        settings = replace(SMALL, seconds=10.0, artefacts=Artefacts(channel_skew=delay))
        synthesise(tmp_path / "a.mcap", settings)
        found = study(tmp_path / "a.mcap")
        assert channel_delay(found.data.power, found.cycles.bounds) == pytest.approx(delay, abs=1e-4)
        assert found.report.channel_delay == pytest.approx(delay, abs=1e-4)


def test_density_of_the_air_comes_from_its_temperature_and_pressure(tmp_path):
    synthesise(tmp_path / "a.mcap", replace(SMALL, air_density=1.19))
    assert analyse(tmp_path / "a.mcap").air_density == pytest.approx(1.19, rel=1e-6)


def test_long_gaps_of_the_camera_spoil_their_cycles_and_too_many_refuse_the_angle(tmp_path):
    synthesise(tmp_path / "a.mcap", replace(SMALL, artefacts=Artefacts(frame_drop=0.04)))
    few = analyse(tmp_path / "a.mcap")
    assert few.angle_of_attack is not None
    assert few.rejected["samples"]["angle_of_attack"]["missing"] > 20
    with_gaps = study(tmp_path / "a.mcap")
    time = with_gaps.data.angle.time
    holes = replace(with_gaps.data.angle, time=time[np.mod(time, 0.5) > 0.05])
    holes = replace(holes, values=holes.time * 0.0 + 0.26)
    data = replace(with_gaps.data, angle=holes)
    found = study_data(data, with_gaps.topic_map, source="holes").report
    assert found.angle_of_attack is None
    assert found.rejected["cycles_of_stream"]["angle_of_attack"] > 8
    assert any("angle_of_attack: refused," in problem for problem in found.problems)


def test_captures_with_pauses_give_the_power_of_their_cycles(small_bag):
    found = study(small_bag)
    block = found.data.power
    holes = np.mod(block.time, 1.0) > 0.6
    values = np.where(holes[:, None], np.nan, block.values)
    paused = replace(block, values=values, samples=len(values), bad=int(holes.sum()))
    data = replace(found.data, power=paused)
    refused = study_data(data, found.topic_map, source="paused").report
    assert refused.power is None
    assert any("power is refused" in problem for problem in refused.problems)
    assert refused.lift.mean == pytest.approx(found.report.lift.mean)
    role = replace(found.topic_map.power, intermittent=True)
    used = study_data(data, replace(found.topic_map, power=role), source="paused").report
    assert used.power.mean == pytest.approx(found.report.power.mean, rel=0.01)
    assert used.rejected["cycles_of_stream"]["power"] > 20


def test_pictures_and_tables_are_written(small_bag, tmp_path):
    found = study(small_bag)
    written = write_all(found, tmp_path / "out")
    assert {path.name for path in written} == {
        "report.json", "spectra.png", "densities.png", "cycles.png", "phase_average.png", "correlation.png",
        "cycles.csv", "phase_average.csv", "spectra.csv", "budget.csv",
    }  # fmt: skip
    assert all(path.stat().st_size > 300 for path in written)
    rows = list(csv.DictReader((tmp_path / "out" / "cycles.csv").read_text().splitlines()))
    used = [float(row["F_Hz"]) for row in rows if row["used"] == "1"]
    assert np.mean(used) == pytest.approx(found.report.flapping_frequency.mean)
    assert json.loads((tmp_path / "out" / "report.json").read_text())["cycles"] == found.report.cycles
