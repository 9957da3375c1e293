# SPDX-License-Identifier: Apache-2.0
"""Samples assembled into bins: gaps, bad samples, clocks."""

import numpy as np
import pytest

from cwmav_rig.blocks import Assembler, series

RATE = 10_000.0


def ramp(n, columns=2):
    values = np.arange(n, dtype=float)[:, None] + np.zeros(columns)
    values[:, 1] += 0.5 * np.sin(np.arange(n))
    return values


def add(assembler, first, data, *, sequence=None, start=100.0, overload=0):
    assembler.add_blocks(
        np.array([start + first / RATE]),
        RATE,
        np.array([first if sequence is None else sequence]),
        np.array([overload]),
        data[None],
    )


def assembled(cuts, n=1000):
    assembler = Assembler(("a", "b"))
    data = ramp(n)
    for low, high in zip([0, *cuts], [*cuts, n], strict=True):
        add(assembler, low, data[low:high])
    return assembler.finish()


def test_bins_are_means_and_their_times_the_middle_of_the_samples():
    block = assembled([100, 200])
    assert block.step == pytest.approx(1e-3)
    assert block.column("a").tolist() == [10.0 * k + 4.5 for k in range(100)]
    assert block.time[0] == pytest.approx(100.0 + 4.5e-4, abs=1e-7)
    assert (block.samples, block.bad) == (1000, 0)


@pytest.mark.parametrize("cuts", [[1], [7, 8, 9, 500], [333, 666], [995]])
def test_how_samples_are_cut_into_blocks_does_not_matter(cuts):
    expected, found = assembled([]), assembled(cuts)
    np.testing.assert_allclose(found.values, expected.values, rtol=1e-15)
    assert found.start == pytest.approx(expected.start, abs=1e-9)


def test_a_lost_block_is_a_gap_and_counted():
    assembler, data = Assembler(("a", "b")), ramp(1000)
    for low in (0, 100, 300, 400):
        add(assembler, low, data[low : low + 100])
    block = assembler.finish()
    assert np.flatnonzero(~block.good).tolist() == list(range(20, 30))
    assert block.column("a")[30] == 304.5
    assert (block.bad, block.samples) == (100, 500)
    assert block.faults == {"lost": 100, "gaps": 1}


def test_without_sequence_numbers_the_stamps_show_the_gap():
    assembler, data = Assembler(("a", "b")), ramp(1000)
    for low in (0, 100, 300, 400):
        add(assembler, low, data[low : low + 100], sequence=0)
    block = assembler.finish()
    assert np.flatnonzero(~block.good).tolist() == list(range(20, 30))
    assert block.bad == 100


def test_a_repeated_block_is_dropped_and_a_restarted_counter_is_followed():
    assembler, data = Assembler(("a", "b")), ramp(1000)
    add(assembler, 0, data[:100], sequence=5000)
    add(assembler, 0, data[:100], sequence=5000)
    add(assembler, 100, data[100:200], sequence=5100)
    add(assembler, 200, data[200:300], sequence=1)
    add(assembler, 300, data[300:400], sequence=101)
    block = assembler.finish()
    assert block.column("a").tolist() == [10.0 * k + 4.5 for k in range(40)]
    assert block.faults == {"duplicate": 100}


def test_nan_overload_and_stuck_samples_mask_their_bins():
    assembler, data = Assembler(("a", "b")), ramp(1000)
    data[105, 1] = np.nan
    data[500:540] = data[500]
    add(assembler, 0, data[:300])
    add(assembler, 300, data[300:310], overload=3)
    add(assembler, 310, data[310:])
    block = assembler.finish()
    assert np.flatnonzero(~block.good).tolist() == [10, 30, 50, 51, 52, 53]
    assert block.faults == {"nan": 1, "stuck": 40, "overload": 3, "beside_overload": 7}
    assert block.bad == 51


def test_samples_at_the_end_of_the_range_are_masked_and_account_for_the_flags():
    assembler, data = Assembler(("a", "b"), ranges=np.array([8.0, 0.0])), ramp(1000) * 1e-3
    data[205:207, 0] = [8.0, -8.0]
    data[600, 1] = 50.0  # of unknown range
    add(assembler, 0, data[:200])
    add(assembler, 200, data[200:300], overload=2)
    add(assembler, 300, data[300:])
    block = assembler.finish()
    assert np.flatnonzero(~block.good).tolist() == [20]
    assert block.faults == {"overload": 2, "saturated": 2}
    assert block.bad == 2


def test_late_stamps_do_not_bend_the_time_base():
    assembler, data = Assembler(("a", "b")), ramp(10_000)
    rng = np.random.default_rng(0)
    for low in range(0, 10_000, 100):
        late = 0.004 if rng.random() < 0.1 else 0.0
        add(assembler, low, data[low : low + 100], start=100.0 + 20e-6 * rng.standard_normal() + late)
    block = assembler.finish()
    assert block.bad == 0
    np.testing.assert_allclose(block.time, 100.0 + 4.5e-4 + 1e-3 * np.arange(1000), atol=3e-5)


def test_skew_of_the_stamps_is_kept():
    assembler, data = Assembler(("a", "b")), ramp(10_000)
    for low in range(0, 10_000, 100):
        assembler.add_blocks(
            np.array([low / RATE * (1.0 + 5e-5)]),
            RATE,
            np.array([low]),
            np.array([0]),
            data[low : low + 100][None],
        )
    assert assembler.finish().step == pytest.approx(1e-3 * (1.0 + 5e-5), rel=1e-9)


def test_single_samples_find_their_rate_and_gaps():
    stamps = np.arange(4000) / 2000.0
    keep = np.ones(4000, bool)
    keep[1000:1100] = False
    assembler = Assembler(("a", "b"))
    data = ramp(4000)
    for part in np.split(np.flatnonzero(keep), [50, 51, 2000]):
        assembler.add_samples(stamps[part], data[part])
    block = assembler.finish()
    assert block.step == pytest.approx(1e-3, rel=1e-6)
    assert (~block.good).sum() == 50
    assert block.column("a")[0] == 0.5
    assert block.faults == {"lost": 100, "gaps": 1}


def test_a_report_in_between_does_not_change_the_end():
    assembler, data = Assembler(("a", "b")), ramp(1000)
    add(assembler, 0, data[:333])
    assembler.finish()
    add(assembler, 333, data[333:])
    np.testing.assert_allclose(assembler.finish().values, assembled([]).values, rtol=1e-15)


def test_the_tail_is_the_end_of_the_block():
    assembler, data = Assembler(("a", "b")), ramp(1000)
    for low in range(0, 1000, 50):
        add(assembler, low, data[low : low + 50])
    tail, block = assembler.tail(0.02), assembler.finish()
    last = int(np.argmin(np.abs(block.time - tail.time[-1])))
    np.testing.assert_allclose(tail.values, block.values[last + 1 - len(tail.values) : last + 1])
    np.testing.assert_allclose(tail.time, block.time[last + 1 - len(tail.values) : last + 1])


def test_nothing_gives_nothing():
    assert Assembler(("a",)).finish() is None
    assert Assembler(("a",)).tail(1.0) is None


def test_series_counts_what_it_drops():
    time = np.array([0.0, 0.1, 0.2, 0.2, 0.3, 0.6, 0.7, 0.5, 0.8])
    values = np.array([0.0, 1.0, 2.0, 2.0, np.nan, 6.0, 7.0, 5.0, 8.0])
    found = series(time, values)
    assert found.values.tolist() == [0.0, 1.0, 2.0, 5.0, 6.0, 7.0, 8.0]
    assert found.faults == {"nan": 1, "duplicate": 1, "missing": 2, "out_of_order": 1}
