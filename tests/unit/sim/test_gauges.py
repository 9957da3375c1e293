# SPDX-License-Identifier: Apache-2.0
"""Cycle means, their uncertainty, and periodicity on signals with known answers."""

import numpy as np
import pytest

from cwmav_common.errors import InputError
from cwmav_sim.gauges import History, Recorder, cycle_mean, is_periodic, mean_uncertainty, phase_bins

FREQUENCY = 16.0


def uneven_times(rng, cycles, steps=900):
    widths = rng.uniform(0.6, 1.4, cycles * steps)
    return np.concatenate([[0.0], np.cumsum(widths) / widths.sum()]) * cycles / FREQUENCY


def test_mean_over_whole_cycles_ignores_the_oscillation():
    rng = np.random.default_rng(1)
    t = uneven_times(rng, 4)
    signal = 0.15 + 2.0 * np.sin(2 * np.pi * FREQUENCY * t + 0.3) + 0.7 * np.cos(4 * np.pi * FREQUENCY * t)
    result = cycle_mean(phase_bins(t, signal, FREQUENCY), discard=1)
    assert result.mean == pytest.approx(0.15, abs=2e-5)
    assert result.std < 1e-5
    assert len(result.per_cycle) == 4


def test_first_cycles_are_left_out_of_the_mean_only():
    t = np.linspace(0, 3 / FREQUENCY, 3001)
    signal = np.where(t < 1 / FREQUENCY, 5.0, 1.0)
    result = cycle_mean(phase_bins(t, signal, FREQUENCY), discard=1)
    assert result.mean == pytest.approx(1.0, abs=1e-2)
    assert result.per_cycle[0] == pytest.approx(5.0, abs=1e-2)


def test_incomplete_cycle_is_not_counted():
    t = np.linspace(0, 2.6 / FREQUENCY, 2000)
    assert phase_bins(t, np.ones_like(t), FREQUENCY).shape[0] == 2


def test_linear_signal_is_integrated_exactly():
    t = uneven_times(np.random.default_rng(3), 2, steps=100)
    binned = phase_bins(t, t, FREQUENCY, bins=8)
    centres = (np.arange(16) + 0.5) / (8 * FREQUENCY)
    np.testing.assert_allclose(binned.ravel(), centres, rtol=1e-9)


@pytest.mark.parametrize("correlation", [0.0, 0.9, 0.95])
def test_uncertainty_covers_the_scatter_of_repeated_runs(correlation):
    rng = np.random.default_rng(7)
    cycles, bins, runs = 4, 64, 600
    means, stds = [], []
    for _ in range(runs):
        noise = rng.normal(size=cycles * bins)
        for k in range(1, noise.size):
            noise[k] = correlation * noise[k - 1] + np.sqrt(1 - correlation**2) * noise[k]
        binned = noise.reshape(cycles, bins) + 10.0 * np.sin(np.linspace(0, 2 * np.pi, bins))
        means.append(binned.mean())
        stds.append(mean_uncertainty(binned))
    ratio = np.sqrt(np.mean(np.square(stds))) / np.std(means)
    assert 0.75 < ratio < 1.4


def test_uncertainty_needs_two_cycles():
    assert np.isnan(mean_uncertainty(np.ones((1, 8))))


def test_too_few_cycles_is_said():
    t = np.linspace(0, 1.5 / FREQUENCY, 500)
    with pytest.raises(InputError, match="1 complete cycles"):
        cycle_mean(phase_bins(t, t, FREQUENCY), discard=2)


def test_periodicity_rule():
    shape = np.sin(np.linspace(0, 2 * np.pi, 16, endpoint=False))
    drag = np.zeros((3, 16))

    def lift(*means):
        return np.array([shape + m for m in means])

    assert is_periodic(lift(0.5, 0.150, 0.152), drag, 0.02)
    assert not is_periodic(lift(0.150, 0.150, 0.160), drag, 0.02)
    assert not is_periodic(lift(0.150), drag, 0.02)
    assert is_periodic(lift(0.5, 0.0, 0.001), drag - 0.1, 0.02), "small against the resultant force"


def test_half_model_counts_twice_and_has_no_side_force():
    recorder = Recorder(panels=2, copies=2)
    pressure = np.array([[1.0, 2.0, 3.0], [0.5, -1.0, 0.25]])
    viscous = np.full((2, 3), 0.125)
    for k in range(3):
        moment, inertial = 0.5 * pressure, -pressure
        recorder.add(0.01 * k, pressure, viscous, np.array([0.5, 1.0]), moment, inertial)
    pressure[:] = 0.0  # the recorder keeps its own copy
    history = recorder.history()
    np.testing.assert_allclose(history.lift(), 2 * 3.5)
    np.testing.assert_allclose(history.drag(), 2 * 1.75)
    np.testing.assert_allclose(history.total()[:, 1], 0.0)
    np.testing.assert_allclose(history.total_power(), 3.0)
    np.testing.assert_allclose(history.pitch_moment(), 2 * 0.5)
    np.testing.assert_allclose(history.part(history.inertial), [[-3.0, 0.0, -6.5]] * 3)
    assert isinstance(history, History)


def test_empty_recorder_gives_an_empty_history():
    assert Recorder(panels=2, copies=1).history().lift().shape == (0,)
