# SPDX-License-Identifier: Apache-2.0
"""What is kept of the surroundings of a cell, against a search through all entries."""

import llvmlite.binding as llvm
import numba as nb
import numpy as np
import pytest

from cwmav_sim.sph import blocks
from cwmav_sim.sph.blocks import lane_orders, lanes
from cwmav_sim.sph.cells import REACH
from cwmav_sim.sph.gather import FAR, aligned_rows
from cwmav_sim.sph.nearby import add_back, box_around, keep_nearby, keep_same, multiple
from cwmav_sim.sph.patches import ROWS as MOST_ROWS
from cwmav_sim.sph.patches import SLABS, Patch

ROWS, ENTRIES, ROOM = 5, 203, 304
PATCH, WINDOW = Patch(0, 0, 2, 0, 3, REACH), (1, 1)  # rows 1 to 5 of 6, slabs 1 to 5 of 7
WINDOW_ROWS = PATCH.y1 - PATCH.y0 + 2 * REACH


@nb.njit
def keep(buf, begin, box, reach2, orders, out, kept):
    return keep_nearby(buf, ROWS, begin, PATCH, WINDOW, box, reach2, orders, out, kept)


@nb.njit
def keep_more(buf, row, kept, looks, orders, out):
    keep_same(buf, row, kept, looks, orders, out)


@pytest.fixture(params=[np.float32, np.float64])
def window(request):
    """Return a buffer filled in rows of uneven length, their first entries, a box and the square of a reach.

    What does not belong to the window lies out of reach.
    """
    draw, kind = np.random.default_rng(3), request.param
    length = draw.integers(0, 9, SLABS * MOST_ROWS)
    rows = WINDOW_ROWS
    length[7 * rows :] = 0
    length[7 * rows - 1] += ENTRIES - length.sum()
    begin = np.concatenate([[0], np.cumsum(length)])
    buf = aligned_rows(ROWS, ROOM, np.zeros(1, kind))
    buf[:] = 0.0
    buf[:, :ENTRIES] = draw.uniform(-1.0, 1.0, (ROWS, ENTRIES))
    inside = np.zeros(ROOM, np.bool_)
    for slab in range(1, 6):
        inside[begin[slab * rows + 1] : begin[slab * rows + 6]] = True
    buf[0, ~inside] = FAR
    box = (kind(0.1), kind(-0.2), kind(0.3)), (kind(0.2), kind(0.05), kind(0.1))
    return buf, begin, box, kind(1.5)


def within(buf, box, reach2):
    beyond = np.maximum(np.abs(buf[:3] - np.array(box[0])[:, None]) - np.array(box[1])[:, None], 0.0)
    return np.flatnonzero((beyond**2).sum(axis=0) < reach2)


def kept_of(buf, begin, box, reach2, function=keep):
    out, kept = np.full((ROWS, ROOM), np.nan, buf.dtype), np.zeros((ROOM, 2), np.uint64)
    n, looks = function(buf, begin, box, reach2, lane_orders(buf.dtype), out, kept)
    return out, kept, n, looks


def test_exactly_what_is_within_reach_is_kept_in_its_order(window):
    buf, _, box, reach2 = window
    out, _, n, _ = kept_of(*window)
    expected = within(buf, box, reach2)
    assert 20 < len(expected) < ENTRIES - 20
    block = multiple(buf)
    assert (out[:, : len(expected)] == buf[:, expected]).all()
    assert n % block == 0
    assert len(expected) <= n < len(expected) + block
    assert (out[0, len(expected) : n] == FAR).all()
    assert (out[1:, len(expected) : n] == 0.0).all()


def test_other_buffers_follow_and_sums_go_back(window):
    buf, _, box, reach2 = window
    _, kept, _, looks = kept_of(*window)
    expected = within(buf, box, reach2)
    other = np.random.default_rng(4).normal(size=(3, ROOM)).astype(buf.dtype)
    out = np.full((3, ROOM), np.nan, buf.dtype)
    keep_more(other, 1, kept, looks, lane_orders(buf.dtype), out)
    assert (out[1, : len(expected)] == other[1, expected]).all()
    assert (out[1, len(expected) : len(expected) + multiple(buf)] == 0.0).all()
    back = other.copy()
    add_back(np.ascontiguousarray(out[1:2]), kept, looks, back[1:2])
    other[1, expected] *= 2.0
    assert (back == other).all()


@pytest.mark.parametrize("features", [(), ("avx2",), ("avx2", "avx512f")])
def test_every_processor_keeps_the_same(window, monkeypatch, features):
    host = llvm.get_host_cpu_features()
    assert blocks.has_permutation() == bool(host.get("avx2", False))
    assert blocks.has_compression() == bool(host.get("avx512f", False))
    if any(not host.get(feature, False) for feature in features):
        pytest.skip(f"this processor has not all of {features}")
    expected, *_ = kept_of(*window)
    monkeypatch.setattr(blocks, "_has", lambda feature: feature in features)

    @nb.njit
    def kept_here(buf, begin, box, reach2, orders, out):
        entries, at, width = 0, 0, blocks.lanes_of(buf)
        for slab in range(1, 6):
            first, last = begin[slab * WINDOW_ROWS + 1], begin[slab * WINDOW_ROWS + 6]
            at = max(at, first // width * width)
            while at < last:
                bits = blocks.lanes_within(buf, at, box[0], box[1], reach2)
                blocks.copy_lanes(out, entries, buf, at, (0, ROWS), bits, orders)
                entries += blocks.count_lanes(bits)
                at += width
        return entries

    found = np.full((ROWS, ROOM), np.nan, window[0].dtype)
    entries = kept_here(*window, lane_orders(window[0].dtype), found)
    assert entries > 20
    assert entries == len(within(window[0], *window[2:]))
    assert (found[:, :entries] == expected[:, :entries]).all()

    @nb.njit
    def copied(source, first, bits, orders, out):
        blocks.copy_lanes(out, 3, source, first, (1, ROWS), bits, orders)
        return blocks.lanes_of(source), blocks.count_lanes(bits)

    buf, orders = window[0], lane_orders(window[0].dtype)
    for bits in (0, 1, 0b1010, 0b1101 if buf.itemsize == 8 else 0b11010111):
        out = np.full((ROWS, ROOM), np.nan, buf.dtype)
        width, count = copied(buf, 40, np.uint64(bits), orders, out)
        assert width == lanes(buf.dtype)
        marked = [40 + lane for lane in range(width) if bits >> lane & 1]
        assert count == len(marked)
        assert (out[1:, 3 : 3 + count] == buf[1:, marked]).all()
        assert np.isnan(out[0]).all()
        assert np.isnan(out[:, :3]).all()
        assert np.isnan(out[:, 3 + width :]).all()


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_orders_bring_the_marked_lanes_to_the_front(kind, monkeypatch):
    monkeypatch.setattr(blocks, "has_compression", lambda: False)
    count = lanes(np.dtype(kind))
    orders = lane_orders(np.dtype(kind))
    assert len(orders) == 2**count
    values = np.arange(count, dtype=kind).view(np.float32)
    for bits, order in enumerate(orders):
        places = np.array([order], np.uint64).view(np.uint8)
        moved = values[places].view(kind)
        marked = [lane for lane in range(count) if bits >> lane & 1]
        assert moved[: len(marked)].tolist() == marked
        assert sorted(moved) == list(range(count))


def test_box_holds_the_points_of_a_cell():
    points = np.random.default_rng(5).normal(size=(4, 9)).astype(np.float32)
    centre, half = box_around(points, 2, 6, (np.float32(-0.5), np.float32(0.25)))
    low, high = points[:3, 2:6].min(axis=1), points[:3, 2:6].max(axis=1)
    np.testing.assert_allclose(np.array(centre) - [0, -0.5, 0.25], (low + high) / 2, atol=1e-6)
    np.testing.assert_allclose(half, (high - low) / 2, atol=1e-6)
