# SPDX-License-Identifier: Apache-2.0
"""Flapping cycles in signals with known phase."""

import numpy as np
import pytest

from cwmav_common.errors import InputError
from cwmav_rig.blocks import Block
from cwmav_rig.cycles import cycle_means, find_cycles, fundamental
from cwmav_rig.physics.scatter import frequency_process, phase_of

NAMES = ("fx", "fy", "fz")
STEP = 1e-3


def wobbling(frequency, seconds=20.0, sigma=0.0128, seed=0):
    """Give a phase [rad] that wanders, and its frequency [Hz], at 1 kHz."""
    rng = np.random.default_rng(seed)
    f = frequency_process(int(seconds / STEP), STEP, frequency, sigma * frequency, 0.8, rng)
    return phase_of(f, STEP), f


def block_of(fz, fx=None):
    values = np.zeros((len(fz), 3))
    values[:, 2] = fz
    values[:, 0] = 0.0 if fx is None else fx
    return Block(5.0, STEP, NAMES, values)


def true_frequencies(phase, bounds):
    """Mean frequency between the bounds of cycles, from the true phase."""
    time = 5.0 + STEP * np.arange(len(phase))
    return np.diff(np.interp(bounds, time, phase)) / (2.0 * np.pi) / np.diff(bounds)


@pytest.mark.parametrize("frequency", [4.0, 9.7, 12.0, 16.67, 25.0, 30.0])
@pytest.mark.parametrize("shape", ["sine", "mostly 2 F", "with mains and noise"])
def test_every_cycle_is_found_with_its_frequency(frequency, shape):
    phase, _ = wobbling(frequency)
    rng = np.random.default_rng(1)
    time = STEP * np.arange(len(phase))
    signal = {
        "sine": np.cos(phase),
        "mostly 2 F": 0.2 * np.cos(phase + 1) + np.cos(2 * phase) + 0.3 * np.sin(4 * phase),
        "with mains and noise": 0.4 * np.cos(phase)
        + 0.2 * np.cos(2 * phase)
        + 0.02 * np.sin(2 * np.pi * 50 * time)
        + 0.004 * rng.standard_normal(len(phase)),
    }[shape]
    cycles = find_cycles(block_of(-0.16 + signal))
    expected = (phase[-1] - phase[0]) / (2 * np.pi)
    assert expected - 5 < len(cycles.good) <= expected
    assert cycles.good.all()
    truth = true_frequencies(phase, cycles.bounds)
    assert np.std(cycles.frequency - truth) < 0.004 * frequency
    assert np.std(cycles.frequency) == pytest.approx(np.std(truth), rel=0.05)


def test_a_ringing_mount_does_not_take_over():
    phase, _ = wobbling(12.0)
    ring = 2.0 * np.cos(6.0 * phase + 0.3)
    assert find_cycles(block_of(0.3 * np.cos(phase) + ring)).frequency.mean() == pytest.approx(12.0, rel=0.01)


def test_the_axis_that_shows_the_beat_is_used():
    phase, _ = wobbling(12.0)
    noise = 0.01 * np.random.default_rng(0).standard_normal(len(phase))
    assert find_cycles(block_of(noise, fx=0.3 * np.cos(phase))).frequency.mean() == pytest.approx(
        12, rel=0.01
    )


def test_cycles_with_gaps_are_left_out_and_the_others_stay():
    phase, _ = wobbling(12.0)
    block = block_of(np.cos(phase) + 0.3 * np.cos(2 * phase))
    whole = find_cycles(block)
    block.values[7000:7003] = np.nan
    block.values[12_000:12_200] = np.nan
    cycles = find_cycles(block)
    assert 4 <= (~cycles.good).sum() <= 7
    assert cycles.rejected["gap_or_masked"] == (~cycles.good).sum()
    truth = true_frequencies(phase, cycles.bounds)[cycles.good]
    assert np.abs(cycles.frequency[cycles.good] - truth).max() < 0.03 * 12
    assert len(cycles.good) == len(whole.good)


def test_a_disturbed_cycle_is_left_out():
    phase, _ = wobbling(12.0)
    signal = np.cos(phase)
    signal[9000:9010] += 30.0
    cycles = find_cycles(block_of(signal))
    assert 1 <= cycles.rejected["odd_waveform"] <= 3


@pytest.mark.parametrize("signal", ["noise", "constant", "mains"])
def test_no_beat_is_said_to_be_none(signal):
    time = STEP * np.arange(10_000)
    rng = np.random.default_rng(0)
    values = {
        "noise": rng.standard_normal(10_000),
        "constant": np.full(10_000, 0.2),
        "mains": np.sin(2 * np.pi * 50 * time) + 0.01 * rng.standard_normal(10_000),
    }[signal]
    with pytest.raises(InputError, match="no periodic signal"):
        find_cycles(block_of(values))


def test_too_short_a_record_is_refused():
    phase, _ = wobbling(4.0, seconds=1.5)
    with pytest.raises(InputError, match="force: "):
        find_cycles(block_of(np.cos(phase)))


def test_fundamental_is_not_taken_for_its_multiple_or_fraction():
    time = STEP * np.arange(8000)
    turn = 2 * np.pi * 7.3 * time
    for amplitudes in ([1, 0, 0], [0.1, 1, 0.1], [0.1, 0.2, 1], [1, 1, 1]):
        signal = sum(a * np.cos((k + 1) * turn + k) for k, a in enumerate(amplitudes))
        assert fundamental(signal[:, None], 1000.0) == pytest.approx(7.3, rel=0.01)


def test_means_over_cycles_are_exact_for_a_ramp_and_missing_over_gaps():
    time = 5.0 + STEP * np.arange(1000)
    block = block_of(3.0 * time)
    bounds = np.array([5.1, 5.2375, 5.4, 5.9])
    np.testing.assert_allclose(
        cycle_means(block, "fz", bounds), 3.0 * (bounds[1:] + bounds[:-1]) / 2, rtol=1e-6
    )
    block.values[500] = np.nan
    assert np.isnan(cycle_means(block, "fz", bounds)).tolist() == [False, False, True]
    assert np.isnan(cycle_means(block, "fz", np.array([4.0, 5.2, 5.3]))).tolist() == [True, False]
